"""From a session's path to a comparison or a refit: the steps that every command and the service share."""

from __future__ import annotations

import datetime as dt
import hashlib
import json
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from daq.sessions.amendments import listed
from fingermodel.compiled.compilation import prepare_jax
from fingermodel.revisions import describe_revision, held_by, save_revision
from fingermodel.session import Progress, Session, held_effects, readings_digest

if TYPE_CHECKING:
    from daq.measured import MeasuredSession
    from fingermodel.comparison.comparison import Comparison
    from fingermodel.fingers import Finger
    from fingermodel.fitting.fit_report import Fit
    from fingermodel.model_files import Revision
    from fingermodel.stages import Effect

__all__ = [
    "Bench",
    "Progress",
    "at_fit",
    "bench_of",
    "compare_bench",
    "describe_revision",
    "held_by",
    "held_effects",
    "open_bench",
    "origin_of",
    "prepare_jax",
    "provenance",
    "readings_digest",
    "refit_bench",
    "save_revision",
    "taken_out",
]

# Starts of the solver: enough to see whether other values fit as well, still about a second.
STARTS = 8


# A session with the model that is compared with it.
Bench = Session


def open_bench(
    session_path: str | Path,
    model: str | None = None,
    progress: Progress | None = None,
    *,
    catalogue: bool = False,
    effects: Sequence[Effect | str] = (),
) -> Bench:
    """Open a session, as `Session.open`, by default without the catalogue's effects."""
    return Session.open(session_path, model, effects=effects, catalogue=catalogue, progress=progress)


def bench_of(
    measured: MeasuredSession,
    model: str | Finger | Revision | None = None,
    *,
    catalogue: bool = False,
    effects: Sequence[Effect | str] = (),
) -> Bench:
    """Load the model to compare a measured session with, as `Session.of`, by default without the catalogue."""
    return Session.of(measured, model, effects=effects, catalogue=catalogue)


def compare_bench(bench: Bench) -> Comparison:
    """Compare the session with its model."""
    from fingermodel.api import compare

    return compare(bench)


def taken_out(bench: Bench, effects: Sequence[str]) -> Bench:
    """Return the bench with effects, candidates or parameters at their null; what was fitted beside them stays."""
    return bench.without(effects)


def at_fit(bench: Bench, values: Mapping[str, float]) -> Bench:
    """Return the bench at a fit of a search, of which an answer tells what it moved; what the model lacks is left."""
    return bench.at_values(values)


def refit_bench(
    bench: Bench,
    method: str = "map",
    plane: str | None = None,
    starts: int = STARTS,
    progress: Progress | None = None,
) -> Fit:
    """Refit the model to the session's identification cases, as `fingermodel.refit`."""
    from fingermodel.api import refit

    return refit(bench, method, plane=plane, starts=starts, progress=progress)  # type: ignore[arg-type]


def provenance(bench: Bench) -> dict[str, Any]:
    """Say which session, model and corrections an answer came from."""
    measured = bench.measured
    return {
        "session": measured.session.id,
        "model": bench.loaded.name,
        "residuals_after": bench.loaded.fitted,
        "tension_factor": measured.tension_factor,
        "tension_factor_source": measured.tension_factor_source,
        "budget": bench.model.budget.name,
        "judged_in": bench.model.finger.judged_in,
        "notes": [*measured.notes, *bench.loaded.notes],
        "warnings": [f.as_warning() for f in bench.findings],
        "amendments": listed(measured.session),
    }


def origin_of(bench: Bench, readings_sha256: str | None) -> dict[str, str | None]:
    """Return what a report says of where its numbers come from: when, by what, of which readings and which model."""
    finger, table = bench.model.finger, bench.model.parameters
    moved = {name: float(bench.theta[i]) for name, i in table.index.items() if bench.theta[i] != table.initial[i]}
    content = json.dumps({"finger": finger.document, "parameters": moved}, sort_keys=True, default=str)
    return {
        "session": bench.measured.session.id,
        "specimen": bench.measured.session.specimen.id,
        "finger": finger.id,
        "model": bench.loaded.name,
        "made": dt.datetime.now(dt.UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "software": f"fingertwin {version('fingertwin')}",
        "readings_sha256": readings_sha256,
        "model_sha256": hashlib.sha256(content.encode()).hexdigest(),
    }
