"""The supplement of a paper: one archive with everything that a session's numbers came from, and nothing of the lab.

The same input gives the same bytes. Names of hosts and users, absolute paths, addresses and wall-clock dates are
replaced in every text by numbered marks such as `[date-1]`, the same one wherever the same thing stood.
"""

from __future__ import annotations

import getpass
import hashlib
import json
import math
import re
import shutil
import socket
import sys
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import yaml

from daq import session_models, vocabulary
from daq.checks import check
from daq.corrections import windows_of
from daq.errors import InputError, SessionError
from daq.export import describe_columns, sources_of, write_columns
from daq.files import replacing
from daq.findings import CheckReport
from daq.measured import MeasuredSession
from daq.readings import ReadingBlock, open_readings, write_readings
from daq.sessions import SESSION_FILE, parse_session, write_session

FORMAT = "fingertwin-supplement/1"
READINGS = "readings.csv"
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

# Of publications, which a supplement may cite.
PUBLIC = ("doi.org", "dx.doi.org", "creativecommons.org", "spdx.org", "orcid.org")
_MONTH = r"(?:jan|feb|mar|apr|may|june?|july?|aug|sept?|oct|nov|dec)[a-z]*\.?"
# Without a year only the full names are dates; `may` is a verb too.
_FULL = "january|february|march|april|june|july|august|september|october|november|december"
_ZONE = r"(?:\s?(?:Z|UTC|GMT|CES?T|h)\b)?(?:[+-]\d\d:?\d\d)?"
_CLOCK = r"(?:[01]?\d|2[0-4]):[0-5]\d(?::[0-6]\d(?:[.,]\d+)?)?(?:\s?[ap]m\b)?" + _ZONE
_PUBLIC_URL = r"https?://(?:www\.)?(?:" + "|".join(map(re.escape, PUBLIC)) + ")/"
_YEAR = r"(?:19|20)\d\d"
# Of domains, in small letters: no ending of a file is among them, and no tendon's name (point.DIP.ES).
_TOP = "edu|org|com|net|gov|eu|io|at|au|be|br|ca|ch|cn|cz|de|dk|es|fi|fr|ie|il|it|jp|kr|nl|no|nz|pl|pt|se|sg|tw|uk|us"
_MACHINE = "pc|laptop|desktop|workstation|notebook|server|host|macbook|raspberrypi"
_NAME = r"[A-Za-z][\w.-]*"
# What is replaced, in this order: (kind, pattern).
PATTERNS: tuple[tuple[str, re.Pattern[str]], ...] = tuple(
    (kind, re.compile(pattern, re.IGNORECASE))
    for kind, pattern in (
        ("address", rf"\b(?!{_PUBLIC_URL})[a-z][a-z0-9+.-]*://[^\s\"'<>|]*"),
        ("address", rf"\b{_NAME}(?:\+[\w.-]+)?@[A-Za-z][\w-]*(?:\.[\w-]+)*"),
        ("path", r"\\\\[\w.$-]+(?:\\[^\\/:*?\"<>|\s]*)*"),
        ("path", r"(?<![A-Za-z0-9])[a-z]:\\(?:[^\\/:*?\"<>|\r\n]+\\)*[^\\/:*?\"<>|\s]*"),
        ("path", r"(?<![A-Za-z0-9])[a-z]:/[^\s\"'<>|]+"),
        ("path", r"(?:%\w+%|\$\{?\w+\}?|~(?:[a-z][\w-]*)?)[\\/][^\s\"'<>|]*"),
        ("path", r"(?<![\w.:/)\]}])(?:[A-Za-z][\w.-]*:)?/(?:[^\s/\"'<>|]+/)+[^\s/\"'<>|]*"),
        ("path", r"(?<![\w.:/)\]}])/(?:home|root|users|tmp|var|mnt|media|opt|srv|data|volumes|scratch|etc|usr)\b"),
        ("date", rf"(?<![\d.]){_YEAR}-?[01]\d-?[0-3]\d[T ]?[0-2]\d:?[0-5]\d(?::?[0-6]\d(?:[.,]\d+)?)?{_ZONE}(?!\d)"),
        ("date", rf"(?<![\d.]){_YEAR}([-/._])[01]?\d\1[0-3]?\d(?![\d.]?\d)(?:[T ]+{_CLOCK})?"),
        ("date", rf"(?<![\d.])[0-3]?\d([-/.])[01]?\d\1{_YEAR}(?!\d)(?:[T, ]+{_CLOCK})?"),
        ("date", r"(?<![\d./])[0-3]?\d/[0-3]?\d/\d\d(?![\d/])"),
        ("date", rf"\b[0-3]?\d(?:st|nd|rd|th)?\.?\s+{_MONTH},?\s+{_YEAR}\b"),
        ("date", rf"\b{_MONTH}\s+[0-3]?\d(?:st|nd|rd|th)?,?\s+{_YEAR}\b"),
        ("date", rf"\b{_MONTH}\s+[0-3]?\d\s+{_CLOCK}(?:\s+{_YEAR})?"),
        ("date", rf"\b(?:[0-3]?\d(?:st|nd|rd|th)?\.?\s+(?:{_FULL})|(?:{_FULL})\s+[0-3]?\d(?:st|nd|rd|th)?)\b"),
        ("date", rf"\b{_YEAR}-?W[0-5]\d(?:-?[1-7])?\b"),
        ("date", rf"(?<![A-Za-z0-9.]){_YEAR}(?:0[1-9]|1[0-2])(?:0[1-9]|[12]\d|3[01])(?![A-Za-z0-9]|\.\d)"),
        ("date", r"(?<![A-Za-z0-9.])1[0-9]{9}(?:[0-9]{3}){0,3}(?:\.\d+)?\b"),
        ("time", rf"(?<![\w:.]){_CLOCK}(?![\w:])"),
        ("host", r"(?<![\w:-])(?:[0-9a-f]{2}[:-]){5}[0-9a-f]{2}(?![\w:-])"),
        ("host", r"(?<![\d.])(?:\d{1,3}\.){3}\d{1,3}(?![\d.])"),
        ("host", r"\b[\w-]+(?:\.[\w-]+)*\.(?:local|localdomain|lan|internal|intranet|intra|corp|home)\b"),
        ("host", rf"(?<![/@.\w])(?:[a-z0-9][\w-]*\.){{2,}}(?-i:{_TOP})(?!\.?\w)"),
        ("host", r"\b(?-i:(?:DESKTOP|LAPTOP|WIN)-[A-Z0-9]{3,})\b"),
        ("host", rf"(?<![\[\w-])[\w-]*(?:{_MACHINE})-?\d+\b"),
    )
)  # fmt: skip
# Names that show themselves once are removed everywhere: (kind, pattern with the name as its group).
TELLTALES: tuple[tuple[str, re.Pattern[str]], ...] = tuple(
    (kind, re.compile(pattern, re.IGNORECASE))
    for kind, pattern in (
        ("user", r"/(?:home|users)/([^\s/\"'<>|:]+)"),
        ("user", r"[a-z]:[\\/](?:users|documents and settings)[\\/]([^\\/:*?\"<>|\r\n]+)"),
        ("user", rf"\b({_NAME})@[A-Za-z]"),
        ("user", r"\b(?:user|user ?name|login|operator|logged by|recorded by)\s*[:=]\s*([\w.-]+)"),
        ("host", rf"\b{_NAME}@([A-Za-z][\w.-]*)"),
        ("host", r"\\\\([\w-]+)(?:\.[\w.-]+)?\\"),
        ("host", r"\b[a-z][a-z0-9+.-]*://(?:[^\s/@]+@)?([a-z][\w-]*)(?![\w.-]*\.(?:org|com|net|edu))"),
        ("host", r"(?<![\w.:/])([a-z][a-z]*(?:\d|-)[\w-]*):/(?!/)"),
        ("host", r"\b(?:host|host ?name|computer|machine name|node)\s*[:=]\s*([\w.-]+)"),
    )
)
USER_KEYS = {"user", "username", "user_name", "login", "operator", "logged_by", "recorded_by"}
HOST_KEYS = {"host", "hostname", "host_name", "computer", "computer_name"}
# Names of accounts and machines that many have, and that are words of their own.
COMMON = {
    "root", "admin", "administrator", "user", "users", "guest", "public", "default", "runner", "build", "home", "lab",
    "localhost", "local", "host", "server", "main", "date", "time", "path", "address", "the", "and", "cell", "finger",
    "hand", "human", "bench", "session", "data",
}  # fmt: skip


@dataclass
class Redactor:
    """Replaces what would tell who measured where and when; equal things get equal marks.

    Attributes:
        private: further words to remove, by kind (`user` or `host`).
        marks: (kind, word in lower case) -> mark, of everything that was replaced so far.
    """

    private: dict[str, str] = field(default_factory=dict)
    marks: dict[tuple[str, str], str] = field(default_factory=dict)

    def learn(self, value: Any) -> None:
        """Note the names of users and hosts that plain data give away."""
        for key, text in _texts(value):
            if key.lower() in USER_KEYS | HOST_KEYS:
                kind = "user" if key.lower() in USER_KEYS else "host"
                for word in (text, *(w for w in text.split() if w[:1].isupper())):
                    self._note(kind, word)
            for kind, pattern in TELLTALES:
                for match in pattern.finditer(text):
                    self._note(kind, match[1])

    def __call__(self, value: Any, key: str = "", numbers: bool = False) -> Any:
        """Return plain data without anything private; a date in a key of its own (`…_utc`) becomes None.

        Args:
            value: texts, numbers, lists and mappings.
            key: that it stands under.
            numbers: whether numbers that count from 1970 are dates.
        """
        if key.endswith("_utc") and not isinstance(value, Mapping | list | tuple):
            return None
        if isinstance(value, Mapping):
            return {self.text(str(k)): self(v, str(k), numbers) for k, v in value.items()}
        if isinstance(value, list | tuple):
            return [self(v, key, numbers) for v in value]
        if isinstance(value, str):
            # A serial number may be digits that look like a date.
            return value if key == "serial" and value.isalnum() else self.text(value)
        if numbers and isinstance(value, int | float) and not isinstance(value, bool) and _since_1970(value):
            return self._mark("date", str(value))
        return value

    def text(self, text: str) -> str:
        """Return a text without anything private."""
        if text in _RESERVED:
            return text
        for kind, pattern in PATTERNS:
            text = pattern.sub(lambda m, kind=kind: self._mark(kind, m[0]), text)  # type: ignore[misc]
        for word, kind in sorted(self.private.items(), key=lambda item: (-len(item[0]), item[0])):
            text = re.sub(
                rf"(?<![A-Za-z0-9]){re.escape(word)}(?![A-Za-z0-9])",
                lambda m, kind=kind: self._mark(kind, m[0]),  # type: ignore[misc]
                text,
                flags=re.IGNORECASE,
            )
        return text

    def counts(self) -> dict[str, int]:
        """Number of different things replaced, by kind."""
        kinds = [kind for kind, _ in self.marks]
        return {kind: kinds.count(kind) for kind in sorted(set(kinds))}

    def _note(self, kind: str, word: str) -> None:
        name = word.strip(" .,;:-_").lower()
        if len(name) > 2 and name not in COMMON and name not in _RESERVED and not name.isdigit():
            self.private.setdefault(name, kind)

    def _mark(self, kind: str, found: str) -> str:
        number = sum(k == kind for k, _ in self.marks) + 1
        return self.marks.setdefault((kind, found.lower()), f"[{kind}-{number}]")


def this_computer() -> Redactor:
    """Return a redactor that knows the names of this user and of this computer."""
    out = Redactor()
    found = [("host", socket.gethostname()), ("host", socket.gethostname().split(".")[0])]
    with suppress(OSError, KeyError, ImportError, RuntimeError):  # where there are no such names
        found += [("user", getpass.getuser()), ("user", Path.home().name)]
    for kind, word in found:
        out._note(kind, word)
    return out


def write_supplement(
    measured: MeasuredSession,
    columns: Mapping[str, list[Any]],
    file: Path,
    *,
    about: Mapping[str, Any],
    session_file: Path | None = None,
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
        about: software and model, for the table and the manifest.
        session_file: its description, for its SHA-256.
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
    data = session.model_dump(mode="json", exclude_defaults=True)
    data["gravity_m_s2"] = session.gravity_m_s2
    data["postures_deg"] = {name: posture.model_dump() for name, posture in session.postures_deg.items()}
    if session.readings is not None:
        data["readings"] = READINGS
    if finger is not None:
        data["finger"] = "finger.yaml"
    report = check(session)
    facts = {**about, "sources": sources_of(session, session_file)}
    for told in (models, finger, report.as_dict(), facts, commands, list(measured.notes)):
        clean.learn(told)
    data = {k: v for k, v in clean(_without_unknown(data), numbers=True).items() if v is not None}
    session_text = _session_text(data, session.id)
    table = {name: clean(values) for name, values in columns.items()}

    documents: dict[str, str] = {
        "README.txt": README.format(software=about.get("software", "fingertwin")),
        SESSION_FILE: session_text,
        "cases.csv.json": _json(clean(facts) | {"columns": describe_columns(list(table))}),
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
                **clean(facts),
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
    """Write files in the order of their names, then their checksums; no time, owner or system is told."""
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


def _session_text(data: Mapping[str, Any], name: str) -> str:
    """Return the description of a session as text, if it is still one."""
    session, faults = parse_session(data, None, SESSION_FILE)
    if session is None:
        raise SessionError(
            f"session {name} cannot be read without its private words ({faults[0].found})",
            "ids, postures and numbers that hold no date, path, host or user name",
            "Rename them in the session",
        )
    with TemporaryDirectory() as folder:
        return write_session(session, folder).read_text(encoding="utf-8")


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


def _texts(value: Any, key: str = "") -> Iterator[tuple[str, str]]:
    """Yield every text in plain data with the key that it stands under, and every key."""
    if isinstance(value, Mapping):
        for k, v in value.items():
            yield "", str(k)
            yield from _texts(v, str(k))
    elif isinstance(value, list | tuple):
        for v in value:
            yield from _texts(v, key)
    elif isinstance(value, str):
        yield key, value


def _since_1970(number: float) -> bool:
    """Whether a number may count seconds, ms, us or ns from 1970 to a day between 1990 and 2100."""
    return any(6.3e8 < number / unit < 4.2e9 for unit in (1.0, 1e3, 1e6, 1e9))


def _without_unknown(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {k: _without_unknown(v) for k, v in value.items() if v is not None}
    return [_without_unknown(v) for v in value] if isinstance(value, list | tuple) else value


def _plain(value: Any) -> Any:
    """Return plain JSON: NaN and infinities as null."""
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _json(value: Any) -> str:
    return json.dumps(_plain(value), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _reserved() -> frozenset[str]:
    """Words that a session's description is made of, and their parts."""
    records = [r for r in vars(session_models).values() if isinstance(r, type) and hasattr(r, "model_fields")]
    names = {name for record in records for name in record.model_fields}
    names |= {*vocabulary.TENDONS, *vocabulary.JOINT_ANGLES, *vocabulary.ROLES, *vocabulary.LOCATIONS}
    names |= {*vocabulary.EVENT_KINDS, "loading", "unloading", "slack", "hanger_on", "preload", "left", "right"}
    names |= {"estimate", "force_balance", session_models.FORMAT, READINGS, "finger.yaml"}
    return frozenset(n.lower() for n in {part for name in names for part in (name, *name.split("_"))}) | names


_RESERVED = _reserved()
