"""Population runs: every session refitted with every set of effects, to its readings and to readings drawn anew.

The bootstrap is parametric: the readings that are fitted are drawn about the measured ones from the covariance with
which the fit weighs them: shared tares, and scatter and noise as the readings have them. Cases are not resampled: a
case drawn twice would share its tare with itself, and a session has few cases of each kind. So the spread that comes
out is that of the readings' noise; the errors of the rig, which the fit knows as priors, come on top (the refit's `sd`
has both). Errors are always counted against the readings as they were measured.

Each replicate starts from the fit to the measured readings and frees the same parameters. What it draws follows from
seed, session and number alone, so the sets of effects see the same random numbers, and neither the order nor the place
in which they are computed changes anything.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass

import numpy as np

from daq.plain_json import clean
from fingermodel.comparison.comparison import Comparison, compare
from fingermodel.comparison.observations import Observations
from fingermodel.diagnosis.answer.addition import Recipe
from fingermodel.diagnosis.posterior.hyper import GRIDS
from fingermodel.fitting.fit_report import Fit
from fingermodel.fitting.identification import refit_map
from fingermodel.session import Session
from server.application.additions import add_bench
from server.service.jobs.bench_input import BenchInput
from server.service.jobs.inputs import PopulationInput
from server.service.jobs.population_summary import Result, summarise
from server.service.jobs.worker import Tell
from server.service.sessions.turns import Made

# Benches that a process keeps open between fits.
_open: Made[Session] = Made(8)


@dataclass(frozen=True, eq=False)
class Part:
    """One fit."""

    fingerprint: str  # of the bench
    bench: BenchInput  # session and model
    effects: tuple[str, ...]  # to add
    replicate: int  # 0 for the measured readings
    seed: int  # of the draws
    catalogue: bool  # whether the model shall hold the catalogue, as it does in all fits of a run or in none
    estimate: Result | None = None  # result of replicate 0, from which the others start


def run(payload: PopulationInput, tell: Tell) -> Result:
    """Carry a population run out, only what earlier attempts have not done, and return its summary."""
    prints = {b.id: b.fingerprint for b in payload.benches}
    # What an earlier version has fitted to the measured readings does not say how, or by another grid.
    done = {
        key: part
        for key, part in tell.parts.items()
        if part["fingerprint"] == prints.get(part["session"])
        and (part["replicate"] or part.get("recipe", {}).get("grids") == GRIDS)
    }
    with payload.executor.open() as executor:
        stage = f"{len(payload.benches)} sessions, {len(payload.effects)} sets of effects"
        for replicates in (range(1), range(1, payload.bootstrap + 1)):
            parts = _parts(payload, prints, replicates, done)
            missing = ((key, part) for key, part in parts if key not in done)
            for key, result in executor.map(fit_part, missing):
                tell.part(key, result)
                done[key] = result
                tell(len(done) / payload.fits, stage)
    return summarise(payload.effects, [b.id for b in payload.benches], done, payload.level) | {
        "bootstrap": payload.bootstrap,
        "seed": payload.seed,
        "fits": payload.fits,
    }


def key_of(session: str, effects: int, replicate: int) -> str:
    """Return the key of a fit: session, number of the set of effects, number of the replicate."""
    return f"{session}/{effects}/{replicate}"


def _parts(
    payload: PopulationInput, prints: Mapping[str, str], replicates: range, done: Mapping[str, Result]
) -> Iterator[tuple[str, Part]]:
    """Yield fits with their keys; those of replicates start from an estimate that is done."""
    for bench in payload.benches:
        for number, effects in enumerate(payload.effects):
            for k in replicates:
                estimate = done[key_of(bench.id, number, 0)] if k else None
                part = Part(prints[bench.id], bench, effects, k, payload.seed, payload.catalogue, estimate)
                yield key_of(bench.id, number, k), part


def fit_part(part: Part) -> Result:
    """Carry out one fit, in whatever process."""
    bench = _opened(part)
    if part.estimate is None:
        _, addition, after = add_bench(bench, part.effects, ())
        fit, names = addition.fit, addition.names
        of_estimate = {
            "log_evidence_gain": addition.log_evidence_gain,
            "recipe": asdict(addition.recipe),
        }
    else:
        fit, after = _refitted(bench, part, part.estimate)
        names, of_estimate = tuple(part.estimate["added"]), {"log_evidence_gain": None}
    return _result(part, bench, fit, after) | {"added": list(names)} | of_estimate


def _refitted(bench: Session, part: Part, estimate: Result) -> tuple[Fit, Comparison]:
    observations = drawn(bench, estimate, part.seed, part.bench.id, part.replicate)
    problem = _recipe(estimate).problem(bench.model, observations, held=bench.loaded.added)
    start = problem.centre.copy()
    for name, value in estimate["values"].items():
        start[bench.model.parameters.index[name]] = value
    fit = refit_map(problem, start=start)
    return fit, compare(bench.model, bench.observations, fit.theta)


def _recipe(estimate: Result) -> Recipe:
    kept = estimate["recipe"]
    members = tuple((name, form) for name, form in kept["members"])
    return Recipe(members, tuple(kept["node"]), tuple(kept["bad"]), tuple(kept["about"]))


def drawn(bench: Session, estimate: Result, seed: int, session: str, replicate: int) -> Observations:
    """Draw the readings that are fitted anew, about the measured ones.

    Args:
        bench: with the measured readings.
        estimate: result of replicate 0, which says what errors the readings have.
        seed: of the run.
        session: its id.
        replicate: number of the draw.
    """
    digest = hashlib.sha256(f"{seed}/{session}/{replicate}".encode()).digest()
    rng = np.random.default_rng(int.from_bytes(digest, "big"))
    return _recipe(estimate).drawn(bench.model, bench.observations, rng)


def _result(part: Part, bench: Session, fit: Fit, after: Comparison) -> Result:
    session = bench.measured.session
    effects = [p for p in fit.parameters if p.kind == "effect"]
    out: Result = clean(
        {
            "fingerprint": part.fingerprint,
            "session": session.id,
            "specimen": session.specimen.id,
            "judged_in": bench.model.finger.judged_in,
            "replicate": part.replicate,
            "outcome": fit.outcome,
            "objective": fit.objective,
            "effect_parameters": [p.name for p in effects],
            "units": {p.name: p.unit for p in effects},
            "values": {p.name: p.value for p in fit.parameters},
            "rmse_N": {
                place: {plane: errors["rmse_N"] for plane, errors in planes.items()}
                for place, planes in after.summary().items()
            },
        }
    )
    return out


def _opened(part: Part) -> Session:
    """Open a bench, or take it from those that this process has opened before."""
    return _open.of((part.fingerprint, part.catalogue), lambda: part.bench.open(catalogue=part.catalogue))
