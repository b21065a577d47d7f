"""`fingertwin export` and `fingertwin simulate`."""

from __future__ import annotations

import json as json_module
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from daq.errors import InputError
from server.application.exchange import ENDINGS as FINGER_FORMATS
from server.application.exporting import (
    ENDINGS,
    OF_MODELS,
    about_bench,
    about_revision,
    bench_columns,
    parameter_columns,
    write_paper,
    write_table_file,
    write_whole,
    writing,
)
from server.application.workflow import Bench, open_bench
from server.commands.console import answer, progress, say
from server.commands.exchange import export_finger


def export_source(source: str, file_format: str, out: Path | None, model: str | None, json: str | None) -> None:
    """Write a session's cases, measured and predicted, its readings, a revision's parameters, or a finger."""
    if file_format in FINGER_FORMATS:
        export_finger(source, file_format, out, model, json)
        return
    ending = "" if out is None else out.suffix.lower()
    if ending in {e for known in ENDINGS.values() for e in known} - set(ENDINGS[file_format]):
        raise InputError(
            f"--format {file_format} and {out.name if out else ''}", "one of the two", "Let name and format agree"
        )
    body: dict[str, Any] = {"source": source}
    if Path(source).suffix == ".json" and Path(source).is_file():
        body |= _export_revision(Path(source), file_format, out, model)
    elif file_format == "c3d":
        body |= _export_channels(source, out, model)
    elif file_format == "supplement":
        body |= _export_supplement(source, out, model)
    else:
        body |= _export_session(source, file_format, out, model)
    if answer("export", body, json):
        return
    rows = f"{body['rows']} rows: " if body["rows"] is not None else ""
    say(f"{rows}{body['file']}")
    if file_format == "supplement":
        kinds = ", ".join(f"{n} {kind}" for kind, n in body["replaced"].items()) or "nothing"
        say(f"Replaced: {kinds}. Names that nothing marks as such stay: read its notes before you publish it.")


def _path(out: Path | None, name: str, file_format: str) -> Path:
    stem = Path(name).name or "export"
    return out or Path(f"{stem}{'-supplement' if file_format == 'supplement' else ''}{ENDINGS[file_format][0]}")


def _table(columns: Mapping[str, list[Any]], path: Path, file_format: str, about: Mapping[str, Any]) -> dict[str, Any]:
    body: dict[str, Any] = {"file": str(path), "rows": len(next(iter(columns.values()), []))}
    with writing(path):
        beside = write_table_file(columns, path, file_format, about)
    return body if beside is None else body | {"sidecar": str(beside)}


def _export_revision(source: Path, file_format: str, out: Path | None, model: str | None) -> dict[str, Any]:
    from daq.export import sha256_of
    from fingermodel.model_files import read_revision

    if model is not None:
        raise InputError(f"--model {model} with a model to export", "no --model", "Leave it out")
    if file_format not in OF_MODELS:
        raise InputError(f"--format {file_format} with a model", f"one of {' '.join(OF_MODELS)}", "Or give a session")
    revision = read_revision(source)
    about = about_revision(revision, {source.name: sha256_of(source)})
    return _table(parameter_columns(revision), _path(out, revision.id, file_format), file_format, about)


def _export_session(source: str, file_format: str, out: Path | None, model: str | None) -> dict[str, Any]:
    from daq.export import sources_of
    from daq.sessions import find_session

    with progress("Reading and correcting") as tell:
        bench = open_bench(source, model, tell)
    session = bench.measured.session
    path = _path(out, session.id, file_format)
    about = about_bench(bench, sources_of(session, find_session(source)))
    if file_format in ("csv", "parquet"):
        return _table(bench_columns(bench), path, file_format, about)
    with writing(path):
        rows = write_whole(bench, session, path, file_format, about)
    return {"file": str(path), "rows": rows}


def _export_channels(source: str, out: Path | None, model: str | None) -> dict[str, Any]:
    from daq.export_formats import write_c3d
    from daq.sessions import read_session

    if model is not None:
        raise InputError(f"--model {model} with --format c3d", "no --model: it holds readings alone", "Leave it out")
    session = read_session(source)
    path = _path(out, session.id, "c3d")
    with progress("Reading"), writing(path):
        write_c3d(session, path)
    return {"file": str(path), "rows": None}


def _export_supplement(source: str, out: Path | None, model: str | None) -> dict[str, Any]:
    from daq.corrections import measure
    from daq.sessions import find_session, read_session

    bench, models = None, []
    with progress("Reading and correcting") as tell:
        if model is None:
            measured = measure(read_session(source), tell)
        else:
            bench = open_bench(source, model, tell)
            measured, models = bench.measured, _revisions(model, bench)
    path = _path(out, measured.session.id, "supplement")
    with writing(path):
        rows, replaced = write_paper(measured, bench, models, path, find_session(source))
    return {"file": str(path), "rows": rows, "replaced": replaced}


def _revisions(model: str, bench: Bench) -> list[dict[str, Any]]:
    """The document of the model, and of the revisions before it that lie beside it."""
    from fingermodel.model_files import read_revision

    path = Path(model)
    if path.suffix != ".json":
        return [bench.model.finger.document]
    found = [read_revision(path).document]
    beside = {}
    for file in sorted(path.parent.glob("*.json")):
        with suppress(InputError, OSError):  # other files may lie there too
            document = read_revision(file).document
            beside[document["id"]] = document
    while (before := beside.pop(found[-1]["parent"], None)) is not None:
        found.append(before)
    return found


def simulate_rig(
    protocol: str, out: Path, model: str, rate_hz: float, noise_N: float, repeats: int, seed: int, json: str | None
) -> None:
    """Write a simulated session, with the truth beside it."""
    from daq.protocols import read_protocol
    from daq.simulated import SimulatedCell
    from fingermodel.finger_files import read_finger
    from fingermodel.model_files import read_revision
    from fingermodel.rig import simulate_session

    if not 0 < rate_hz <= 1e6 or not 0 <= noise_N <= 1e3 or repeats < 1 or seed < 0:
        raise InputError(
            f"rate {rate_hz:g} Hz, noise {noise_N:g} N, {repeats} repeats, seed {seed}",
            "a rate above 0 and up to 1e6, noise of 0 to 1000, 1 repeat or more, a seed of 0 or more",
        )
    if out.is_dir() and any(out.iterdir()):
        raise InputError(f"{out} is not empty", "a new folder", "Choose another --out")
    finger = read_revision(Path(model)).finger if Path(model).suffix == ".json" else read_finger(model)
    cell = SimulatedCell(rate_hz=rate_hz, noise_sd=(noise_N,) * 3 + (noise_N * 7.0,) * 3)
    with progress("Simulating"):
        session, truth = simulate_session(
            finger, read_protocol(protocol), out, cell=cell, seed=seed, session_id=out.resolve().name, repeats=repeats,
            finger_name=None if Path(model).suffix != ".json" else finger.document["id"],
        )  # fmt: skip
    wrenches = {name: [round(float(x), 6) for x in wrench] for name, wrench in truth.items()}
    (out / "truth.json").write_text(json_module.dumps({"id": session.id, "wrench_N_Nmm": wrenches}, indent=1) + "\n")
    body = {"session": str(out), "cases": len(session.cases), "rate_hz": rate_hz, "seed": seed}
    if not answer("simulate", body, json):
        say(f"{len(session.cases)} load cases at {rate_hz:g} Hz: {out}   (fingertwin compare {out})")
