"""What may be wrong with the reading: the catalogue from the sutures to the cell's zero and its drift."""

from __future__ import annotations

import numpy as np

from tests.second_simulator.finger import ALONG, DORSAL, MUSCLES, RADIAL, Floats, cross, turning, turning_by, unit
from tests.second_simulator.situation import Acting, Situation, drift, form

_EYELET_MM = 140.0
_TARES = 16


@form("suture_angle", "posture")
def fan(s: Situation, a: Acting) -> None:
    """A common angle, and all tendons run to one eyelet 140 mm away."""
    up, side = a.size
    for m in MUSCLES:
        _, y, z = s.finger.strands[m, "MCP"].proximal
        s.suture[m] = unit(np.array([1.0, np.tan(up), np.tan(side)]) - np.array([0.0, y, z]) / _EYELET_MM)


@form("suture_angle", "posture")
def spread(s: Situation, a: Acting) -> None:
    """A common angle times some 15 % about one of each tendon's own."""
    for m in MUSCLES:
        up, side = a.size * a.own[m]
        s.suture[m] = unit(np.array([1.0, np.tan(up), np.tan(side)]))


def _shift(s: Situation, way: Floats) -> None:
    if s.case.location == "tip":
        s.moment = s.moment - cross(way, s.force)


@form("tip_location", "held")
def obliquely(s: Situation, a: Acting) -> None:
    """Along a line 11° off the phalanx' axis."""
    _shift(s, a.value * unit(np.array([1.0, np.sign(a.value) * 0.2, 0.0])))


@form("tip_location", "held")
def pulp_yields(s: Situation, a: Acting) -> None:
    """Along the phalanx, less under load, 1/(1 + 0.03 |F|)."""
    _shift(s, a.value / (1.0 + 0.03 * float(np.linalg.norm(s.force))) * ALONG)


def _angles(s: Situation, a: Acting) -> Floats:
    """At the bone a little more or less."""
    return a.size * a.further[0] if s.case.location == "bone" else a.size


@form("cell_rotation", "held")
def one_turn(s: Situation, a: Acting) -> None:
    """As one rotation vector."""
    s.turn = turning_by(_angles(s, a))


@form("cell_rotation", "held")
def three_turns(s: Situation, a: Acting) -> None:
    """As three turns, about x, y and z."""
    x, y, z = _angles(s, a)
    s.turn = turning(ALONG, x) @ turning(DORSAL, y) @ turning(RADIAL, z)


@form("cell_crosstalk", "cell")
def leaks_saturate(s: Situation, a: Acting) -> None:
    """What leaks is C F/(1 + |F|/40 N)."""
    s.force = s.force + a.size @ s.force / (1.0 + np.linalg.norm(s.force) / 40.0)


@form("cell_crosstalk", "cell")
def torques_leak_too(s: Situation, a: Acting) -> None:
    """What leaks is C F, and a little of each torque into the force along it."""
    s.force = s.force + (a.size @ s.force + a.further * s.moment)


@form("zero_offset", "zero")
def constant_offset(s: Situation, a: Acting) -> None:
    """The same in all loaded windows at the mount."""
    if s.case.location == a.at[0]:
        s.force = s.force + a.size


@form("zero_offset", "zero")
def offset_by_tare(s: Situation, a: Acting) -> None:
    """Another one with each tare, some 15 % about the mean."""
    if s.case.location == a.at[0]:
        s.force = s.force + a.size * (1.0 + 0.15 * a.further[s.case.block % _TARES])


@drift("tare_drift")
def warm_up(share: Floats) -> Floats:
    """As a body warms up in half the session, 1 - exp(-t/0.5 T)."""
    out: Floats = (1.0 - np.exp(-share / 0.5)) / (1.0 - np.exp(-2.0))
    return out


@drift("tare_drift")
def power(share: Floats) -> Floats:
    """As (t/T)^0.75."""
    return share**0.75


@drift("tare_drift")
def line_with_swell(share: Floats) -> Floats:
    """As t/T + 0.12 sin(2π t/T)."""
    out: Floats = share + 0.12 * np.sin(2.0 * np.pi * share)
    return out
