"""How plainly a change of the readings shows beside noise, scatter and the budget of every rig.

By the plain finger of `tests/simulator`, linear in the loads and in the budget's small errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tests.random_worlds.protocols import Plan
from tests.simulator.finger import (
    MUSCLES,
    ROTATIONS,
    Finger,
    Floats,
    Pose,
    clamped,
    cross,
    fraction_widths,
    moment_arms,
    pose,
    read_numbers,
    rhombus,
)
from tests.simulator.rig import GRAVITY

# Components that a clamp carries: of the tip Fx, Fy, Fz and Mz, of the bone the forces.
_USED = {"tip": [0, 1, 2, 5], "bone": [0, 1, 2]}
_POINT_MM = np.array([1.8, 0.6, 0.6])
_ZERO_N = {"tip": 0.015, "bone": 0.02}
_PULLEY, _GAIN, _ANGLE, _TURN, _OFFSET_MM = 0.012, 0.004, np.deg2rad(1.0), np.deg2rad(0.6), 2.0
# What a plateau's mean is uncertain by beside its noise: the zero's wandering and the cell's steps [N].
_LEAST_N, _TORQUE_MM = 0.002, 6.7


def plain_finger(scale: float) -> Finger:
    """The published finger, all lengths times `scale`."""
    f = read_numbers()
    return replace(
        f,
        centre=f.centre * scale,
        proximal=f.proximal * scale,
        distal=f.distal * scale,
        load_point=f.load_point * scale,
    )


@dataclass(frozen=True)
class Stance:
    """A posture of the plain finger.

    Attributes:
        angles: (4,) [rad].
        posed: where its bones are.
        held: (4, 4) from joint torques to Fx, Fy, Fz and Mz at the tip.
    """

    angles: Floats
    posed: Pose
    held: Floats

    @classmethod
    def of(cls, finger: Finger, angles: Floats) -> Stance:
        """Pose a finger in angles (4,) [rad]."""
        posed = pose(finger, angles)
        tips = [clamped(finger, posed, np.zeros(len(MUSCLES)), torque)[0] for torque in np.eye(4)]
        return cls(angles, posed, np.array(tips).T[_USED["tip"]])


def per_newton(finger: Finger, stance: Stance) -> dict[str, Floats]:
    """Readings (6, muscles) of a newton on each tendon by location."""
    hood = [rhombus(finger.fraction, pull) for pull in np.eye(len(MUSCLES))]
    slips = np.array([[shares[name] for shares in hood] for name in finger.slips])
    tip, bone = np.zeros((6, 6)), np.zeros((6, 6))
    tip[_USED["tip"]] = stance.held @ moment_arms(finger, stance.posed, stance.angles) @ slips
    bone[:3] = finger.suture.T - stance.posed.turn[3] @ tip[:3]
    return {"tip": tip, "bone": bone}


def pulls(plan: Plan) -> Floats:
    """Tensions (cases, 6) [N] as stated."""
    mass = np.array([[c.masses_g.get(m, 0.0) for m in MUSCLES] for c in plan.cases])
    return mass * 1e-3 * GRAVITY * plan.tension_factor


def stated_angles(plan: Plan, posture: str) -> Floats:
    """Angles (4,) of a posture [rad]."""
    return np.deg2rad([plan.postures_deg[posture][r] for r in ROTATIONS])


@dataclass(frozen=True)
class Noise:
    """What a reading is uncertain by.

    Attributes:
        reading_N: white noise of one reading of force, Gaussian.
        case_N: scale of what is added to each case's force as a whole.
        dof: degrees of freedom of what is added; none where it is Gaussian.
        scatter: share by which each tendon's tension differs from case to case.
    """

    reading_N: float
    case_N: float
    dof: int | None
    scatter: float


class Visibility:
    """Standard uncertainties of a protocol's readings, all that is known of the rig counted.

    Args:
        plan: protocol.
        scale: of the finger's lengths.
        noise: of the readings.
        budget: multiple of the budget of every rig.
        held: (cases, 6) what the cell reads where nothing is hidden [N, N mm]; by default of the plain finger. A cell
            errs by its readings, however the finger made them.
    """

    def __init__(self, plan: Plan, scale: float, noise: Noise, budget: float, held: Floats | None = None) -> None:
        self._plan, self._finger = plan, plain_finger(scale)
        self._pulls = pulls(plan)
        self._at = [(i, k) for i, c in enumerate(plan.cases) for k in _USED[c.location]]
        self._rows = ([i for i, _ in self._at], [k for _, k in self._at])
        self.fitted: NDArray[np.bool_] = np.array([plan.cases[i].role == "identification" for i, _ in self._at])
        postures = {c.posture: Stance.of(self._finger, stated_angles(plan, c.posture)) for c in plan.cases}
        self._maps = {n: per_newton(self._finger, a) for n, a in postures.items()}
        self.plain = self._readings(self._maps)
        self._held = self.plain if held is None else held
        jacobian = budget * np.column_stack([c[self._rows] for c in self._budget(postures)])
        self._covariance = self._noise(noise) + jacobian @ jacobian.T

    def sds(self, change: Floats, beside: Sequence[Floats] = (), everywhere: bool = False) -> float:
        """How many standard uncertainties a change of the readings is in all.

        Args:
            change: (cases, 6).
            beside: changes of other things whose sizes are not known.
            everywhere: whether the validation cases count too.
        """
        chosen = np.ones(len(self._at), dtype=bool) if everywhere else self.fitted
        factor = np.linalg.cholesky(self._covariance[np.ix_(chosen, chosen)])
        white = np.linalg.solve(factor, change[self._rows][chosen])
        if beside:
            others = np.linalg.solve(factor, np.column_stack([b[self._rows][chosen] for b in beside]))
            others /= np.maximum(np.linalg.norm(others, axis=0), 1e-9)
            white = white - others @ np.linalg.lstsq(others, white, rcond=1e-6)[0]
        return float(np.linalg.norm(white))

    def expected(self, posture: str, location: str, masses_g: dict[str, float]) -> Floats:
        """Reading (6,) of the plain finger."""
        mass = np.array([masses_g.get(m, 0.0) for m in MUSCLES])
        out: Floats = self._maps[posture][location] @ (mass * 1e-3 * GRAVITY * self._plan.tension_factor)
        return out

    def _readings(self, maps: dict[str, dict[str, Floats]]) -> Floats:
        each = zip(self._plan.cases, self._pulls, strict=True)
        return np.array([maps[c.posture][c.location] @ pull for c, pull in each])

    def _budget(self, postures: dict[str, Stance]) -> list[Floats]:
        """Changes (cases, 6) of one standard deviation of each small error."""
        f, plain = self._finger, self.plain

        def moved(finger: Finger) -> Floats:
            return self._readings({n: per_newton(finger, a) for n, a in postures.items()}) - plain

        out = []
        for k, joint in enumerate(f.joint):
            for axis, share in enumerate((1.0, 1.0, 0.5)):
                step = np.zeros((len(f.joint), 3))
                step[k, axis] = share * _POINT_MM[joint]
                out += [moved(replace(f, proximal=f.proximal + step)), moved(replace(f, distal=f.distal + step))]
        for name, width in fraction_widths().items():
            sd = 0.15 if width is None else width
            if sd > 0.0:
                fraction = {**f.fraction, name: f.fraction[name] - 0.1}
                out.append(moved(replace(f, fraction=fraction)) * sd / 0.1)
        return out + self._angles(postures) + self._instrument()

    def _angles(self, postures: dict[str, Stance]) -> list[Floats]:
        out = []
        for name, setting in dict.fromkeys((c.posture, c.setting) for c in self._plan.cases):
            chosen = np.array([(c.posture, c.setting) == (name, setting) for c in self._plan.cases])
            for k in range(len(ROTATIONS)):
                stance = Stance.of(self._finger, postures[name].angles + _ANGLE * np.eye(4)[k])
                there = {**self._maps, name: per_newton(self._finger, stance)}
                out.append((self._readings(there) - self.plain) * chosen[:, None])
        return out

    def _instrument(self) -> list[Floats]:
        held, cases, one = self._held, self._plan.cases, np.eye(3)
        out = []
        for m in range(len(MUSCLES)):
            only = np.zeros(len(MUSCLES))
            only[m] = _PULLEY
            maps = {n: {place: a * only for place, a in by.items()} for n, by in self._maps.items()}
            out.append(self._readings(maps))
        out += [held * _GAIN * np.eye(6)[k] for k in range(6)]
        for location in _USED:
            here = np.array([c.location == location for c in cases])[:, None]
            force, torque = held[:, :3] * here, held[:, 3:] * here
            for k in range(3):
                turned = [cross(np.broadcast_to(one[k], x.shape), x) for x in (force, torque)]
                out.append(np.concatenate(turned, axis=1) * _TURN)
                out.append(np.concatenate([here * one[k], np.zeros_like(torque)], axis=1) * _ZERO_N[location])
                shifted = -cross(np.broadcast_to(one[k], force.shape), force) * _OFFSET_MM
                out.append(np.concatenate([np.zeros_like(force), shifted], axis=1))
        return out

    def _noise(self, noise: Noise) -> Floats:
        """Covariance of the rows: plateau, tare, case and scatter."""
        rows, components = self._rows
        out = np.zeros((len(rows), len(rows)))
        for i, case in enumerate(self._plan.cases):
            n = 25.0 * np.array([case.loaded_s[1] - case.loaded_s[0], case.unloaded_s[1] - case.unloaded_s[0]])
            sd = np.sqrt(noise.reading_N**2 * float((1.0 / n).sum()) + noise.case_N**2 + _LEAST_N**2)
            white = np.diag((sd * np.array([1.0] * 3 + [_TORQUE_MM] * 3)) ** 2)
            parts = self._maps[case.posture][case.location] * self._pulls[i] * noise.scatter
            here = [r for r, j in enumerate(rows) if j == i]
            used = [components[r] for r in here]
            out[np.ix_(here, here)] = (white + parts @ parts.T)[np.ix_(used, used)]
        return out
