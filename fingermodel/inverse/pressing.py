"""A finger that presses on a plate, as Hu et al. 2014a and 2014b state it: angles of the bones, force in the room.

X is horizontal and points from the tip towards the hand, Y is vertical, Z radial (right hand). θ1 to θ4 are the angles
of the distal, middle and proximal phalanx and of the metacarpal from X; a bone's proximal axis is (cos θ, sin θ, 0) and
its dorsal one (−sin θ, cos θ, 0), so a joint's flexion is the angle of its child less that of its parent, and a force
P moves the tip about a joint by P_x l sin θ − P_y l cos θ, flexion positive (Eq 1).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from daq.errors import InputError
from fingermodel.fingers import Finger, Topology
from fingermodel.inverse.areas import areas_of
from fingermodel.inverse.closures import closure_of, slip_names
from fingermodel.inverse.equilibrium import Cases, anatomy_of, balances, demands, loads_of
from fingermodel.inverse.least_stress import least_stress
from fingermodel.model import jax_values

Floats = NDArray[np.float64]


class Pressing(NamedTuple):
    """Forces inside a pressing finger, divided by the magnitude of the load.

    Attributes:
        muscle: by the closure's names of the muscles.
        slip: every tendon and slip of the hood.
        contact: magnitude of the force between the bones, by joint.
        push: muscles that the closure asks to push.
    """

    muscle: dict[str, float]
    slip: dict[str, float]
    contact: dict[str, float]
    push: tuple[str, ...]


def pressing_posture(topology: Topology, theta_deg: Sequence[float]) -> Floats:
    """Joint angles (rotations,) [rad] from angles of the bones, distal first; rotations other than flexion are 0.

    Raises:
        InputError: not one angle a bone.
    """
    if len(theta_deg) != len(topology.bones):
        raise InputError(f"{len(theta_deg)} angles", f"one for each of {', '.join(reversed(topology.bones))}")
    angle = np.deg2rad(np.array(theta_deg, dtype=float))[::-1]
    out: list[float] = []
    for joint in topology.joints:
        bend = angle[joint.child] - angle[joint.parent]
        out += [float(bend) if i == joint.flexion else 0.0 for i in range(len(joint.rotations))]
    return np.array(out)


def pressing_wrench(theta_deg: Sequence[float], force_N: Sequence[float]) -> Floats:
    """What a finger does to a plate that presses it with `force_N`: (6,) [N, N mm], distal phalanx's axes."""
    angle = np.deg2rad(float(theta_deg[0]))
    c, s = np.cos(angle), np.sin(angle)
    to_bone = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.concatenate([-to_bone @ np.asarray(force_N, dtype=float), np.zeros(3)])


def pressing_forces(
    finger: Finger, theta_deg: Sequence[float], force_N: Sequence[float], closure: str = "chao"
) -> Pressing:
    """Muscle, slip and contact forces of a pressing finger, per newton of load.

    Args:
        finger: whose `load_point` is where the plate presses.
        theta_deg: angles of the bones from X, distal first (θ1 to θ4).
        force_N: (3,) of the plate on the finger, P_x, P_y, P_z.
        closure: one of `closures.NAMES`.

    Raises:
        InputError: no such closure, a wrong number of angles, or no load.
        ModelError: a finger that the closure does not fit.
    """
    topology, load = finger.topology, float(np.linalg.norm(force_N))
    if not load > 0.0:
        raise InputError("no load at the tip", "a force")
    chosen = closure_of(closure, topology)
    cases = Cases(
        anatomy_of(finger.values)[None],
        pressing_posture(topology, theta_deg)[None],
        pressing_wrench(theta_deg, force_N)[None],
    )
    values = jax_values(finger.values)
    if closure == "least_squares":
        demand = demands(topology, values, cases)
        held = least_stress(np.asarray(demand.arms[0]), np.asarray(demand.torque[0]), areas_of(finger).cm2)
        balance = loads_of(topology, values, cases, held.tension[None])
        tension = dict(zip(topology.muscles, held.tension, strict=True))
    else:
        balance = balances(topology, chosen.matrix(topology), values, cases)
        tension = {}
    slip = {n: float(x) / load for n, x in zip(slip_names(topology), np.asarray(balance.slip[0]), strict=True)}
    contact = np.linalg.norm(np.asarray(balance.contact[0]), axis=1) / load
    muscle = {m.name: float(tension[m.name]) / load if tension else slip[m.slip] for m in chosen.muscles}
    return Pressing(
        muscle,
        slip,
        {joint.name: float(x) for joint, x in zip(topology.joints, contact, strict=True)},
        tuple(name for name, x in muscle.items() if x < -1e-9),
    )
