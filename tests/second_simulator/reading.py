"""What a rig reads in each case without noise: from the weights along the tendons to the cell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

# Importing them enters their effects.
from tests.second_simulator import bone_effects, cell_effects, joint_effects, outside, tendon_effects  # noqa: F401
from tests.second_simulator.finger import (
    JOINTS,
    MUSCLES,
    Floats,
    cross,
    held_at_tip,
    joint_torques,
    placed,
    routed,
    shared,
)
from tests.second_simulator.rig import Rig
from tests.second_simulator.situation import DRIFTS, Case, Situation, act

GRAVITY, TENSION_FACTOR = 9.81, 0.835
RATE_HZ = 25.0
_ROUNDS = 40
_LAST_MOVE = 1e-7


def read(rig: Rig, case: Case, caught: bool = False) -> Floats:
    """What the cell reads of one load, without noise and drift (6,) [N, N mm].

    Args:
        rig: with the specimen and what acts.
        case: of its protocol.
        caught: whether a weight that touches something in this case does so already.
    """
    stated = rig.plan.postures_deg[case.posture]
    s = Situation(
        case=case,
        end_s=rig.plan.end_s,
        caught=caught,
        masses_g=dict(case.masses_g),
        finger=rig.finger.copy(),
        flexion=np.radians([stated[j] for j in JOINTS]) + rig.angle_error[case.posture, case.setting],
        abduction=float(np.radians(stated["abduction"])),
    )
    act("mass", s, rig.acting)
    for m in MUSCLES:
        s.pull[m] = s.masses_g.get(m, 0.0) / 1000.0 * GRAVITY * TENSION_FACTOR * rig.passes[m]
    act("tension", s, rig.acting)
    act("posture", s, rig.acting)
    _settle(rig, s)
    act("clamp", s, rig.acting)
    *force, about_z = held_at_tip(s.bones, s.torque)
    s.force, s.moment[2] = np.array(force), about_z
    if case.location == "bone":
        pulled = np.sum([s.pull[m] * s.suture[m] for m in MUSCLES], axis=0)
        s.force, s.moment = pulled - s.bones.distal_phalanx @ s.force, np.zeros(3)
    _through_the_cell(rig, s)
    return np.concatenate([s.force, s.moment])


def _settle(rig: Rig, s: Situation) -> None:
    """Find the posture under load: it depends on the torques, and they on it."""
    at_rest = s.flexion
    for n in range(_ROUNDS):
        _carry(rig, s)
        s.give = np.zeros(3)
        act("give", s, rig.acting)
        yielded = at_rest + s.give
        if np.abs(yielded - s.flexion).max() < _LAST_MOVE or n == _ROUNDS - 1:
            return
        s.flexion = 0.5 * s.flexion + 0.5 * yielded if n > 3 else yielded


def _carry(rig: Rig, s: Situation) -> None:
    """Follow the tendons from the metacarpal to the joint torques, in the posture as it is."""
    s.finger = rig.finger.copy()
    act("geometry", s, rig.acting)
    s.bones = placed(s.finger, s.flexion, s.abduction)
    s.tension = {(m, "MCP"): s.pull[m] for m in MUSCLES}
    s.tension |= {("FDP", "PIP"): s.pull["FDP"], ("FDP", "DIP"): s.pull["FDP"], ("FDS", "PIP"): s.pull["FDS"]}
    act("sharing", s, rig.acting)
    s.tension |= shared(s.finger.fraction, s.pull)
    act("lift", s, rig.acting)
    s.lines = routed(s.finger, s.bones, s.flexion)
    act("path", s, rig.acting)
    s.torque = joint_torques(s.bones, s.lines, s.tension)
    act("torque", s, rig.acting)


def _through_the_cell(rig: Rig, s: Situation) -> None:
    mounting, gain = rig.mounting[s.case.location, s.case.mounting], rig.gain[s.case.location]
    act("held", s, rig.acting)
    if s.case.location == "tip":
        s.moment = s.moment - cross(mounting.offset, s.force)
    turn = mounting.turn @ s.turn
    s.force, s.moment = turn @ s.force, turn @ s.moment
    act("cell", s, rig.acting)
    s.force, s.moment = s.force * gain[:3] + mounting.zero, s.moment * gain[3:]
    act("zero", s, rig.acting)


def wander(rig: Rig, t_s: Floats) -> Floats:
    """What the clock adds to the forces (n, 3) [N]."""
    share = np.asarray(t_s, dtype=float)[:, None] / rig.plan.end_s
    out = rig.creep * share
    for a in rig.acting.values():
        if a.form in DRIFTS:
            out = out + a.size * DRIFTS[a.form](share)
    return out


@dataclass(frozen=True)
class Loads:
    """What a rig reads without noise.

    Attributes:
        held: (cases, 6) while the load hangs freely; caught: once the weight touches something.
        wrench: (cases, 6) mean of the loaded window less the tare's, drift included.
    """

    held: Floats
    caught: Floats
    wrench: Floats


def read_cases(rig: Rig) -> Loads:
    """Read the loads of the whole protocol."""
    held, caught, wrench = [], [], []
    for case in rig.plan.cases:
        free = touching = read(rig, case)
        loaded, tare = _samples(case.loaded_s), _samples(case.unloaded_s)
        mean = free.copy()
        if (share := outside.caught_share(rig.acting, case, loaded)) is not None:
            touching = read(rig, case, caught=True)
            mean = free + share.mean() * (touching - free)
        mean[:3] += wander(rig, loaded).mean(axis=0) - wander(rig, tare).mean(axis=0)
        held.append(free)
        caught.append(touching)
        wrench.append(mean)
    return Loads(np.array(held), np.array(caught), np.array(wrench))


def _samples(window: tuple[float, float]) -> Floats:
    """Times of the readings in a window."""
    return np.arange(np.ceil(window[0] * RATE_HZ) / RATE_HZ, window[1] + 1e-9, 1.0 / RATE_HZ)
