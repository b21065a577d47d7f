"""A measured session as arrays: what was set, what was read, and the covariance of what was read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.errors import ModelError, SessionError
from daq.measured import MeasuredSession
from daq.sessions import Session
from fingermodel.budget import Budget
from fingermodel.comparison.reading_noise import Noise, noise_of
from fingermodel.fingers import Finger, Topology
from fingermodel.model import jax_values, straight
from fingermodel.stages import Layout, LoadCaseInput

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Observations:
    """The cases of a session, in order, then its checks with known weights.

    Attributes:
        ids: (n,) of the cases; checks are `check0`, ….
        roles: (n,) identification, validation or check.
        postures: (n,) names.
        locations: (n,) tip or bone.
        masses_g: (n,) of each case.
        inputs: what the model needs, batched over n.
        wrench: (n, 6) measured [N, N mm]; NaN where not read.
        noise: covariance of the wrench, without the case-to-case scatter of friction.
        layout: settings and mountings.
        noise_assumed: whether any case states no uncertainty of its own, so that the budget's stands in.
        tared: (n, 6) what was taken from each reading as its tare [N, N mm].
        to_other_mount: (n, 6, 6) makes of a reading what it is if the cell was at the other mount.
        session: id of the session.
    """

    ids: tuple[str, ...]
    roles: tuple[str, ...]
    postures: tuple[str, ...]
    locations: tuple[str, ...]
    masses_g: tuple[dict[str, float], ...]
    inputs: LoadCaseInput
    wrench: Floats
    noise: Noise
    layout: Layout
    noise_assumed: bool
    tared: Floats = field(default_factory=lambda: np.zeros((0, 6)), repr=False)
    to_other_mount: Floats = field(default_factory=lambda: np.zeros((0, 6, 6)), repr=False)
    session: str = ""

    def __post_init__(self) -> None:
        if not self.tared.size:
            object.__setattr__(self, "tared", np.zeros((len(self.ids), 6)))
        if not self.to_other_mount.size:
            object.__setattr__(self, "to_other_mount", np.tile(np.eye(6), (len(self.ids), 1, 1)))

    @property
    def posture_angles(self) -> dict[str, Floats]:
        """Angles (rotations,) [rad] of each posture in use."""
        angles = np.asarray(self.inputs.posture)
        return {name: angles[self.postures.index(name)] for name in dict.fromkeys(p for p in self.postures if p)}

    @cached_property
    def case_covariance(self) -> Floats:
        """(n, 6, 6) blocks of the covariance, one a case."""
        return self.noise.blocks

    @cached_property
    def shared_tares(self) -> Floats:
        """(6 n, k) columns whose sum of squares is what cases share that were measured against one tare."""
        return self.noise.tares

    def where(self, role: str) -> NDArray[np.intp]:
        """Indices of the cases of one role."""
        return np.flatnonzero(np.array(self.roles) == role)


def layout_of(measured: MeasuredSession) -> Layout:
    """Collect the settings of postures and mountings of the cell, in order of first use."""
    settings: dict[tuple[str, int], None] = dict.fromkeys((m.case.posture, m.case.setting) for m in measured.cases)
    mountings: dict[tuple[str, int], None] = dict.fromkeys(
        (str(m.case.location), m.case.mounting) for m in measured.cases
    )
    mountings |= dict.fromkeys((str(c.mount), c.mounting) for c in measured.checks)
    return Layout(tuple(settings), tuple((str(a), b) for a, b in mountings))


def posture_rad(topology: Topology, degrees: Mapping[str, Any], where: str) -> Floats:
    """Return a posture (rotations,) [rad] from degrees by name; rotations that it does not name are 0.

    Raises:
        SessionError: an angle that the finger has no joint for.
    """
    unknown = sorted(set(degrees) - set(topology.rotations))
    if any(degrees[name] for name in unknown):
        raise SessionError(
            f"{where} sets {', '.join(unknown)}", f"angles of {', '.join(topology.rotations)}", "Choose another finger"
        )
    return np.deg2rad(np.array([float(degrees.get(name, 0.0)) for name in topology.rotations]))


def observe(measured: MeasuredSession, finger: Finger, budget: Budget) -> Observations:
    """Turn a measured session into arrays for a finger.

    Raises:
        SessionError: a posture or tendon that the finger does not have, or no case left.
    """
    session, topology = measured.session, finger.topology
    require_usable(session, finger)
    layout = layout_of(measured)
    postures = {
        name: posture_rad(topology, posture.model_dump(), f"posture {name}")
        for name, posture in session.postures_deg.items()
    }
    weight = session.gravity_m_s2 * 1e-3 * measured.tension_factor
    tension = np.zeros((len(measured.cases) + len(measured.checks), len(topology.muscles)))
    for i, m in enumerate(measured.cases):
        for muscle, mass in m.case.masses_g.items():
            tension[i, topology.muscles.index(muscle)] = mass * weight
    n, k = len(measured.cases), len(measured.checks)
    posture = np.zeros((n + k, len(topology.rotations)))
    posture[:n] = [postures[m.case.posture] for m in measured.cases]
    if k:
        posture[n:] = posture[0]
    known = np.zeros((n + k, 3))
    locations = [str(m.case.location) for m in measured.cases] + [str(c.mount) for c in measured.checks]
    mountings = [layout.mountings.index((str(m.case.location), m.case.mounting)) for m in measured.cases]
    for i, check in enumerate(measured.checks):
        known[n + i] = check.force_N
        mountings.append(layout.mountings.index((str(check.mount), check.mounting)))
    wrench = np.array([m.wrench for m in measured.cases] + [c.wrench for c in measured.checks]).reshape(-1, 6)
    spread = np.diag([budget.reading_sd_N**2] * 3 + [(budget.reading_sd_N * 10.0) ** 2] * 3)
    since_tare, elapsed = _clock(measured)
    inputs = LoadCaseInput.batch(
        posture=posture,
        tension=tension,
        at_bone=[x == "bone" for x in locations],
        known_force=known,
        is_check=[False] * n + [True] * k,
        setting=[layout.settings.index((m.case.posture, m.case.setting)) for m in measured.cases] + [0] * k,
        mounting=mountings,
        weight=[weight] * n + [0.0] * k,
        unloading=[m.case.direction == "unloading" for m in measured.cases] + [False] * k,
        since_tare=[*since_tare, *[0.0] * k],
        elapsed=[*elapsed, *[0.0] * k],
    )
    return Observations(
        ids=tuple(m.case.id for m in measured.cases) + tuple(f"check{i}" for i in range(k)),
        roles=tuple(str(m.case.role) for m in measured.cases) + ("check",) * k,
        postures=tuple(m.case.posture for m in measured.cases) + ("",) * k,
        locations=tuple(locations),
        masses_g=tuple({k: float(v) for k, v in m.case.masses_g.items()} for m in measured.cases) + ({},) * k,
        inputs=inputs,
        wrench=wrench,
        noise=noise_of(measured, spread),
        layout=layout,
        noise_assumed=any(not m.noise_stated for m in measured.cases),
        tared=_tared(measured, n + k),
        to_other_mount=np.array([m.to_other_mount for m in measured.cases] + [np.eye(6)] * k).reshape(-1, 6, 6),
        session=session.id,
    )


def _tared(measured: MeasuredSession, count: int) -> Floats:
    """What was taken from each reading as its tare (count, 6) [N, N mm]; nothing from the checks."""
    out = np.zeros((count, 6))
    if measured.tares:
        out[: len(measured.cases)] = measured.tare_weights @ np.array([t.mean for t in measured.tares])
    return out


def _clock(measured: MeasuredSession) -> tuple[Floats, Floats]:
    """Time since the tare and since the start of each case, as shares of the session; 0 where no time is known."""
    loaded = np.array([np.nan if m.loaded_mid_s is None else m.loaded_mid_s for m in measured.cases])
    tared = np.array([t.mid_s for t in measured.tares])
    before = np.array([np.nan if m.unloaded_mid_s is None else m.unloaded_mid_s for m in measured.cases])
    timed = np.isfinite(loaded) & np.isfinite(before)
    if not timed.any():
        return np.zeros(len(loaded)), np.zeros(len(loaded))
    start = float(before[timed].min())
    length = max(float(loaded[timed].max()) - start, 1e-9)
    # A case between two tares has a steady drift taken out already.
    since = loaded - measured.tare_weights @ tared
    return np.where(timed, since, 0.0) / length, np.where(timed, loaded - start, 0.0) / length


def require_usable(session: Session, finger: Finger) -> None:
    """Refuse a session that no model with this finger could predict, without looking at its readings.

    Raises:
        SessionError: no case left, a joint or a tendon that the finger lacks.
        ModelError: a posture that leaves the tip force undetermined.
    """
    cases = [c for c in session.cases if c.excluded is None]
    if not cases:
        raise SessionError("no load case left", "at least one that is not excluded")
    topology = finger.topology
    for case in cases:
        for muscle in case.masses_g:
            if muscle not in topology.muscles:
                known = ", ".join(topology.muscles)
                raise SessionError(
                    f"case {case.id} loads {muscle}",
                    f"one of {known} ({finger.id})",
                    "Choose a finger with these tendons",
                )
    used = dict.fromkeys(c.posture for c in cases)
    require_determined(
        finger,
        {name: posture_rad(topology, session.postures_deg[name].model_dump(), f"posture {name}") for name in used},
    )


def require_determined(finger: Finger, postures: Mapping[str, Floats]) -> None:
    """Refuse a posture in which the tip force is not determined.

    Raises:
        ModelError: naming the posture.
    """
    batch = np.array(list(postures.values())).reshape(-1, len(finger.topology.rotations))
    bad = np.flatnonzero(straight(finger.topology, jax_values(finger.values), batch))
    if len(bad):
        raise ModelError(
            f"posture {[*postures][bad[0]]} leaves the finger straight: joint torques do not determine the tip force",
            "flexion of at least one interphalangeal joint",
            "Exclude its cases or correct its angles",
        )
