"""A rig with a specimen in it: the small errors that every rig has, and what it reads in each case without noise."""

from __future__ import annotations

import copy
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from tests.simulator.finger import (
    JOINTS,
    MUSCLES,
    ROTATIONS,
    Finger,
    Floats,
    clamped,
    fraction_widths,
    moment_arms,
    pose,
    read_numbers,
    rhombus,
    turning,
)
from tests.simulator.protocols import Protocol
from tests.simulator.situation import Case, Effect, Situation, Stage

GRAVITY = 9.81
_POINT_MM = {"DIP": 0.6, "PIP": 0.6, "MCP": 1.8}
_ZERO_N = {"tip": 0.015, "bone": 0.02}
_OFFSET_MM = {"tip": 2.0, "bone": 0.0}
_LAST_MOVE = 1e-11


@dataclass(frozen=True)
class Mounting:
    """How the cell sits in its clamp.

    Attributes:
        turn: (3, 3) from the mount's axes to the cell's.
        offset: (3,) of the cell's origin from where the model has it, mount's axes [mm].
        zero: (3,) force that the tare missed [N].
    """

    turn: Floats
    offset: Floats
    zero: Floats


@dataclass(frozen=True)
class Acting:
    """An effect with its size (places,) and the eight numbers in ±1 that are the specimen's own."""

    effect: Effect
    size: Floats
    shape: Floats


@dataclass(frozen=True)
class Rig:
    """Everything that stays as it is during a session.

    Attributes:
        finger: the specimen's own numbers.
        pulley: (6,) what each pulley passes against the session's factor.
        angle_error: (4,) by posture and setting: true less stated [rad].
        mounting: by location and number of the mounting.
        gain: (6,) of the cell.
        acting: effects in the order in which they act within a stage.
    """

    finger: Finger
    pulley: Floats
    angle_error: Mapping[tuple[str, int], Floats]
    mounting: Mapping[tuple[str, int], Mounting]
    gain: Floats
    acting: tuple[Acting, ...] = field(default=())

    def with_settings(self, protocol: Protocol, seed: int, scale: float) -> Rig:
        """The same rig with the postures set anew that only a longer protocol has."""
        rng = np.random.default_rng([seed, 7])
        settings = dict.fromkeys((c.posture, c.setting) for c in protocol.cases)
        new = {k: np.deg2rad(1.0) * scale * rng.normal(size=4) for k in settings if k not in self.angle_error}
        return replace(self, angle_error={**self.angle_error, **new})

    def with_effects(self, acting: Iterable[Acting]) -> Rig:
        """The same rig in which these act too."""
        out = copy.copy(self)
        object.__setattr__(out, "acting", (*self.acting, *acting))
        return out


def draw_rig(protocol: Protocol, seed: int, scale: float, finger: str = "an1979_middle") -> Rig:
    """Draw a specimen and its small errors, `scale` times the budget; at 0 it is the finger as its file has it."""
    rng = np.random.default_rng([seed, 1])
    numbers = read_numbers(finger)
    width = scale * np.array([_POINT_MM[JOINTS[j]] for j in numbers.joint])[:, None] * np.array([1.0, 1.0, 0.5])
    numbers.proximal = numbers.proximal + width * rng.normal(size=width.shape)
    numbers.distal = numbers.distal + width * rng.normal(size=width.shape)
    for name, stated in fraction_widths(finger).items():
        numbers.fraction[name] = _within(rng, numbers.fraction[name], scale * (0.15 if stated is None else stated))
    settings = dict.fromkeys((c.posture, c.setting) for c in protocol.cases)
    mountings = dict.fromkeys((c.location, c.mounting) for c in protocol.cases)
    return Rig(
        finger=numbers,
        pulley=1.0 + 0.012 * scale * rng.normal(size=6),
        angle_error={k: np.deg2rad(1.0) * scale * rng.normal(size=4) for k in settings},
        gain=1.0 + 0.004 * scale * rng.normal(size=6),
        mounting={
            k: Mounting(
                turn=turning(np.deg2rad(0.6) * scale * rng.normal(size=3)),
                offset=_OFFSET_MM[k[0]] * scale * rng.normal(size=3),
                zero=_ZERO_N[k[0]] * scale * rng.normal(size=3),
            )
            for k in mountings
        },
    )


def _within(rng: np.random.Generator, centre: float, sd: float) -> float:
    """A normal value between 0 and 1."""
    while True:
        value = float(centre + sd * rng.normal())
        if 0.0 <= value <= 1.0:
            return value


def acting(effect: Effect, size: Floats, seed: int) -> Acting:
    """An effect of this size, with the specimen's own numbers from the seed."""
    shape = np.random.default_rng([seed, 2, zlib.crc32(effect.name.encode())]).uniform(-1.0, 1.0, 8)
    return Acting(effect, size, shape)


def read_cases(rig: Rig, protocol: Protocol) -> Floats:
    """What the cell would read in each case, tare removed, without noise and drift: (cases, 6) [N, N mm]."""
    out = np.empty((len(protocol.cases), 6))
    before, block = np.zeros(4), None
    for i, case in enumerate(protocol.cases):
        if case.block != block:
            before, block = np.zeros(4), case.block
        situation = _loaded(rig, protocol, case, before)
        before = situation.torque
        out[i] = _through_the_cell(rig, situation)
    return out


def wander(rig: Rig, t_s: Floats, end_s: float) -> Floats:
    """What adds to the reading by the clock alone: (n, 6)."""
    out = np.zeros((len(t_s), 6))
    for a in rig.acting:
        if a.effect.wander is not None:
            out[:, :3] += a.effect.wander(t_s, end_s, a.size, a.shape)
    return out


def _loaded(rig: Rig, protocol: Protocol, case: Case, before: Floats) -> Situation:
    """Follow the weights of one case to the clamps."""
    mass = np.array([case.masses_g.get(m, 0.0) for m in MUSCLES])
    stated = np.deg2rad([protocol.postures_deg[case.posture][r] for r in ROTATIONS])
    per_gram = GRAVITY * 1e-3 * protocol.tension_factor
    s = Situation(
        case=case,
        finger=copy.copy(rig.finger),
        angles=stated + rig.angle_error[case.posture, case.setting],
        pull=mass * per_gram,
        hung=np.where(mass > 0.0, 1.0, 0.0),
        newton_per_gram=per_gram,
        end_s=protocol.end_s,
        torque_before=before,
        tension=np.zeros(0),
        torque=np.zeros(4),
        give=np.zeros(4),
        wrench=np.zeros(6),
    )
    _act(rig, "tension", s)
    s.pull = s.pull * rig.pulley
    for stage in ("posture", "geometry", "hood"):
        _act(rig, stage, s)
    slips = rhombus(s.finger.fraction, s.pull)
    s.tension = np.array([slips[name] for name in s.finger.slips])
    _act(rig, "sharing", s)
    at_rest = s.angles
    # The posture under load depends on the torque, and that on the posture: a few rounds settle it.
    for _ in range(40):
        posed = pose(s.finger, s.angles)
        s.torque = moment_arms(s.finger, posed, s.angles) @ s.tension
        _act(rig, "torque", s)
        moved, s.give = s.give, np.zeros(4)
        _act(rig, "give", s)
        if np.abs(s.give - moved).max() < _LAST_MOVE:
            break
        s.angles = at_rest + s.give
    tip, bone = clamped(s.finger, posed, s.pull, s.torque)
    s.wrench = tip if case.location == "tip" else np.concatenate([bone, np.zeros(3)])
    return s


def _act(rig: Rig, stage: Stage, s: Situation) -> None:
    for a in rig.acting:
        if a.effect.stage == stage:
            a.effect.act(s, a.size, a.shape)


def _through_the_cell(rig: Rig, s: Situation) -> Floats:
    _act(rig, "reading", s)
    mounting = rig.mounting[s.case.location, s.case.mounting]
    force, torque = s.wrench[:3], s.wrench[3:] - np.cross(mounting.offset, s.wrench[:3])
    read: Floats = np.concatenate([mounting.turn @ force, mounting.turn @ torque]) * rig.gain
    read[:3] += mounting.zero
    return read
