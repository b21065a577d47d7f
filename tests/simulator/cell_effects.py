"""What may be wrong with the reading: the catalogue's last effects, from the sutures to the cell's zero.

Each is a form of our own: `Otherwise` says how it departs from the plain one.
"""

from __future__ import annotations

import numpy as np

from tests.simulator.finger import Floats, turning
from tests.simulator.situation import CATALOGUE, Effect, Situation

_MATRIX = tuple(f"{a}{b}" for a in "xyz" for b in "xyz")
_MOUNTS = tuple(f"{mount}.{a}" for mount in ("tip", "bone") for a in "xyz")


@CATALOGUE.enter("geometry", "deg", -12.0, 12.0, ("y", "z"))
def suture_angle(s: Situation, size: Floats, shape: Floats) -> None:
    """Tendons leave the metacarpal at an angle to its long axis, towards dorsal (y) and radial (z).

    Otherwise: not all alike: the intrinsics start nearer and leave 10 % steeper, the extensor 15 % less steeply.
    """
    fans = np.array([1.1, 1.1, 1.1, 1.0, 1.0, 0.85])
    up, side = np.deg2rad(size[0]) * fans, np.deg2rad(size[1]) * fans
    s.finger.suture = np.column_stack([np.cos(up) * np.cos(side), np.sin(up) * np.cos(side), np.sin(side)])


@CATALOGUE.enter("reading", "deg", -12.0, 12.0, ("x", "y", "z"))
def cell_rotation(s: Situation, size: Floats, shape: Floats) -> None:
    """The cell's axes are turned against the bone's, forces and moments alike.

    Otherwise: as one turn about one axis, and at the bone up to 10 % of each component less than at the tip or more.
    """
    there = size * (1.0 + 0.1 * shape[:3]) if s.case.location == "bone" else size
    turn = turning(np.deg2rad(there))
    s.wrench = np.concatenate([turn @ s.wrench[:3], turn @ s.wrench[3:]])


@CATALOGUE.enter("reading", "1", -0.1, 0.1, _MATRIX)
def cell_crosstalk(s: Situation, size: Floats, shape: Floats) -> None:
    """A component of the force leaks into another; gains differ.

    Otherwise: slightly cubic: what leaks grows by 10 % at 10 N.
    """
    force = s.wrench[:3]
    leaks = size.reshape(3, 3) @ (force * (1.0 + 0.1 * (force / 10.0) ** 2))
    s.wrench = s.wrench + np.concatenate([leaks, np.zeros(3)])


@CATALOGUE.enter("reading", "N", -0.8, 0.8, _MOUNTS)
def zero_offset(s: Situation, size: Floats, shape: Floats) -> None:
    """A constant force at one mount that the tare missed.

    Otherwise: the fit that catches under load catches 15 % less under the lightest (below a newton or so).
    """
    caught = 1.0 - 0.15 * np.exp(-float(np.linalg.norm(s.wrench[:3])))
    chosen = size[:3] if s.case.location == "tip" else size[3:]
    s.wrench = s.wrench + np.concatenate([chosen * caught, np.zeros(3)])


def _by_the_clock(s: Situation, size: Floats, shape: Floats) -> None:
    """No single case shows it."""


def tare_drift(t_s: Floats, end_s: float, size: Floats, shape: Floats) -> Floats:
    """The zero wanders with the clock, by `size` N over the session.

    Otherwise: an exponential approach, as of a cell that warms up, with 1 to 1.4 of the session's length as its time.
    """
    tau = end_s * (1.2 + 0.2 * shape[0])
    way = (1.0 - np.exp(-t_s / tau)) / (1.0 - np.exp(-end_s / tau))
    out: Floats = way[:, None] * size
    return out


CATALOGUE["tare_drift"] = Effect("tare_drift", "reading", "N", -1.0, 1.0, ("x", "y", "z"), _by_the_clock, tare_drift)
