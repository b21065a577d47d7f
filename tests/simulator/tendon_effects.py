"""What may happen to tensions before and within the finger: catalogue effects at the stages tension, hood and sharing.

Each is a form of our own: `Otherwise` says how it departs from the plain one.
"""

from __future__ import annotations

import numpy as np

from tests.simulator.finger import JOINTS, MUSCLES, Floats
from tests.simulator.situation import CATALOGUE, Situation

_FDP, _FDS = MUSCLES.index("FDP"), MUSCLES.index("FDS")


@CATALOGUE.enter("tension", "g", 5.0, 100.0)
def hanger_mass(s: Situation, size: Floats, shape: Floats) -> None:
    """Every loaded tendon carries an unweighed hanger of `size` g.

    Otherwise: the six hangers are not alike, each is up to 10 % lighter or heavier.
    """
    s.pull = s.pull + s.hung * size[0] * (1.0 + 0.1 * shape[:6]) * s.newton_per_gram


@CATALOGUE.enter("tension", "1", -0.2, 0.2)
def rig_friction(s: Situation, size: Floats, shape: Floats) -> None:
    """The rig's pulleys pass more (or less) than the session's factor says.

    Otherwise: bearings under load: 0.9 of the stated share at no tension, 1.1 of it at a high one.
    """
    s.pull = s.pull * (1.0 + size[0] * (0.9 + 0.2 * s.pull / (s.pull + 4.0)))


@CATALOGUE.enter("tension", "1", 0.0, 0.35, MUSCLES)
def worn_pulley(s: Situation, size: Floats, shape: Floats) -> None:
    """One tendon's pulley loses a share more.

    Otherwise: a stiff bearing loses up to 1.2 of the stated share of a light load and 0.9 of it of a heavy one.
    """
    s.pull = s.pull * (1.0 - size * (0.9 + 0.3 * np.exp(-s.pull / 2.0)))


@CATALOGUE.enter("hood", "1/rad", 0.0, 1.0)
def hood_shift(s: Situation, size: Floats, shape: Floats) -> None:
    """The hood slides distally as PIP (and MCP) flex: intrinsics go to the bands, the extensor to the central slip.

    Otherwise: with the sine of the angles, the MCP counting a quarter, about a hood that was in place at a PIP of 30°.
    """
    moved = size[0] * (0.9 * (np.sin(s.angles[2]) - 0.5) + 0.25 * np.sin(s.angles[0]))
    fraction = dict(s.finger.fraction)
    for muscle, sign in (("RI", -1.0), ("LU", -1.0), ("UI", -1.0), ("EDC", 1.0)):
        fraction[f"{muscle}_ES"] = float(np.clip(fraction[f"{muscle}_ES"] + sign * moved, 0.0, 1.0))
    s.finger.fraction = fraction


@CATALOGUE.enter("sharing", "1", 0.0, 1.0)
def lumbrical_on_fdp(s: Situation, size: Floats, shape: Floats) -> None:
    """The lumbrical hangs on FDP and takes its pull from FDP's tension beyond.

    Otherwise: an elastic junction, exp(-λ T_LU / T_FDP), so FDP slackens gradually and never falls below slack.
    """
    fdp, lumbrical = s.pull[_FDP], s.pull[MUSCLES.index("LU")]
    if fdp > 0.0:
        s.tension = np.where(s.finger.of("FDP"), s.tension * np.exp(-size[0] * lumbrical / fdp), s.tension)


@CATALOGUE.enter("sharing", "1", 0.0, 0.3)
def fdp_fds_coupling(s: Situation, size: Floats, shape: Floats) -> None:
    """Adhesions pass part of FDP's tension to FDS distal to the MCP.

    Otherwise: an adhesion stretches: what passes saturates at 5 N (tanh), so a heavy load passes a smaller share.
    """
    fdp, fds = s.finger.of("FDP", joint="PIP"), s.finger.of("FDS", joint="PIP")
    passed = 5.0 * np.tanh(size[0] * float(s.tension[fdp][0]) / 5.0)
    beyond = s.finger.joint > JOINTS.index("MCP")
    s.tension = s.tension + passed * (fds * 1.0 - (s.finger.of("FDP") & beyond) * 1.0)


@CATALOGUE.enter("sharing", "1", 0.0, 0.2)
def sheath_friction(s: Situation, size: Floats, shape: Floats) -> None:
    """Capstan loss of both flexors along their sheath; the metacarpal keeps the full tension.

    Otherwise: the path is made of arcs: all of the bends of the joints before, half of the joint's own bend, and 3° of
    the sheath's own curvature at each pulley, whatever the tendon points are.
    """
    bend = np.abs(s.angles[[0, 2, 3]]) + np.deg2rad(3.0)
    until = np.cumsum(bend) - 0.5 * bend
    passed = np.exp(-size[0] * until)[s.finger.joint]
    s.tension = np.where(s.finger.of("FDP", "FDS"), s.tension * passed, s.tension)
