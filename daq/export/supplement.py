"""The supplement of a paper: one archive with everything that a session's numbers came from, and nothing of the lab.

The same input gives the same bytes. Names of hosts and users, absolute paths, addresses and wall-clock dates are
replaced in every text by numbered marks such as `[date-1]`, the same one wherever the same thing stood.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
import shutil
import sys
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import yaml

from daq import plain_json
from daq.checks import check
from daq.errors import InputError, SessionError
from daq.export.redaction import READINGS, Redactor, this_computer
from daq.export.tables import DEFUSED, describe_columns, write_columns
from daq.files import replacing
from daq.findings import CheckReport
from daq.measured import MeasuredSession
from daq.recordings.readings import ReadingBlock, open_readings, write_readings
from daq.sessions import SESSION_FILE, parse_session, plain_document, session_text
from daq.sessions import models as session_models
from daq.signals.corrections import windows_of

FORMAT = "fingertwin-supplement/1"
SUMS = "SHA256SUMS"
# Earliest time that a ZIP archive can tell; it stands for none.
NO_DATE = (1980, 1, 1, 0, 0, 0)
# Nobody records for three years: such a time counts from 1970 and is a date.
LONGEST_S = 1e8

README = """Supplement written by {software}.

Unpack it and run `fingertwin compare session.yaml` (see commands.json), with the versions of versions.json.

session.yaml       what was set and hung; windows [s] in the readings
readings.csv       readings as recorded, t_s [s], forces [N] and torques [N mm] in the cell's own axes
cases.csv          measured force and torque of every load case with standard uncertainties, and what was predicted
cases.csv.json     unit, frame and meaning of each of its columns
load_cell.json     model, serial number and calibration of the load cell, as the session states them
checks.json        what a check of the session found, known weights included
events.json        what happened at the bench
exclusions.json    load cases that are left out, and why
models             the model that the predictions come from, and the revisions before it
finger.yaml        the finger, where it does not come with the software
commands.json      seeds, and the commands that make each figure and each revision again
versions.json      this software, Python and what they were run with
manifest.json      SHA-256 of the original files, conversions, and how many private things were replaced
SHA256SUMS         SHA-256 of every other file (check it with `sha256sum -c SHA256SUMS`)

Dates and times of day, absolute paths, addresses and names of hosts and users were replaced by numbered marks. A name
that stands in a note without anything that marks it as one cannot be recognised.
"""


def write_supplement(
    measured: MeasuredSession,
    columns: Mapping[str, list[Any]],
    file: Path,
    *,
    about: Mapping[str, Any],
    models: Sequence[Mapping[str, Any]] = (),
    finger: Mapping[str, Any] | None = None,
    commands: Mapping[str, Any] | None = None,
    redactor: Redactor | None = None,
) -> dict[str, int]:
    """Write the archive and return how many different private things were replaced, by kind.

    Args:
        measured: the session.
        columns: table of its cases.
        file: to write.
        about: software, model and sources, for the table and the manifest.
        models: documents of the revision (or the finger) that the predictions come from, and of those before it.
        finger: document of the session's finger, where it does not come with the software.
        commands: seeds and command lines.
        redactor: by default one that knows this user and this computer.

    Raises:
        InputError: the readings tell dates for times, or the session cannot be read without what must be removed.
    """
    session, clean = measured.session, redactor or this_computer()
    _require_no_dates(session)
    clean.learn(session.model_dump(mode="json"))
    clean.learn("" if session.folder is None else str(session.folder.resolve()))
    entered = plain_document(session)
    data = dict(entered)
    if session.readings is not None:
        data["readings"] = READINGS
    if finger is not None:
        data["finger"] = "finger.yaml"
    report = check(session)
    for told in (models, finger, report.as_dict(), about, commands, list(measured.notes)):
        clean.learn(told)
    data = _without_unknown(data)
    cleaned = {k: v for k, v in clean(data, numbers=True).items() if v is not None}
    # Where nothing was replaced, it need not be read again.
    described = session_text(session) if cleaned == entered else _described(cleaned, session.id)
    data = cleaned
    table = {name: clean(values) for name, values in columns.items()}

    documents: dict[str, str] = {
        "README.txt": README.format(software=about.get("software", "fingertwin")),
        SESSION_FILE: described,
        "cases.csv.json": _json(clean(about) | {"texts": DEFUSED, "columns": describe_columns(list(table))}),
        "load_cell.json": _json(data.get("load_cell") or {}),
        "checks.json": _json(clean(_checks(report, measured))),
        "events.json": _json(data.get("events") or []),
        "exclusions.json": _json([{"id": c["id"], "reason": c["excluded"]} for c in data["cases"] if "excluded" in c]),
        "commands.json": _json(clean(commands or {})),
        "versions.json": _json(versions()),
    }
    if finger is not None:
        documents["finger.yaml"] = yaml.safe_dump(clean(finger), sort_keys=False, allow_unicode=True)
    for name, document in zip(model_members(models), models, strict=True):
        documents[name] = (
            json.dumps(clean(document), indent=1, ensure_ascii=False) + "\n"
            if name.endswith(".json")
            else yaml.safe_dump(clean(document), sort_keys=False, allow_unicode=True)
        )
    with TemporaryDirectory() as folder:
        here = Path(folder)
        write_columns(table, here / "cases.csv", "csv")
        files = {"cases.csv": here / "cases.csv"}
        if session.readings_path is not None:
            write_readings(here / READINGS, _timed(session.readings_path))
            files[READINGS] = here / READINGS
        documents["manifest.json"] = _json(
            {
                "format": FORMAT,
                **clean(about),
                "tension_factor": measured.tension_factor,
                "tension_factor_source": measured.tension_factor_source,
                "notes": clean(list(measured.notes)),
                "replaced": clean.counts(),
            }
        )
        for name, text in documents.items():
            (here / Path(name).name).write_text(text, encoding="utf-8", newline="\n")
            files[name] = here / Path(name).name
        with replacing(file) as temporary:
            _write_zip(temporary, files)
    return clean.counts()


def model_members(models: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return the members that hold models: revisions are JSON, fingers YAML; the one used comes first."""
    stems = ["model", *(f"before-{i}" for i in range(1, len(models)))]
    revisions = [str(m.get("format", "")).startswith("fingertwin-model/") for m in models]
    return [f"models/{s}.{'json' if revision else 'yaml'}" for s, revision in zip(stems, revisions, strict=False)]


@cache
def versions() -> dict[str, Any]:
    """Return the versions of this software, of Python and of all that the software depends on."""
    from importlib.metadata import PackageNotFoundError, distribution

    found: dict[str, str] = {}
    waiting = ["fingertwin"]
    while waiting:
        name = waiting.pop()
        try:
            package = distribution(name)
        except PackageNotFoundError:  # for another platform
            continue
        key = package.metadata["Name"]
        if key in found:
            continue
        found[key] = package.version
        needed = [r for r in package.requires or () if "extra ==" not in r]
        waiting += [re.split(r"[^\w.-]", r, maxsplit=1)[0] for r in needed]
    own = found.pop("fingertwin")
    python = ".".join(map(str, sys.version_info[:3]))
    return {"fingertwin": own, "python": python, "packages": dict(sorted(found.items(), key=lambda i: i[0].lower()))}


def _write_zip(archive: Path, files: Mapping[str, Path]) -> None:
    """Write files in the order of their names, then their checksums; no time, owner or system is stored."""
    sums = []
    with zipfile.ZipFile(archive, "w") as out:
        for name in sorted(files):
            with files[name].open("rb") as source, out.open(_entry(name), "w", force_zip64=True) as target:
                shutil.copyfileobj(source, target, 1 << 20)
            with files[name].open("rb") as source:
                sums.append(f"{hashlib.file_digest(source, 'sha256').hexdigest()}  {name}\n")
        out.writestr(_entry(SUMS), "".join(sums))


def _entry(name: str) -> zipfile.ZipInfo:
    info = zipfile.ZipInfo(name, NO_DATE)
    info.compress_type, info.create_system, info.external_attr = zipfile.ZIP_DEFLATED, 3, 0o100644 << 16
    return info


def _timed(path: Path) -> Iterator[ReadingBlock]:
    for block in open_readings(path).blocks():
        _require_no_date(path.name, float(block.t_s[-1]))
        yield block


def _require_no_dates(session: session_models.Session) -> None:
    for span, name in windows_of(session).items():
        _require_no_date(name, span[1])
    for i, event in enumerate(session.events):
        _require_no_date(f"events[{i}]", event.t_s)


def _require_no_date(place: str, t_s: float) -> None:
    if abs(t_s) > LONGEST_S:
        raise InputError(
            f"{place} tells a date (t = {t_s:.0f} s)",
            "seconds since the start of the recording",
            "Take the time of the first reading from readings, windows and events",
        )


def _described(data: Mapping[str, Any], name: str) -> str:
    """Return the description of a session as text, if it is still one."""
    session, faults = parse_session(data, None, SESSION_FILE)
    if session is None:
        raise SessionError(
            f"session {name} cannot be read without its private words ({faults[0].found})",
            "ids, postures and numbers that hold no date, path, host or user name",
            "Rename them in the session",
        )
    return session_text(session)


def _checks(report: CheckReport, measured: MeasuredSession) -> dict[str, Any]:
    weights = [
        {
            "when": c.when,
            "mount": c.mount,
            "mass_g": c.mass_g,
            "true_N": c.force_N.tolist(),
            "measured_N": c.wrench[:3].tolist(),
            "measured_Nmm": c.wrench[3:].tolist(),
            "sd_N": [math.sqrt(v) for v in c.covariance.diagonal()[:3]],
            "sd_Nmm": [math.sqrt(v) for v in c.covariance.diagonal()[3:]],
        }
        for c in measured.checks
    ]
    return {**report.as_dict(), "known_weights_measured": weights}


def _without_unknown(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {k: _without_unknown(v) for k, v in value.items() if v is not None}
    return [_without_unknown(v) for v in value] if isinstance(value, (list, tuple)) else value


def _json(value: Any) -> str:
    return json.dumps(plain_json.clean(value), indent=1, ensure_ascii=False, allow_nan=False) + "\n"
