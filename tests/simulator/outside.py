"""What happens in rigs and is in no catalogue: one size each; direction, joint and time are the specimen's."""

from __future__ import annotations

import numpy as np

from tests.simulator.finger import FLEXIONS, Floats
from tests.simulator.situation import OUTSIDE, Situation


def _unit(vector: Floats) -> Floats:
    out: Floats = vector / np.linalg.norm(vector)
    return out


@OUTSIDE.enter("posture", "deg", 0.5, 15.0)
def seating(s: Situation, size: Floats, shape: Floats) -> None:
    """Once, somewhere in the session's first two thirds, the tip slips in its clamp: PIP, DIP and the held point shift.

    Everything read at the tip from then on has the new posture.
    """
    slipped = s.end_s * (0.37 + 0.22 * shape[0])
    if s.case.location == "tip" and s.middle_s > slipped:
        s.angles = s.angles + np.deg2rad(size[0]) * np.array([0.0, 0.15, 1.0, -0.7]) * np.sign(shape[1])
        s.finger.load_point = s.finger.load_point + np.array([0.1 * size[0], 0.0, 0.05 * size[0]])


@OUTSIDE.enter("geometry", "1", 0.02, 1.0)
def mcp_axis_order(s: Situation, size: Floats, shape: Floats) -> None:
    """The abduction axis stays with the metacarpal instead of being carried by flexion, wholly at 1, partly below."""
    s.finger.abduction_first = float(size[0])


@OUTSIDE.enter("geometry", "mm²", 2.0, 2000.0)
def clamp_moments(s: Situation, size: Floats, shape: Floats) -> None:
    """The tip clamp also resists twist about x and y, with this stiffness against that along its axes."""
    s.finger.twist = float(size[0])


@OUTSIDE.enter("geometry", "mm", 2.0, 14.0)
def edc_subluxation(s: Situation, size: Floats, shape: Floats) -> None:
    """EDC slides off the head of the metacarpal towards ulnar and palmar once the MCP flexes past some 25°."""
    slid = 0.5 * (1.0 + np.tanh((s.angles[0] - np.deg2rad(25.0 + 5.0 * shape[0])) / np.deg2rad(8.0)))
    s.move(s.finger.of("EDC", joint="MCP"), size[0] * slid * np.array([0.0, -0.5, -1.0]))


@OUTSIDE.enter("hood", "1", 0.05, 1.0)
def hood_saturation(s: Situation, size: Floats, shape: Floats) -> None:
    """One side of the hood comes taut under load: what exceeds a newton goes to the central slip (or to the bands).

    A fraction changes with the tension of its own muscle, so the hood is not linear in the loads.
    """
    fraction = dict(s.finger.fraction)
    for muscle, i in (("RI", 0), ("LU", 1), ("UI", 2), ("EDC", 5)):
        now = fraction[f"{muscle}_ES"]
        limit = 1.0 if shape[0] > 0.0 else 0.0
        taut = size[0] * float(s.pull[i]) ** 2 / (4.0 + float(s.pull[i]) ** 2)
        fraction[f"{muscle}_ES"] = now + (limit - now) * taut
    s.finger.fraction = fraction


@OUTSIDE.enter("torque", "1", 0.02, 0.6)
def tissue_relaxation(s: Situation, size: Floats, shape: Floats) -> None:
    """Creeping tissue takes over joint torque from the moment the posture was set: 1 - a (1 - exp(-t/τ)), τ 20-90 s."""
    since = s.middle_s - s.case.block_start_s
    s.torque = s.torque * (1.0 - size[0] * (1.0 - np.exp(-since / (55.0 + 35.0 * shape[0]))))


@OUTSIDE.enter("torque", "1", 0.01, 0.5)
def hysteresis(s: Situation, size: Floats, shape: Floats) -> None:
    """Tissue keeps a share of the torque that the load before left in it; after a tare it keeps nothing."""
    s.torque = s.torque + size[0] * (s.torque_before - s.torque)


@OUTSIDE.enter("torque", "N mm", 2.0, 150.0)
def passive_stiffness(s: Situation, size: Floats, shape: Floats) -> None:
    """Joints resist their posture the more, the more load squeezes them: elastic in angle, saturating in total load."""
    load = float(s.pull.sum())
    bent = np.tanh((s.angles[FLEXIONS] - np.deg2rad([20.0, 45.0, 30.0]) - 0.2 * shape[:3]) / 0.5)
    s.torque = s.torque.copy()
    s.torque[FLEXIONS] -= size[0] * np.array([1.0, 0.7, 0.4]) * bent * load / (load + 6.0)


@OUTSIDE.enter("reading", "1", 0.05, 0.2)
def force_shunt(s: Situation, size: Floats, shape: Floats) -> None:
    """A screw, cable or frame carries a share of the force past the cell at one mounting, in one direction only."""
    at_bone = shape[0] > 0.0
    if (s.case.location == "bone") == at_bone:
        main = np.array([1.0, 0.3, 0.0]) if at_bone else np.array([0.5, 0.8, 0.2])
        way = _unit(main + 0.4 * shape[1:4])
        passed = np.concatenate([way * (way @ s.wrench[:3]), np.zeros(3)])
        s.wrench = s.wrench - size[0] * passed
