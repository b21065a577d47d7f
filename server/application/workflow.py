"""From a session's path to a comparison or a refit: the steps that every command and the service share."""

from __future__ import annotations

import datetime as dt
import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, is_dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from daq.audit import note
from daq.checks import measure_and_check
from daq.sessions import read_session

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from daq.findings import Finding
    from daq.measured import MeasuredSession
    from fingermodel.comparison import Comparison
    from fingermodel.fingers import Finger
    from fingermodel.fit_report import Fit
    from fingermodel.model import Model
    from fingermodel.model_files import LoadedModel, Revision, Step
    from fingermodel.observations import Observations
    from fingermodel.stages import Effect

Progress = Callable[[float], None]
# Starts of the solver: enough to see whether other values fit as well, still about a second.
STARTS = 8


@dataclass(frozen=True)
class Bench:
    """A measured session with the model that is held against it; `findings` are what a check warns of."""

    measured: MeasuredSession
    observations: Observations
    loaded: LoadedModel
    findings: tuple[Finding, ...] = ()

    @property
    def model(self) -> Model:
        """The model for the session's layout."""
        return self.loaded.model

    @property
    def theta(self) -> NDArray[np.float64]:
        """Its parameters before any further fit."""
        return self.loaded.theta


def open_bench(
    session_path: str | Path,
    model: str | None = None,
    progress: Progress | None = None,
    *,
    catalogue: bool = False,
    effects: Sequence[Effect | str] = (),
) -> Bench:
    """Read a session, correct its readings and load the model to compare with.

    Args:
        session_path: folder, session.yaml, or the name of a shipped session.
        model: a revision, a finger file or a shipped finger; by default the session's own finger.
        progress: called with the fraction of the readings that has been read.
        catalogue: whether the model shall hold the catalogue's effects, at their null.
        effects: the user's own, or their files, which come with the catalogue.
    """
    prepare_jax()
    measured, findings = measure_and_check(read_session(session_path), progress)
    return replace(bench_of(measured, model, catalogue=catalogue, effects=effects), findings=findings)


def bench_of(
    measured: MeasuredSession,
    model: str | Finger | Revision | None = None,
    *,
    catalogue: bool = False,
    effects: Sequence[Effect | str] = (),
) -> Bench:
    """Load the model to compare a measured session with.

    Args:
        measured: session.
        model: the model itself, or what names it as in `open_bench`; by default the session's own finger.
        catalogue: whether the model shall hold the catalogue's effects, at their null.
        effects: the user's own, or their files, which come with the catalogue.
    """
    prepare_jax()
    from fingermodel.budget import budget_of
    from fingermodel.model_files import load_model
    from fingermodel.observations import layout_of, observe

    session = measured.session
    budget = budget_of(session.budget)
    held = held_effects(effects) if catalogue or effects else ()
    loaded = load_model(model, session.id, session.finger, session.folder, layout_of(measured), budget, held)
    observations = observe(measured, loaded.model.finger, loaded.model.budget)
    return Bench(measured, observations, loaded)


def held_effects(own: Sequence[Effect | str] = ()) -> tuple[Effect, ...]:
    """The catalogue, effects of the user's or those in their files, and what rigs are known to do beyond both.

    What the user gives is found by its name; the rest is only ever something outside the catalogue.
    """
    from fingermodel.effects.catalogue import CATALOGUE
    from fingermodel.effects.user import load_effect, shipped_effects

    loaded = [load_effect(Path(e)) if isinstance(e, str) else e for e in own]
    given = [replace(e, outside=False) if e.outside and is_dataclass(e) else e for e in loaded]
    taken = {e.name for e in given}
    beyond = [load_effect(Path(name)) for name in shipped_effects() if name not in taken]
    return (*CATALOGUE, *dict.fromkeys(given), *beyond)


def compare_bench(bench: Bench) -> Comparison:
    """Compare the session with its model."""
    from fingermodel.comparison import compare

    return compare(bench.model, bench.observations, bench.theta)


def taken_out(bench: Bench, effects: Sequence[str]) -> Bench:
    """Return the bench with effects, candidates or parameters at their null; what was fitted beside them stays."""
    table, theta = bench.model.parameters, bench.theta.copy()
    for name, i in table.index.items():
        if any(name == effect or name.startswith(f"{effect}.") for effect in effects):
            theta[i] = table.initial[i]
    return replace(bench, loaded=replace(bench.loaded, theta=theta))


def at_fit(bench: Bench, values: Mapping[str, float]) -> Bench:
    """Return the bench at a fit of a search, of which an answer tells what it moved; what the model lacks is left."""
    table, theta = bench.model.parameters, bench.model.initial
    for name, value in values.items():
        if name in table.index:
            theta[table.index[name]] = value
    return replace(bench, loaded=replace(bench.loaded, theta=theta))


def refit_bench(
    bench: Bench,
    method: str = "map",
    plane: str | None = None,
    starts: int = STARTS,
    progress: Progress | None = None,
) -> Fit:
    """Refit the model to the session's identification cases.

    Args:
        bench: session and model.
        method: `map` or `slsqp`.
        plane: of the forces that count; by default what the finger's axes can predict.
        starts: of the solver, for `map`.
        progress: of `map`, called with the fraction that is done.
    """
    from fingermodel.eq5 import refit_slsqp
    from fingermodel.identification import refit_map
    from fingermodel.problems import eq5_problem, map_problem

    if method == "slsqp":
        return refit_slsqp(eq5_problem(bench.model, bench.observations))
    problem = map_problem(bench.model, bench.observations, plane, bench.loaded.added)  # type: ignore[arg-type]
    own = bench.loaded.name == bench.model.finger.id
    return refit_map(problem, start=None if own else bench.theta, starts=starts, progress=progress)


def readings_digest(measured: MeasuredSession) -> str | None:
    """SHA-256 of the session's readings file, None for averaged forces."""
    path = measured.session.readings_path
    if path is None:
        return None
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


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


def save_revision(
    bench: Bench,
    fit: Fit,
    path: Path,
    before: dict[str, Any],
    after: dict[str, Any],
    step: Step | None = None,
) -> dict[str, Any]:
    """Write a fit as a revision and return its document."""
    from daq.export import sha256_of
    from fingermodel.model_files import write_revision

    document = describe_revision(bench, fit, before, after, readings_digest(bench.measured), step)
    write_revision(document, path)
    changed = {
        "file": path.name,
        "revision": document["id"],
        "added": document["added"],
        "removed": document["removed"],
    }
    note(path.parent, "add" if step else "refit", bench.measured.session.id, changed | {"sha256": sha256_of(path)})
    return document


def describe_revision(
    bench: Bench,
    fit: Fit,
    before: dict[str, Any],
    after: dict[str, Any],
    readings_sha256: str | None,
    step: Step | None = None,
) -> dict[str, Any]:
    """Return the document of a fit as a revision; effects and history of its step are filled in here."""
    from fingermodel.model_files import Step, revision_document

    free = [p.name for p in fit.parameters if p.kind == "effect"]
    step = replace(step or Step(), effects=held_by(bench, free), history=bench.loaded.history)
    session = bench.measured.session.id
    return revision_document(bench.model, fit, bench.loaded.parent, session, before, after, readings_sha256, step=step)


def held_by(bench: Bench, parameters: Sequence[str]) -> tuple[dict[str, Any], ...]:
    """Return the effects whose parameters are free, as a revision keeps them."""
    from fingermodel.effects.catalogue import EFFECTS
    from fingermodel.effects.user import effect_document

    out = []
    for effect in bench.model.effects:
        names = [p for p in parameters if p.split(".")[0] == effect.name]
        if names:
            document = None if effect.name in EFFECTS else effect_document(effect)
            out.append({"name": effect.name, "parameters": names, "document": document})
    return tuple(out)


def prepare_jax() -> None:
    """Keep compiled models between runs, in the user's cache folder, unless the user has chosen one."""
    import os

    import jax
    from platformdirs import user_cache_path

    if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        jax.config.update("jax_compilation_cache_dir", str(user_cache_path("fingertwin") / "compiled"))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", 0)
