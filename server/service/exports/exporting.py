"""Exports of sessions and revisions as files, by what the command line writes them with."""

from __future__ import annotations

import json
import re
import shutil
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Literal

from daq.errors import InputError
from daq.export.formats import write_c3d
from daq.sessions import write_session
from daq.sessions.models import Session
from fingermodel.model_files import Revision
from server.application.exchange import ENDINGS as FINGER_ENDINGS
from server.application.exchange import written_finger
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
)
from server.service.exports.session_folders import session_folder
from server.service.figures.parts import resolved
from server.service.services import Services
from server.service.sessions.blinding import blinded
from server.service.sessions.measuring import Measured
from server.service.storage.audit import entries
from server.service.storage.checksums import digest_of
from server.service.web.problems import ProblemError

# Columns tells what those of csv are, folder is the session as the command line has it.
SessionFormat = Literal["csv", "columns", "parquet", "xlsx", "hdf5", "c3d", "mat", "supplement", "folder"]
RevisionFormat = Literal["json", "csv", "columns", "parquet", "xlsx", "osim", "mjcf"]

Write = Callable[[Path], Path]


def session_export(parts: Services, session: str, file_format: str, model: str | None) -> Write:
    """Return what writes a session into a folder and returns the file.

    While its bench is running, validation cases have no prediction in it.

    Args:
        parts: of the service.
        session: its id.
        file_format: a SessionFormat.
        model: whose predictions go along.

    Raises:
        ProblemError: there is no such session or model, or the format holds no predictions.
    """
    measured = parts.measuring.of(session)
    named = resolved(parts, measured, model)
    if file_format == "supplement":
        # A finger that is a file of the bench is refused before anything reads that name here.
        parts.models.model(None, measured)
    if model is not None and file_format in ("c3d", "folder"):
        raise ProblemError(422, f"format {file_format} with a model", "no model", f"A {file_format} holds none")
    if file_format == "folder":
        return lambda folder: _zipped(parts, measured, folder)
    if file_format in ("columns", *OF_MODELS):
        return lambda folder: _cases(parts, measured, file_format, named, folder)

    def write(folder: Path) -> Path:
        try:
            return _readings(parts, measured, file_format, named, folder, with_model=model is not None)
        except InputError as error:
            # What the format cannot hold is told in the command line's words.
            remedy = re.sub(r"Use --format (\w+)", r"Ask for format=\1", error.remedy)
            raise InputError(error.found, error.expected, remedy) from error

    return write


def revision_export(parts: Services, revision: str, file_format: str) -> Write:
    """Return what writes a revision's document, its parameters as a table or its finger, and returns the file.

    Raises:
        ProblemError: 404 there is no such revision.
    """
    text = json.dumps(parts.revisions.read(revision)["document"], indent=1) + "\n"
    loaded = None if file_format == "json" else parts.revisions.loaded(revision)

    def write(folder: Path) -> Path:
        if loaded is None:
            file = folder / f"{revision}.json"
            file.write_text(text, encoding="utf-8")
            return file
        if file_format in FINGER_ENDINGS:
            file = folder / f"{revision}{FINGER_ENDINGS[file_format][0]}"
            file.write_text(written_finger(loaded.finger, loaded.id, file_format).text, encoding="utf-8")
            return file
        sources = {f"{revision}.json": digest_of(text.encode())}
        return _table(parameter_columns(loaded), about_revision(loaded, sources), file_format, folder / revision)

    return write


def _cases(parts: Services, measured: Measured, file_format: str, model: str | None, folder: Path) -> Path:
    bench = parts.models.bench(measured, model)
    hidden = blinded(measured)
    origin = parts.models.provenance(measured, bench, digest=True)
    about = about_bench(bench, origin["readings"] or {}, hidden) | {"provenance": origin}
    about["audit"] = [asdict(e) for e in entries(parts.database, measured.record.id)]
    return _table(bench_columns(bench, hidden), about, file_format, folder / measured.record.id)


def _table(columns: Mapping[str, list[Any]], about: Mapping[str, Any], file_format: str, stem: Path) -> Path:
    kind = "csv" if file_format == "columns" else file_format
    file = stem.parent / f"{stem.name}{ENDINGS[kind][0]}"
    beside = write_table_file(columns, file, kind, about)
    return beside if file_format == "columns" and beside is not None else file


def _readings(
    parts: Services, measured: Measured, file_format: str, model: str | None, into: Path, *, with_model: bool
) -> Path:
    """Write a format that holds the readings, which go to a folder of the session first."""
    name, hidden = measured.record.id, blinded(measured)
    suffix = "-supplement" if file_format == "supplement" else ""
    file = into / f"{name}{suffix}{ENDINGS[file_format][0]}"
    with session_folder(parts, measured) as (_, session):
        if file_format == "c3d":
            write_c3d(session, file)
            return file
        if file_format == "supplement":
            told = replace(measured.require(), session=_as_measured(session, measured))
            bench = parts.models.bench(measured, model) if with_model else None
            models = _documents(parts, measured, model) if with_model else []
            sources = parts.models.readings_of(measured.record, digest=True) or {}
            write_paper(told, bench, models, file, sources, hidden)
            return file
        bench = parts.models.bench(measured, model)
        origin = parts.models.provenance(measured, bench, digest=True)
        about = about_bench(bench, origin["readings"] or {}, hidden) | {"provenance": origin}
        write_whole(bench, session, file, file_format, about, hidden)
    return file


def _as_measured(session: Session, measured: Measured) -> Session:
    """Return a session in its folder with the cases that are measured or excluded: one that can be measured again."""
    kept = tuple(c for c in session.cases if measured.states[c.id].state in ("measured", "excluded"))
    stated = measured.require().session
    return session.model_copy(update={"cases": kept, "checks": stated.checks, "tension_factor": stated.tension_factor})


def _documents(parts: Services, measured: Measured, model: str | None) -> list[dict[str, Any]]:
    """Return the document of a model, and of the revisions before it that the service has."""
    found = parts.models.model(model, measured)
    if not isinstance(found, Revision):
        return [parts.models.bench(measured, model).model.finger.document]
    out = [found.document]
    seen = {found.id}
    while (parent := str(out[-1]["parent"])) not in seen:
        seen.add(parent)
        try:
            out.append(parts.revisions.read(parent)["document"])
        except ProblemError:
            break  # a finger
    return out


def _zipped(parts: Services, measured: Measured, into: Path) -> Path:
    file = into / f"{measured.record.id}-session.zip"
    with session_folder(parts, measured) as (folder, session), zipfile.ZipFile(file, "w") as out:
        write_session(session, folder)
        for path in sorted(p for p in folder.iterdir() if p.is_file()):
            packed = zipfile.ZIP_STORED if path.suffix == ".parquet" else zipfile.ZIP_DEFLATED
            entry = zipfile.ZipInfo(f"{folder.name}/{path.name}")
            entry.compress_type, entry.external_attr = packed, 0o100644 << 16
            with path.open("rb") as source, out.open(entry, "w", force_zip64=True) as target:
                shutil.copyfileobj(source, target, 1 << 20)
        trail = [json.dumps(asdict(e), ensure_ascii=False) for e in entries(parts.database, measured.record.id)]
        out.writestr(f"{folder.name}/audit-service.jsonl", "".join(f"{line}\n" for line in trail))
    return file
