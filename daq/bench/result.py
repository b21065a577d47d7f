"""A bench session's folder, written from its journal: also from that of a bench that crashed in the middle."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from daq.bench.record import STARTED, BenchRecord
from daq.errors import InputError, JournalError, SessionError
from daq.files import replacing
from daq.journal.reader import JournalReader
from daq.locations import data_dir
from daq.recordings.readings import ReadingBlock, write_readings
from daq.recordings.windows import gather
from daq.sessions import FINGER_DOCUMENT, SESSION_FILE, parse_session, read_session, write_session
from daq.sessions.models import Session
from daq.sessions.protocols import Protocol, read_protocol
from daq.signals.corrections import assemble, windows_of
from daq.signals.tension_estimate import PUBLISHED_TENSION_FACTOR

READINGS = "readings.csv.gz"
PROTOCOL = "protocol.yaml"


def write_bench_session(
    journal: JournalReader, folder: str | Path, stream: str | None = None, readings: str = READINGS
) -> Session:
    """Write what a journal holds of a bench session as a bench-session/1 folder, and read it back.

    Args:
        journal: that the bench wrote, or still writes.
        folder: that has no session yet; session.yaml appears in it when all else is complete.
        stream: its id or the beginning of it; may be left out where one stream has a bench session.
        readings: name of the readings' file, by which its format is chosen.

    Raises:
        SessionError: the folder has a session, or no case was completed.
        JournalError: there is no such stream, or a chunk is damaged.
        ReadingsError: the readings cannot be written.
    """
    target = Path(folder)
    if (target / SESSION_FILE).exists():
        raise SessionError(f"{target.name} has a {SESSION_FILE}", "a new folder", "Choose another")
    name = _stream(journal, stream)
    record = BenchRecord.of(journal.events(name))
    document = record.document() | {"readings": readings, "provenance": _provenance(journal, name)}
    if not record.closed:
        _say(document, "the session was not closed: written from the journal as far as it goes")
    write_readings(target / readings, _blocks(journal, name))
    document["protocol"] = _with_protocol(record.setup.protocol, record.setup.protocol_name, target)
    document["finger"] = _with_finger(record.setup.finger, target)
    document.pop(FINGER_DOCUMENT, None)  # it lies beside, as a file
    session = _parsed(document, target)
    if isinstance(document["tension_factor"], dict):
        session = _with_factor(session, document, journal, name)
    write_session(session, target)
    return read_session(target)


def _stream(journal: JournalReader, wanted: str | None) -> str:
    begun = {e.stream for e in journal.events() if e.kind == STARTED}
    found = [s.id for s in journal.streams() if s.id in begun and s.id.startswith(wanted or "")]
    if len(found) == 1:
        return found[0]
    ids = " ".join(i[:12] for i in found) or "(there is none)"
    raise JournalError(f"{len(found)} streams of {journal.path.name} have a bench session", "one", f"Name one of {ids}")


def _blocks(journal: JournalReader, stream: str) -> Iterator[ReadingBlock]:
    for chunk in journal.read(stream):
        if len(chunk):
            # A reading beyond the range is flagged also where the device has no status of its own.
            status = np.where(chunk.overload & (chunk.status == 0), 1, chunk.status)
            yield ReadingBlock(chunk.t_s, chunk.wrench, status)


def _provenance(journal: JournalReader, stream: str) -> dict[str, Any]:
    row = next(s for s in journal.streams() if s.id == stream)
    return {
        "bench": journal.bench,
        "driver": row.driver,
        "settings": dict(row.settings),
        "clock": row.clock,
        "started_utc": row.started_utc,
        "stream": stream,
    }


def _with_protocol(protocol: Protocol, name: str, folder: Path) -> str:
    """Name a shipped protocol; keep any other one beside the session."""
    try:
        if (data_dir() / "protocols" / f"{name}.yaml").is_file() and read_protocol(name) == protocol:
            return name
    except InputError:
        pass  # not as it was: keep what was followed
    with replacing(folder / PROTOCOL) as temporary:
        text = yaml.safe_dump(protocol.model_dump(mode="json"), sort_keys=False, allow_unicode=True)
        temporary.write_text(text, encoding="utf-8")
    return PROTOCOL


def _with_finger(finger: str, folder: Path) -> str:
    """Keep a finger of the user's own beside the session; a shipped one has a name."""
    path = Path(finger)
    if not path.is_file():
        return finger
    with replacing(folder / path.name) as temporary:
        shutil.copyfile(path, temporary)
    return path.name


def _parsed(document: dict[str, Any], folder: Path) -> Session:
    session, faults = parse_session(document, folder)
    if session is None:
        raise faults[0]
    return session


def _with_factor(session: Session, document: dict[str, Any], journal: JournalReader, stream: str) -> Session:
    """State the published tension factor, and say so, where it is to be estimated and cannot be."""
    recording = gather(_blocks(journal, stream), windows_of(session), journal.path.name)
    try:
        assemble(session, recording.plateaus)
    except SessionError as error:
        document["tension_factor"] = PUBLISHED_TENSION_FACTOR
        _say(document, f"tension factor {PUBLISHED_TENSION_FACTOR} as published, since {error.found}")
        return _parsed(document, session.folder or Path())
    return session


def _say(document: dict[str, Any], text: str) -> None:
    last = max(case["loaded_s"][1] for case in document["cases"])
    document["events"] = [*document.get("events", ()), {"t_s": last, "kind": "note", "text": text}]
