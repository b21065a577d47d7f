"""Draw a world: a finger, a rig, a protocol, what is hidden in them and what was written down wrongly."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tests.random_worlds.engines import NAMES, Engine, Part, loads
from tests.random_worlds.first_rig import FirstRig, nearest_effect
from tests.random_worlds.laws import Law, draw_law
from tests.random_worlds.protocols import Plan, Rng, draw_plan
from tests.random_worlds.recording import write_document, write_readings
from tests.random_worlds.second_rig import SecondRig
from tests.random_worlds.slips import Slip, as_stated, draw_slips
from tests.random_worlds.visibility import Noise, Visibility, pulls
from tests.second_simulator.reading import TENSION_FACTOR
from tests.simulator.finger import MUSCLES, Floats

_SERIES = 1979
KINDS = {"nothing": 0.25, "one": 0.35, "two": 0.15, "outside": 0.25}
_SLIPS = {0: 0.6, 1: 0.25, 2: 0.1, 3: 0.05}
# Between these numbers of standard uncertainties an effect's size is drawn, evenly in its logarithm.
_SDS = (0.5, 300.0)
# No law changes the readings by more [N, RMS over all force components].
_MOST_N = 1.5


@dataclass(frozen=True)
class World:
    """A session before it is written.

    Attributes:
        plan: protocol.
        engine: the rig.
        parts: what acts, at its size.
        passes: (cases, 6) share of each tension that gets through, from case to case.
        noise: of the readings.
        slips: of the pen.
        scale: of the finger's lengths.
        rng: from which the recording goes on.
        truth: all of it in plain values.
    """

    plan: Plan
    engine: Engine
    parts: tuple[Part, ...]
    passes: Floats
    noise: Noise
    slips: tuple[Slip, ...]
    scale: float
    rng: Rng
    truth: dict[str, Any]


@dataclass(frozen=True)
class Settings:
    """What may be fixed instead of drawn: each none is drawn.

    Attributes:
        engine: first or second simulator's physics.
        kind: nothing, one, two or outside.
        budget: multiple of the budget by which specimen and rig are off.
        scatter: share from case to case.
        slips: how many.
        quiet: whether there is no noise at all.
    """

    engine: str | None = None
    kind: str | None = None
    budget: float | None = None
    scatter: float | None = None
    slips: int | None = None
    quiet: bool = False


def draw_world(seed: Sequence[int], fixed: Settings | None = None) -> World:
    """Draw everything from a seed; what is `fixed` leaves the other draws as they are."""
    fixed = fixed or Settings()
    rng = np.random.default_rng([_SERIES, *seed])
    kind, which = str(rng.choice(list(KINDS), p=list(KINDS.values()))), str(rng.choice(["first", "second"]))
    kind, which = fixed.kind or kind, fixed.engine or which
    budget = float(2.0 ** rng.uniform(-1.0, 2.0))
    budget = budget if fixed.budget is None else fixed.budget
    scale = 1.0 if rng.uniform() < 0.3 else float(np.round(rng.uniform(0.85, 1.15), 3))
    noise = _draw_noise(rng, fixed)
    wanted = 2.0 ** rng.uniform(np.log2(_SDS[0]), np.log2(_SDS[1]), 2)
    count = int(rng.choice(list(_SLIPS), p=list(_SLIPS.values())))
    count = count if fixed.slips is None else fixed.slips
    everywhere = bool(rng.uniform() < 0.1)
    factor = float(np.round(rng.uniform(0.8, 0.92), 3))
    factor = TENSION_FACTOR if which == "second" else factor
    # Where the finger is held to one side, the second simulator's tendons lie on the bone in another way.
    plan = draw_plan(rng, factor, sideways=which == "first")
    made, own, pen = rng.spawn(3)
    engine: Engine = (
        SecondRig(plan, own, budget, scale)
        if which == "second"
        else FirstRig(plan, int(own.integers(2**31)), budget, scale)
    )
    passes = 1.0 + noise.scatter * made.normal(size=(len(plan.cases), len(MUSCLES)))
    visibility = Visibility(plan, scale, _seen(noise), budget, loads(engine, []))
    parts = [_of_size(engine, p, visibility, w) for p, w in zip(_hidden(kind, engine, made), wanted, strict=False)]
    slips = draw_slips(pen, plan, visibility, count, everywhere)
    truth = {"seed": list(seed), "engine": which, "kind": kind, "budget_multiple": budget, "finger_scale": scale}
    truth |= _truth_of_parts(engine, parts, visibility, scale)
    truth |= _truth_of_session(plan, noise, slips)
    return World(plan, engine, tuple(parts), passes, noise, slips, scale, rng, truth)


def write_world(folder: Path, seed: Sequence[int], fixed: Settings | None = None) -> dict[str, Any]:
    """Write a session's folder, and beside its files nothing of the truth, which is returned.

    Args:
        folder: to write into; made where it does not exist.
        seed: numbers that settle everything.
        fixed: what shall not be drawn.

    Returns:
        the truth in plain values, as `write_truth` keeps it.
    """
    return write_drawn(folder, draw_world(seed, fixed))


def write_drawn(folder: Path, world: World) -> dict[str, Any]:
    """The same of a world that is drawn already, which can be written once."""
    folder.mkdir(parents=True, exist_ok=True)
    held = world.engine.read(world.parts, world.passes)
    write_readings(folder, world.plan, held, lambda t: world.engine.wander(world.parts, t), world.noise, world.rng)
    name = "W-" + "-".join(str(s) for s in world.truth["seed"])
    side = "left" if world.truth["engine"] == "second" else "right"
    write_document(folder, world.plan, as_stated(world.plan, world.slips), world.scale, side, name)
    return world.truth


def write_truth(file: Path, truth: dict[str, Any]) -> None:
    """Keep a truth as JSON."""
    file.write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")


def _draw_noise(rng: Rng, fixed: Settings) -> Noise:
    dof = None if rng.uniform() < 0.4 else int(rng.integers(2, 11))
    reading, case = float(rng.uniform(0.02, 0.05)), float(0.002 * 6.0 ** rng.uniform())
    # In one session of five a plateau's own noise is all there is.
    bare = bool(rng.uniform() < 0.5) and dof is None
    scatter = 0.0 if rng.uniform() < 0.3 else float(0.04 * rng.uniform() ** 2)
    scatter = scatter if fixed.scatter is None else fixed.scatter
    if fixed.quiet:
        return Noise(0.0, 0.0, None, scatter)
    return Noise(reading, 0.0 if bare else case, dof, scatter)


def _seen(noise: Noise) -> Noise:
    """For what shows, tails count by the standard deviation that they have, or would have with three degrees."""
    heavier = 1.0 if noise.dof is None else float(np.sqrt(max(noise.dof, 3) / (max(noise.dof, 3) - 2.0)))
    return replace(noise, case_N=noise.case_N * heavier)


def _hidden(kind: str, engine: Engine, rng: Rng) -> list[Part]:
    """What is hidden, at its largest."""
    if kind == "outside":
        tension = pulls(engine.plan)
        full = dict(zip(MUSCLES, np.maximum(tension.max(axis=0), 0.1).tolist(), strict=True))
        return [draw_law(rng, {**full, "all": float(tension.sum(axis=1).max())})]
    count = {"nothing": 0, "one": 1, "two": 2}[kind]
    return [engine.drawn(str(name), rng) for name in rng.permutation(NAMES)[:count]]


def _of_size(engine: Engine, part: Part, visibility: Visibility, wanted: float) -> Part:
    """Bring it to the wanted number of standard uncertainties, or as near as its own range allows."""
    without = loads(engine, [])
    share, reached = 1.0, _changed(engine, part, without, visibility)
    for _ in range(6):
        if abs(reached[0] - wanted) < 0.1 * wanted and reached[1] <= _MOST_N:
            break
        most = min(wanted / max(reached[0], 1e-9), 0.9 * _MOST_N / max(reached[1], 1e-9))
        new = min(share * float(np.clip(most, 1e-3, 10.0)), 1.0)
        if new == share:
            break
        share = new
        reached = _changed(engine, engine.sized(part, share), without, visibility)
    return engine.sized(part, share)


def _changed(engine: Engine, part: Part, without: Floats, visibility: Visibility) -> tuple[float, float]:
    change = loads(engine, [part]) - without
    return visibility.sds(change), _rms(change)


def _rms(change: Floats) -> float:
    return float(np.sqrt(np.mean(change[:, :3] ** 2)))


def _truth_of_parts(engine: Engine, parts: Sequence[Part], visibility: Visibility, scale: float) -> dict[str, Any]:
    """What acts and how it shows: each beside the others, whose sizes nobody knows."""
    together, without = loads(engine, parts), loads(engine, [])
    changes = [together - loads(engine, [q for q in parts if q is not p]) for p in parts]
    acting = []
    for i, part in enumerate(parts):
        name, sizes = engine.said(part)
        others = [c for k, c in enumerate(changes) if k != i]
        acting.append(
            {"name": name, "sizes": sizes, "change_N": _rms(changes[i]), "sds": visibility.sds(changes[i])}
            | {"sds_beside": visibility.sds(changes[i], others)}
        )
    laws = [p for p in parts if isinstance(p, Law)]
    like, unlike = nearest_effect(engine.plan, scale, visibility, changes[0]) if laws else (None, None)
    return {
        "effects": [a["name"] for a, p in zip(acting, parts, strict=True) if not isinstance(p, Law)],
        "outside": bool(laws),
        "law": laws[0].words if laws else None,
        "parts": acting,
        "most_like": like,
        "sds_unlike_catalogue": unlike,
        "change_N": _rms(together - without),
        "sds": visibility.sds(together - without),
    }


def _truth_of_session(plan: Plan, noise: Noise, slips: Sequence[Slip]) -> dict[str, Any]:
    roles = [c.role for c in plan.cases]
    return {
        "cases": roles.count("identification"),
        "unseen": roles.count("validation"),
        "postures": len(plan.postures_deg),
        "at_bone": sum(c.location == "bone" for c in plan.cases),
        "repeats": sum(c.repeat_of is not None for c in plan.cases),
        "scatter_pct": 100.0 * noise.scatter,
        "noise": {k: v for k, v in asdict(noise).items() if k != "scatter"},
        "slips": [
            {"kind": s.kind, "cases": list(s.cases), "change_N": s.change_N, "sds": s.sds}
            | {"fitted": all(c.role == "identification" for c in plan.cases if c.id in s.cases)}
            for s in slips
        ],
    }
