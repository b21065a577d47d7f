"""Sessions that were compared: ordinary, crowded, and awkward ones."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from fingermodel.comparison.comparison import CaseComparison, Comparison, compare
from fingermodel.comparison.observations import Observations
from fingermodel.comparison.reading_noise import Noise
from fingermodel.fingers import Finger
from fingermodel.fingers.files import read_finger
from fingermodel.model import Model
from fingermodel.stages import Layout, LoadCaseInput

POSTURES = {"hook": (0.0, 65.0, 50.0), "minor_flexion": (40.0, 55.0, 35.0), "hyperextension": (-20.0, 50.0, 45.0)}
SINGLES = {"RI": 650.0, "LU": 45.0, "UI": 500.0, "FDP": 950.0, "FDS": 950.0, "EDC": 400.0}
BOTH = {"FDP": 950.0, "FDS": 950.0}
HOSTILE = "</script><script>alert('x')</script> <b>& $x_1$"


class Row(NamedTuple):
    role: str
    posture: str
    location: str
    masses_g: dict[str, float]


class Session(NamedTuple):
    model: Model
    observations: Observations
    comparison: Comparison


@cache
def finger() -> Finger:
    return read_finger("an1979_middle")


def session(rows: Sequence[Row], *, sd: float = 0.05, scale: float = 1.0, assumed: bool = False) -> Session:
    """A session whose readings are the model's own with noise, and weights scaled."""
    topology, names = finger().topology, list(dict.fromkeys(r.posture for r in rows))
    flexion = {j.name: topology.rotations.index(j.name) for j in topology.joints}
    posture, tension = np.zeros((len(rows), len(topology.rotations))), np.zeros((len(rows), len(topology.muscles)))
    for i, row in enumerate(rows):
        for joint, angle in zip(("MCP", "PIP", "DIP"), POSTURES[row.posture], strict=True):
            posture[i, flexion[joint]] = np.deg2rad(angle)
        for muscle, mass in row.masses_g.items():
            tension[i, topology.muscles.index(muscle)] = scale * mass * 9.81e-3 * 0.835
    at_bone = np.array([float(r.location == "bone") for r in rows])
    count = len(rows)
    setting = np.array([names.index(r.posture) for r in rows])
    unused = np.zeros((count, 3)), np.zeros(count)
    inputs = LoadCaseInput(
        *map(jnp.asarray, (posture, tension, at_bone, *unused, setting, at_bone.astype(int), *[np.zeros(count)] * 4))
    )
    layout = Layout(tuple((n, 0) for n in names), (("tip", 0), ("bone", 0)))
    model = Model(finger(), layout)
    wrench = np.asarray(model.predict(inputs).reading).copy()
    wrench[:, :3] += max(sd, 0.03 * scale) * np.random.default_rng(7).standard_normal((count, 3))
    observations = Observations(
        ids=tuple(f"c{i:03d}" for i in range(count)),
        roles=tuple(r.role for r in rows),
        postures=tuple(r.posture for r in rows),
        locations=tuple(r.location for r in rows),
        masses_g=tuple(r.masses_g for r in rows),
        inputs=inputs,
        wrench=wrench,
        noise=Noise(np.tile(np.diag([sd**2] * 3 + [1.0] * 3), (count, 1, 1))),
        layout=layout,
        noise_assumed=assumed,
    )
    return Session(model, observations, compare(model, observations))


def ordinary_rows(postures: Sequence[str] = tuple(POSTURES)) -> list[Row]:
    rows = []
    for posture in postures:
        rows += [Row("identification", posture, "tip", {m: mass}) for m, mass in SINGLES.items()]
        for level in (0.3, 1.0):
            masses = {m: level * mass for m, mass in BOTH.items()}
            rows += [Row("validation", posture, "tip", masses), Row("validation", posture, "bone", masses)]
    return rows


@cache
def ordinary() -> Session:
    return session(ordinary_rows())


def many_rows() -> list[Row]:
    """96 cases: levels of every tendon and of pairs, a posture with more loads than fit in a panel."""
    loads = [{m: level * mass} for m, mass in SINGLES.items() for level in (0.2, 0.4, 0.6, 1.0)]
    loads += [{"FDP": level * 900, other: level * 300} for other in ("EDC", "LU", "UI", "RI") for level in (0.5, 1.0)]
    rows = [Row("identification", p, "tip", load) for p in POSTURES for load in loads]
    return rows[:96]


def only(keep: Callable[[CaseComparison], bool]) -> Session:
    """The ordinary session with some of its cases."""
    model, observations, comparison = ordinary()
    return Session(model, observations, replace(comparison, cases=tuple(c for c in comparison.cases if keep(c))))


AWKWARD: dict[str, tuple[Callable[[], Session], set[str]]] = {
    "one posture": (lambda: only(lambda c: c.posture == "hook"), set()),
    "no bone": (lambda: only(lambda c: c.location == "tip"), {"bone"}),
    "no validation": (lambda: only(lambda c: c.role == "identification"), {"scatter_validation", "bone"}),
    "one case": (lambda: only(lambda c: c.id == "c007"), {"scatter", "scatter_validation", "vectors"}),
    "many": (lambda: session(many_rows()), {"scatter_validation", "bone"}),
    "tiny": (lambda: session(ordinary_rows(), sd=1e-9, scale=1e-6), set()),
    "no force": (lambda: session([r._replace(masses_g={}) for r in ordinary_rows()], sd=0.0, scale=0.0), {"z"}),
    "assumed": (lambda: session(ordinary_rows(), assumed=True), set()),
}
