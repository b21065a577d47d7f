"""What happens in rigs and is in no catalogue."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tests.second_simulator.finger import (
    DORSAL,
    FLEXIONS,
    RADIAL,
    TO_CENTRAL_SLIP,
    Floats,
    logistic,
    logit,
    softplus,
    turning,
    unit,
)
from tests.second_simulator.situation import Acting, Case, Situation, form

HEAVY_PIECE_G = 500.0
# Posture and spread of the capsules' torques, and how they compare.
_REST, _WIDTH, _CAPSULE = np.array([0.3, 0.7, 0.5]), np.array([0.6, 0.45, 0.5]), np.array([1.0, 0.7, 0.35])
_SHUNT_BY_AXIS = np.array([1.0, 0.6, 0.6])
_CATCHES_S = 0.08


@form("wrong_mcp_order", "geometry")
def axis_left_behind(s: Situation, a: Acting) -> None:
    """The abduction axis stays behind flexion by a share (at 1 it is fixed to the metacarpal), with a small lean."""
    carried = turning(RADIAL, (1.0 - a.value) * float(s.flexion[0]))
    s.finger.abduction_axis = unit(carried @ (DORSAL + a.further * np.array([1.0, 0.0, 0.0])))


@form("force_shunt", "cell")
def screw_past_the_cell(s: Situation, a: Acting) -> None:
    """A screw past the cell takes a share at one mount, 0.6 of it across."""
    if s.case.location == a.at[0]:
        s.force = s.force * (1.0 - a.value * _SHUNT_BY_AXIS)
        s.moment = s.moment * (1.0 - a.value)


@form("passive_joint_torque", "torque")
def capsules(s: Situation, a: Acting) -> None:
    """Capsules pull as sinh((θ - θ0)/w) under load; in the tare the finger is supported."""
    s.torque[FLEXIONS] -= a.value * _CAPSULE * np.sinh((s.flexion - _REST) / _WIDTH)


@form("edc_subluxation", "geometry")
def off_the_knuckle(s: Situation, a: Acting) -> None:
    """EDC slides ulnarly, and half as far palmar, with softplus(sin MCP - 0.05)."""
    slid = a.value * softplus(float(np.sin(s.flexion[0])) - 0.05, 0.08)
    strand = s.finger.strands["EDC", "MCP"]
    way = slid * np.array([0.0, 0.5, 1.0])
    strand.proximal, strand.distal = strand.proximal - way, strand.distal - way


@form("mislabelled_posture", "mass")
def sutures_swapped(s: Situation, a: Acting) -> None:
    """In one posture two sutures are swapped."""
    posture, one, other = a.at
    if s.case.posture == posture:
        swap = {one: other, other: one}
        s.masses_g = {swap.get(m, m): x for m, x in s.masses_g.items()}


@form("seating", "posture")
def slips_once(s: Situation, a: Acting) -> None:
    """At one moment the finger slips in its clamp, and its angles jump."""
    if s.case.middle_s > a.further[0]:
        s.flexion = s.flexion + a.size


@form("ri_edc_sagittal_crosstalk", "sharing")
def sagittal_band(s: Situation, a: Acting) -> None:
    """The sagittal band passes a part of RI, and half of that of UI, to EDC at the MCP."""
    for m, share in (("RI", 1.0), ("UI", 0.5)):
        passed = a.value * s.pull[m] * share
        s.tension[m, "MCP"] -= passed
        s.tension["EDC", "MCP"] += passed


@form("tissue_relaxation", "torque")
def creeps(s: Situation, a: Acting) -> None:
    """Torque decays from when the posture was set."""
    since = s.case.middle_s - s.case.set_s
    s.torque = s.torque * (1.0 - a.value * (1.0 - float(np.exp(-since / a.further[0]))))


@form("hand_gravity", "held")
def hand_hangs(s: Situation, a: Acting) -> None:
    """The hand's weight, by a tilt of the rig that differs with the posture and that the tare does not have."""
    tilt = a.own[s.case.posture]
    weight = a.value * np.array([np.sin(tilt), -np.cos(tilt), 0.15])
    at_tip = s.case.location == "tip"
    s.force = s.force + (0.45 * s.bones.distal_phalanx.T @ weight if at_tip else 0.55 * weight)


@form("suture_catch", "tension")
def knot_catches(s: Situation, a: Acting) -> None:
    """At some moment of a plateau a weight touches, or a knot reaches a pulley, and all tension drops by a share."""
    if s.caught:
        s.pull = {m: pull * (1.0 - a.value) for m, pull in s.pull.items()}


def caught_share(acting: Mapping[str, Acting], case: Case, t_s: Floats) -> Floats | None:
    """How far a weight has caught at these times, none where it never does."""
    catch = acting.get("suture_catch")
    if catch is None or case.id not in catch.own:
        return None
    begins, ends = case.loaded_s
    at = begins + catch.own[case.id] * (ends - begins)
    out: Floats = 1.0 / (1.0 + np.exp(-(t_s - at) / _CATCHES_S))
    return out


@form("bony_stop", "torque")
def osteophyte(s: Situation, a: Acting) -> None:
    """Contact takes a share of a flexing PIP torque beyond 54°."""
    touches = logistic((s.flexion[1] - np.radians(54.0)) / np.radians(3.5))
    s.torque[2] -= a.value * touches * max(float(s.torque[2]), 0.0)


@form("hysteresis", "torque")
def lags(s: Situation, a: Acting) -> None:
    """Soft tissue: the joints' torques times 1 - h on loading, 1 + h on unloading; the tensions are what they are."""
    s.torque = s.torque * (1.0 + a.value if s.unloading else 1.0 - a.value)


@form("web_tether", "torque")
def skin_tether(s: Situation, a: Acting) -> None:
    """Skin takes a share of a torque that abducts radially, past some 2 N mm."""
    s.torque[1] -= a.value * softplus(float(s.torque[1]) - 2.0, 2.0)


@form("wrong_weight", "mass")
def heavy_piece_off(s: Situation, a: Acting) -> None:
    """The 500 g piece, which is in all heavier loads, is not 500 g."""
    s.masses_g = {m: x + (a.value if x >= HEAVY_PIECE_G else 0.0) for m, x in s.masses_g.items()}


@form("slip_at_high_load", "tension")
def sutures_creep(s: Situation, a: Acting) -> None:
    """FDP and FDS lose a share of what exceeds a tension."""
    limit = float(a.further[0])
    for m in ("FDP", "FDS"):
        s.pull[m] -= a.value * (softplus(s.pull[m] - limit, 0.4) - softplus(-limit, 0.4))


@form("band_tightening_with_dip", "sharing")
def bands_tighten(s: Situation, a: Acting) -> None:
    """Fractions move to the bands with DIP flexion, in the logit."""
    for name in TO_CENTRAL_SLIP:
        fraction = s.finger.fraction
        fraction[name] = logistic(logit(fraction[name]) - a.value * (s.flexion[2] - 0.35))


@form("clamp_moment", "clamp")
def clamp_resists_twist(s: Situation, a: Acting) -> None:
    """The clamp carries a share of the abduction torque as moments about x and y."""
    carried = a.value * s.torque[1] * (s.bones.distal_phalanx.T @ s.bones.axis[1])
    s.moment = np.array([carried[0], carried[1], 0.0])
    s.torque[1] *= 1.0 - a.value


@form("gain_drift", "cell")
def gain_creeps(s: Situation, a: Acting) -> None:
    """The gain creeps as (t/T)^0.8."""
    gain = 1.0 + a.value * (s.case.middle_s / s.end_s) ** 0.8
    s.force, s.moment = s.force * gain, s.moment * gain
