"""What may be otherwise between the weights and the strands: the catalogue from the hanger to the sheath."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tests.second_simulator.finger import (
    ALONG,
    JOINTS,
    TO_CENTRAL_SLIP,
    Segment,
    angle_between,
    logistic,
    logit,
    softplus,
    unit,
)
from tests.second_simulator.situation import Acting, Situation, form

FLEXORS = {"FDP": JOINTS, "FDS": JOINTS[:2]}
# Which tendon runs on the same axle.
NEIGHBOUR = {"RI": "LU", "UI": "EDC", "FDP": "FDS", "FDS": "FDP", "EDC": "UI"}


@form("hanger_mass", "mass")
def hangers_scatter(s: Situation, a: Acting) -> None:
    """Each tendon's hanger has its own mass, some 8 % about the mean."""
    for m in s.masses_g:
        s.masses_g[m] += 1000.0 * a.value * a.own[m]


@form("hanger_mass", "mass")
def two_hanger_sizes(s: Situation, a: Acting) -> None:
    """The hangers for less than 100 g have 0.8 of the mass."""
    for m, stated in s.case.masses_g.items():
        s.masses_g[m] += 1000.0 * a.value * (1.0 if stated >= 100.0 else 0.8)


def _rubbed(s: Situation, share: Callable[[float], float]) -> None:
    """The friction that was overcome on loading holds the weight up when it is taken off."""
    for m, pull in s.pull.items():
        d = share(pull)
        s.pull[m] = pull * (1.0 / (1.0 + d) if s.unloading else 1.0 + d)


@form("rig_friction", "tension")
def stribeck(s: Situation, a: Acting) -> None:
    """The share rises from 0.75 without load to 1, over 2 N."""
    _rubbed(s, lambda pull: a.value * (1.0 - 0.25 * float(np.exp(-pull / 2.0))))


@form("rig_friction", "tension")
def sticky_bearing(s: Situation, a: Acting) -> None:
    """The share is T / (T + 0.3 N)."""
    _rubbed(s, lambda pull: a.value * (pull / (pull + 0.3)))


@form("worn_pulley", "tension")
def bearing_seizes(s: Situation, a: Acting) -> None:
    """The loss grows with the load, 1.25 w T / (T + 1 N)."""
    pull = s.pull[a.at[0]]
    s.pull[a.at[0]] = pull * (1.0 - a.value * (1.25 * pull / (pull + 1.0)))


@form("worn_pulley", "tension")
def axle_shared(s: Situation, a: Acting) -> None:
    """A constant share, of which the neighbour on the same axle loses a tenth."""
    s.pull[a.at[0]] *= 1.0 - a.value
    s.pull[NEIGHBOUR[a.at[0]]] *= 1.0 - 0.1 * a.value


def _set_fdp(s: Situation, tension: float) -> None:
    for joint in JOINTS:
        s.tension["FDP", joint] = tension


@form("lumbrical_on_fdp", "sharing")
def compliant_belly(s: Situation, a: Acting) -> None:
    """The lumbrical takes λ T_LU (1 - exp(-T_FDP/T_LU)) from FDP, which so never goes slack at once."""
    fdp, lu = s.pull["FDP"], s.pull["LU"]
    if lu > 0.0 and fdp > 0.0:
        _set_fdp(s, fdp - a.value * lu * (1.0 - float(np.exp(-fdp / lu))))


@form("lumbrical_on_fdp", "sharing")
def smooth_slack(s: Situation, a: Acting) -> None:
    """FDP keeps softplus(T_FDP - λ T_LU (1 + 0.2 sin MCP))."""
    fdp, lu = s.pull["FDP"], s.pull["LU"]
    if lu > 0.0 and fdp > 0.0:
        _set_fdp(s, softplus(fdp - a.value * lu * (1.0 + 0.2 * float(np.sin(s.flexion[0]))), 0.05))


def _passed_to_fds(s: Situation, a: Acting, passed: float) -> None:
    """Beyond the MCP; what FDS gives back where adhesions pull both ways is `further`."""
    fdp, fds = s.tension["FDP", "PIP"], s.pull["FDS"]
    back = float(a.further[0]) * fds
    s.tension["FDP", "PIP"] = s.tension["FDP", "DIP"] = fdp - passed + back
    s.tension["FDS", "PIP"] = fds + passed - back


@form("fdp_fds_coupling", "sharing")
def coupling_saturates(s: Situation, a: Acting) -> None:
    """What FDP passes to FDS is κ 7 N tanh(T/7 N)."""
    _passed_to_fds(s, a, a.value * 7.0 * float(np.tanh(s.tension["FDP", "PIP"] / 7.0)))


@form("fdp_fds_coupling", "sharing")
def coupling_by_difference(s: Situation, a: Acting) -> None:
    """FDP passes on what it has more than 0.3 of FDS, κ softplus(T_FDP - 0.3 T_FDS)."""
    more = s.tension["FDP", "PIP"] - 0.3 * s.pull["FDS"]
    _passed_to_fds(s, a, a.value * softplus(more, 0.15) - a.value * softplus(0.0, 0.15))


@form("fdp_fds_coupling", "sharing")
def coupling_tightens(s: Situation, a: Acting) -> None:
    """The share grows with PIP flexion, κ T (0.75 + 0.3 sin PIP)."""
    tight = 0.75 + 0.3 * float(np.sin(max(s.flexion[1], 0.0)))
    _passed_to_fds(s, a, a.value * s.tension["FDP", "PIP"] * tight)


def _by_logit(s: Situation, a: Acting, intrinsic: float) -> None:
    shift = s.flexion[1] - 0.6 + 0.35 * s.flexion[0]
    for name in TO_CENTRAL_SLIP:
        way = 1.0 if name == "EDC_ES" else intrinsic
        s.finger.fraction[name] = logistic(logit(s.finger.fraction[name]) + 3.6 * a.value * way * shift)


@form("hood_shift", "sharing")
def all_to_the_slip(s: Situation, a: Acting) -> None:
    """In the logit, all to the central slip with PIP and a third of the MCP angle."""
    _by_logit(s, a, 1.0)


@form("hood_shift", "sharing")
def opposed(s: Situation, a: Acting) -> None:
    """In the logit, EDC to the central slip and the intrinsics to the bands, by PIP and MCP."""
    _by_logit(s, a, -0.7)


@form("hood_shift", "sharing")
def opposed_by_pip(s: Situation, a: Acting) -> None:
    """Opposed and by PIP alone, a fraction moves by 0.5 tanh((PIP - 0.6)/0.5)."""
    moved = a.value * 0.5 * float(np.tanh((s.flexion[1] - 0.6) / 0.5))
    for name in TO_CENTRAL_SLIP:
        way = 1.0 if name == "EDC_ES" else -0.7
        s.finger.fraction[name] = float(np.clip(s.finger.fraction[name] + moved * way, 0.0, 1.0))


def _capstan(
    s: Situation, friction: Callable[[float], float], turned: Callable[[Segment, float, float], float]
) -> None:
    """Let the flexors rub in their sheath, from the metacarpal's axis to each strand.

    Args:
        s: the situation, with its lines.
        friction: coefficient at a tension.
        turned: angle that counts, of the segment, the path's turns down to it and the last one of them.
    """
    for slip, joints in FLEXORS.items():
        turns, way = 0.0, ALONG
        for before, joint in zip((None, *joints), joints, strict=False):
            line = s.lines[slip, joint]
            if before is not None:
                between = unit(s.lines[slip, before].distal_at - line.proximal_at)
                turns, way = turns + angle_between(way, between), between
            last = angle_between(way, line.proximal_way)
            turns += last
            segment = (slip, joint)
            rubs = friction(s.tension[segment])
            s.tension[segment] *= float(np.exp(-rubs * turned(segment, turns, last)))
            turns, way = turns + angle_between(line.proximal_way, line.distal_way), line.distal_way


@form("sheath_friction", "path")
def real_path(s: Situation, a: Acting) -> None:
    """All turns of the strand's real polyline count."""
    _capstan(s, lambda tension: a.value, lambda segment, turns, last: turns)


@form("sheath_friction", "path")
def boundary_lubrication(s: Situation, a: Acting) -> None:
    """On the real path with a coefficient that falls with the load, 1.15 μ T^-0.12."""
    _capstan(s, lambda tension: a.value * max(tension, 0.1) ** -0.12 * 1.15, lambda segment, turns, last: turns)


@form("sheath_friction", "path")
def up_to_mid_joint(s: Situation, a: Acting) -> None:
    """Half of the last turn counts, and a quarter of the joint's angle."""

    def turned(segment: Segment, turns: float, last: float) -> float:
        return turns - 0.5 * last + 0.25 * abs(float(s.flexion[JOINTS.index(segment[1])]))

    _capstan(s, lambda tension: a.value, turned)
