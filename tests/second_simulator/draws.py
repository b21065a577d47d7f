"""Draw what is hidden in a session, and write the session that it leads to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from tests.second_simulator.effect_draws import CATALOGUE, Start, draw_effect, draw_starts
from tests.second_simulator.finger import Floats
from tests.second_simulator.protocols import PROTOCOLS
from tests.second_simulator.reading import Loads, read_cases
from tests.second_simulator.recording import record, write_document, write_readings
from tests.second_simulator.rig import Rig, draw_rig
from tests.second_simulator.situation import Acting

Kind = Literal["none", "one", "two", "outside"]
# In the order in which they were written; the seed picks one.
OUTSIDE = (
    "wrong_mcp_order",
    "force_shunt",
    "passive_joint_torque",
    "edc_subluxation",
    "mislabelled_posture",
    "seating",
    "ri_edc_sagittal_crosstalk",
    "tissue_relaxation",
    "hand_gravity",
    "suture_catch",
    "bony_stop",
    "hysteresis",
    "web_tether",
    "wrong_weight",
    "slip_at_high_load",
    "band_tightening_with_dip",
    "clamp_moment",
    "gain_drift",
)
_SERIES = 20261
_OFTEN = {"a": 0.4, "b": 0.35, "c": 0.25}
# How far what is outside the catalogue changes the force components, RMS over all cases [N].
_OUTSIDE_RMS_N = (0.1, 0.35)


@dataclass(frozen=True, eq=False)
class Truth:
    """What a session was made with.

    Attributes:
        kind: what was to be hidden.
        seed: of everything that was drawn.
        protocol: a, b or c.
        budget_factor: specimen and rig are off by this much of the budget.
        effects: names of the catalogue that act.
        outside: name of what acts that is not in the catalogue.
        rms_change_N: by name, what the force components would be otherwise without it, over all cases.
        rms_change_Nmm: the same of the moments.
        wrench: (6,) by case, as a cell without noise reads it, tare before removed [N, N mm].
    """

    kind: Kind
    seed: int
    protocol: str
    budget_factor: float
    effects: tuple[str, ...]
    outside: str | None
    rms_change_N: dict[str, float]
    rms_change_Nmm: dict[str, float]
    wrench: dict[str, Floats]


@dataclass(frozen=True)
class Drawn:
    """A session before it is recorded.

    Attributes:
        truth: what it is made with.
        rig: with what acts.
        loads: what it reads without noise.
        noise_N: of one force reading.
        rng: from which the recording goes on.
    """

    truth: Truth
    rig: Rig
    loads: Loads
    noise_N: float
    rng: np.random.Generator


def draw(kind: Kind, seed: int) -> Drawn:
    """Draw protocol, specimen, rig and what is hidden."""
    rng = np.random.default_rng([_SERIES, get_args(Kind).index(kind), seed])
    protocol = str(rng.choice(list(_OFTEN), p=list(_OFTEN.values())))
    outside = OUTSIDE[seed % len(OUTSIDE)] if kind == "outside" else None
    if outside == "hysteresis":
        # Only this protocol takes weights off.
        protocol = "c"
    plan = PROTOCOLS[protocol](rng)
    budget = float(rng.uniform(0.5, 2.0))
    noise_N = 0.03 if rng.uniform() < 0.5 else float(rng.uniform(0.02, 0.05))
    bare = draw_rig(plan, rng, budget)
    if outside is None:
        acting: Mapping[str, Acting] = {name: draw_effect(name, rng) for name in _chosen(kind, seed, rng)}
    else:
        acting = {outside: _brought_to_size(bare, outside, draw_starts(rng, plan)[outside], rng)}
    rig = bare.with_only(acting)
    loads = read_cases(rig)
    changes = {n: loads.wrench - _wrench(bare, {k: a for k, a in acting.items() if k != n}) for n in acting}
    truth = Truth(
        kind=kind,
        seed=seed,
        protocol=protocol,
        budget_factor=budget,
        effects=tuple(acting) if outside is None else (),
        outside=outside,
        rms_change_N={name: _rms(change[:, :3]) for name, change in changes.items()},
        rms_change_Nmm={name: _rms(change[:, 3:]) for name, change in changes.items()},
        wrench=dict(zip((c.id for c in plan.cases), loads.wrench, strict=True)),
    )
    return Drawn(truth, rig, loads, noise_N, rng)


def write_session(folder: Path, kind: Kind, seed: int) -> Truth:
    """Write `session.yaml` and `readings.csv.gz` of a test in which nothing, one or two effects or another thing act.

    Args:
        folder: to write into; made where it does not exist.
        kind: none, one or two effects of the catalogue, or what is outside it.
        seed: of everything that is drawn; it also picks which one effect or which thing outside.
    """
    drawn = draw(kind, seed)
    folder.mkdir(parents=True, exist_ok=True)
    write_readings(folder, *record(drawn.rig, drawn.loads, drawn.noise_N, drawn.rng))
    write_document(folder, drawn.rig.plan, f"SECOND-{kind}-{seed}")
    return drawn.truth


def _chosen(kind: Kind, seed: int, rng: np.random.Generator) -> list[str]:
    if kind == "one":
        return [CATALOGUE[seed % len(CATALOGUE)]]
    return [str(name) for name in rng.choice(CATALOGUE, 2, replace=False)] if kind == "two" else []


def _wrench(bare: Rig, acting: Mapping[str, Acting]) -> Floats:
    return read_cases(bare.with_only(acting)).wrench


def _brought_to_size(bare: Rig, name: str, start: Start, rng: np.random.Generator) -> Acting:
    """Give it the size whose change of the forces is a drawn one, or as near as its own range allows."""
    begun = start.acting(name)
    if start.most is None:
        return begun
    wanted = rng.uniform(*_OUTSIDE_RMS_N)
    without = _wrench(bare, {})

    def reached(acting: Acting) -> float:
        return _rms((_wrench(bare, {name: acting}) - without)[:, :3])

    if name == "wrong_mcp_order":
        # The change grows ever faster towards a whole share, where a scaled guess would go past.
        tried = [replace(begun, size=np.array([share])) for share in np.linspace(0.35, 1.0, 14)]
        return min(tried, key=lambda acting: abs(np.log(reached(acting) / wanted)))
    for _ in range(6):
        size = begun.size * np.clip(wanted / max(reached(begun), 1e-6), 0.2, 4.0)
        begun = replace(begun, size=size / max(np.abs(size).max() / start.most, 1.0))
    return begun


def _rms(change: Floats) -> float:
    return float(np.sqrt(np.mean(change**2)))
