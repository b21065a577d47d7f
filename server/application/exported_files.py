"""Files for other software, of a session or a revision in a file."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from daq.errors import InputError
from daq.export.formats import write_c3d
from daq.export.tables import sha256_of, sources_of
from daq.sessions import find_session, read_session
from daq.signals.corrections import measure
from fingermodel.model_files import read_revision
from fingermodel.session import Progress, Session
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


def export_file(
    source: str, file_format: str, out: Path | None, model: str | None, tell: Progress = lambda done: None
) -> dict[str, Any]:
    """Write a session's cases, measured and predicted, its readings, a supplement, or a revision's parameters.

    Args:
        source: a session, or the file of a revision.
        file_format: of `ENDINGS`.
        out: file; by default named after the source.
        model: of the predictions; by default the session's own finger.
        tell: is called with the fraction of the readings that has been read.

    Returns:
        `file` and `rows`, with `sidecar` or `replaced` where there are such.

    Raises:
        InputError: something cannot be read, written, or put into that format.
    """
    ending = "" if out is None else out.suffix.lower()
    if ending in {e for known in ENDINGS.values() for e in known} - set(ENDINGS[file_format]):
        raise InputError(
            f"--format {file_format} and {out.name if out else ''}", "one of the two", "Let name and format agree"
        )
    if Path(source).suffix == ".json" and Path(source).is_file():
        return _export_revision(Path(source), file_format, out, model)
    if file_format == "c3d":
        return _export_channels(source, out, model)
    if file_format == "supplement":
        return _export_supplement(source, out, model, tell)
    return _export_session(source, file_format, out, model, tell)


def _path(out: Path | None, name: str, file_format: str) -> Path:
    stem = Path(name).name or "export"
    return out or Path(f"{stem}{'-supplement' if file_format == 'supplement' else ''}{ENDINGS[file_format][0]}")


def _table(columns: Mapping[str, list[Any]], path: Path, file_format: str, about: Mapping[str, Any]) -> dict[str, Any]:
    body: dict[str, Any] = {"file": str(path), "rows": len(next(iter(columns.values()), []))}
    with writing(path):
        beside = write_table_file(columns, path, file_format, about)
    return body if beside is None else body | {"sidecar": str(beside)}


def _export_revision(source: Path, file_format: str, out: Path | None, model: str | None) -> dict[str, Any]:
    if model is not None:
        raise InputError(f"--model {model} with a model to export", "no --model", "Leave it out")
    if file_format not in OF_MODELS:
        raise InputError(f"--format {file_format} with a model", f"one of {' '.join(OF_MODELS)}", "Or give a session")
    revision = read_revision(source)
    about = about_revision(revision, {source.name: sha256_of(source)})
    return _table(parameter_columns(revision), _path(out, revision.id, file_format), file_format, about)


def _export_session(
    source: str, file_format: str, out: Path | None, model: str | None, tell: Progress
) -> dict[str, Any]:
    bench = Session.open(source, model, progress=tell, catalogue=False)
    session = bench.measured.session
    path = _path(out, session.id, file_format)
    about = about_bench(bench, sources_of(session, find_session(source)))
    if file_format in OF_MODELS:
        return _table(bench_columns(bench), path, file_format, about)
    with writing(path):
        rows = write_whole(bench, session, path, file_format, about)
    return {"file": str(path), "rows": rows}


def _export_channels(source: str, out: Path | None, model: str | None) -> dict[str, Any]:
    if model is not None:
        raise InputError(f"--model {model} with --format c3d", "no --model: it holds readings alone", "Leave it out")
    session = read_session(source)
    path = _path(out, session.id, "c3d")
    with writing(path):
        write_c3d(session, path)
    return {"file": str(path), "rows": None}


def _export_supplement(source: str, out: Path | None, model: str | None, tell: Progress) -> dict[str, Any]:
    bench, models = None, []
    if model is None:
        measured = measure(read_session(source), tell)
    else:
        bench = Session.open(source, model, progress=tell, catalogue=False)
        measured, models = bench.measured, _revisions(model, bench)
    path = _path(out, measured.session.id, "supplement")
    with writing(path):
        sources = sources_of(measured.session, find_session(source))
        rows, replaced = write_paper(measured, bench, models, path, sources)
    return {"file": str(path), "rows": rows, "replaced": replaced}


def _revisions(model: str, bench: Session) -> list[dict[str, Any]]:
    """Return the document of the model, and of the revisions before it that lie beside it."""
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
