"""A session of the service as a bench-session/1 folder, for exports, checks and reports."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import yaml

from daq.errors import SessionError
from daq.files import replacing
from daq.recordings.readings import write_readings
from daq.recordings.windows import Span
from daq.sessions import FINGER_DOCUMENT, parse_session
from daq.sessions.models import Session
from daq.sessions.protocols import protocol_names
from server.service.ingest.windows import blocks_of
from server.service.services import Services
from server.service.sessions.measuring import Measured

READINGS = "readings.parquet"


@contextmanager
def session_folder(parts: Services, measured: Measured) -> Iterator[tuple[Path, Session]]:
    """Write a session's readings, and the finger that it brings with it, into a temporary folder.

    Yields:
        the folder, which is gone afterwards, and the session as kept in it; its description is not written.

    Raises:
        InputError: the session cannot be used, or has no readings for its windows.
    """
    with TemporaryDirectory(prefix="fingertwin-") as temporary:
        folder = Path(temporary) / measured.record.id
        folder.mkdir()
        yield folder, _written(parts, measured, folder)


def _written(parts: Services, measured: Measured, folder: Path) -> Session:
    record = measured.record
    whole = record.session()
    data = dict(record.document or {})
    data.pop("readings", None)
    windows: list[Span] = [w for c in whole.cases for _, w in c.windows()]
    if windows or whole.checks:
        if record.stream is None:
            raise SessionError(f"session {record.id} has windows and no readings", "readings, or forces")
        with parts.database.reading() as connection:
            write_readings(folder / READINGS, blocks_of(connection, record.id, record.stream))
        data["readings"] = READINGS
    finger = data.pop(FINGER_DOCUMENT, None)
    if finger is not None:
        data["finger"] = "finger.yaml"
        with replacing(folder / "finger.yaml") as temporary:
            temporary.write_text(yaml.safe_dump(finger, sort_keys=False, allow_unicode=True), encoding="utf-8")
    if data.get("protocol") not in protocol_names():
        # A file of the bench: a path that came over the network is not looked up here.
        data.pop("protocol", None)
    if data == record.document:
        return whole.in_folder(folder)
    session, faults = parse_session(data, folder)
    if session is None:
        raise faults[0]
    return session
