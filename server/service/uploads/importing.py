"""A session's folder that was sent as it is: read by what the command line reads folders with, then kept."""

from __future__ import annotations

import base64
import binascii
import gzip
import json
import math
import re
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from zipfile import BadZipFile, ZipFile

from daq.checks import check
from daq.export.tables import sha256_of
from daq.locations import data_dir
from daq.recordings.parquet_pages import unpacked_bytes
from daq.recordings.readings import ReadingBlock, ReadingSource, open_readings
from daq.recordings.windows import require_increasing
from daq.sessions import SESSION_FILE, read_session, read_yaml, whole_document
from daq.sessions.models import Session
from daq.sessions.protocols import protocol_names
from daq.uplink.recording import STREAM, chunks_of, description_of, epoch_of
from server.service.ingest.ingest import Sent
from server.service.services import Services
from server.service.storage.checksums import digest_of
from server.service.web.problems import ProblemError, shortened
from server.service.web.workers import require_client

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9 ._()+-]{0,99}")
# Of a description: YAML can name one part in many places, and so be far larger than its text.
_MOST_VALUES, _MOST_LEVELS = 300_000, 32
# Of one import's readings: 80 minutes at 1 kHz, in twice as many bytes as their text needs.
MOST_ROWS, MOST_BYTES = 5_000_000, 1 << 30


def import_folder(parts: Services, files: Sequence[tuple[str, str]], name: str | None) -> tuple[str, bool]:
    """Read a session's folder and keep it with its readings; the very same folder again changes nothing.

    Args:
        parts: of the service.
        files: name and content, base64, of each.
        name: the session's id; by default as its description says.

    Returns:
        the id, and whether it is new.

    Raises:
        InputError: the session, its readings or its finger cannot be used; the line names the place.
        ProblemError: 409 another session has the id; 413 its readings are too many; 422 it is no session's folder.
        GoneError: the client has gone; nothing is kept.
    """
    names = [name for name, _ in files]
    if SESSION_FILE not in names:
        there = f"the files {', '.join(names[:5])}" if names else "no file"
        raise ProblemError(
            422, f"{shortened(there)}, none of them {SESSION_FILE}", f"a session's folder: {SESSION_FILE}, readings"
        )
    with TemporaryDirectory(prefix="fingertwin-") as temporary:
        # The folder's name stands in messages.
        folder = Path(temporary) / "the folder"
        folder.mkdir()
        write_files(folder, files)
        return keep_session(parts, _read(parts, folder), name)


def import_example(parts: Services, name: str) -> tuple[str, bool]:
    """Keep a session that comes with the software; the answer and the rest as of `import_folder`.

    Raises:
        ProblemError: 404 there is none of the name; 409 another session has the id.
    """
    known = sorted(p.name for p in (data_dir() / "sessions").iterdir() if p.is_dir())
    if name not in known:
        raise ProblemError(404, f"there is no example {shortened(name)}", f"one of {', '.join(known)}")
    return keep_session(parts, read_session(data_dir() / "sessions" / name), None)


def keep_session(parts: Services, session: Session, name: str | None) -> tuple[str, bool]:
    """Keep a session with all of its readings, or nothing of it; what it returns and raises as of `import_folder`."""
    document = whole_document(session, name)
    known = str(document["id"])
    if session.readings_path is None:
        _require_sound(session)
        return known, parts.sessions.create(known, document) == "new"
    require_unpacked(session.readings_path)
    source = open_readings(session.readings_path)
    # Before anything is kept: every row can be used.
    for _ in _limited(source):
        pass
    _require_sound(session)
    begun = parts.sessions.create(known, document, arriving=True)
    try:
        _store(parts, known, session, source, hidden=begun == "new")
        if begun == "new":
            parts.sessions.arrive(known)
    except BaseException:
        if begun == "new":
            parts.sessions.forget_arrivals(known)
        elif begun == "back":
            parts.sessions.delete(known)
        raise
    return known, begun == "new"


def _require_sound(session: Session) -> None:
    """Refuse a session with anything that makes it unusable, such as a window outside its recording."""
    if errors := check(session).errors:
        more = f" ({len(errors)} faults)" if len(errors) > 1 else ""
        where = f"{errors[0].where}: " if errors[0].where else ""
        raise ProblemError(422, f"{where}{errors[0].text}{more}", remedy="Mend it in the folder, and send it again")


def write_files(folder: Path, files: Sequence[tuple[str, str]]) -> None:
    """Write files that were sent into a folder.

    Args:
        folder: that is empty.
        files: name and content, base64, of each.

    Raises:
        ProblemError: 422 a name that no file should have, one twice, or what is no base64.
    """
    names = [name for name, _ in files]
    twice = [n for i, n in enumerate(names) if n.casefold() in {m.casefold() for m in names[:i]}]
    if twice:
        raise ProblemError(422, f"file {shortened(twice[0])!r} twice", "each file once")
    for name, content in files:
        if not _NAME.fullmatch(name):
            raise ProblemError(422, f"a file called {shortened(name)!r}", "letters, digits, spaces and . _ - ( ) +")
        try:
            (folder / name).write_bytes(base64.b64decode(content, validate=True))
        except (binascii.Error, ValueError) as error:
            raise ProblemError(422, f"the content of {shortened(name)} ({error})", "base64") from error


def _read(parts: Services, folder: Path) -> Session:
    data = read_yaml(folder / SESSION_FILE, SESSION_FILE)
    require_plain(data)
    if isinstance(data, Mapping):
        here = {p.name for p in folder.iterdir()}
        known = {"readings": here, "finger": here | parts.sessions.fingers, "protocol": here | {*protocol_names()}}
        for key, names in known.items():
            value = data.get(key)
            # Nothing outside of the folder is looked at, whatever the description says.
            outside = value if isinstance(value, str) and value not in names else None
            if outside is not None and (key != "protocol" or "/" in outside or "\\" in outside):
                raise ProblemError(
                    422,
                    f"{SESSION_FILE}: {key} names {shortened(outside)!r}, which is not among the files",
                    f"one of {', '.join(sorted(here - {SESSION_FILE})) or 'the files that are sent'}"[:300],
                    "Choose the whole folder",
                )
    return read_session(folder)


def require_plain(data: Any, what: str = SESSION_FILE) -> None:
    """Refuse a description, as read from YAML, that is far larger than its text, or holds itself.

    Raises:
        ProblemError: 422 it is.
    """
    level, count = [data] if isinstance(data, dict | list) else [], 0
    for _ in range(_MOST_LEVELS):
        if not level:
            return
        count += sum(map(len, level))
        if count > _MOST_VALUES:
            raise ProblemError(422, f"{what} with more than {_MOST_VALUES} values", "a description")
        values = (v for item in level for v in (item.values() if isinstance(item, dict) else item))
        level = [v for v in values if isinstance(v, dict | list)]
    raise ProblemError(422, f"{what} with more than {_MOST_LEVELS} levels", "a description")


def require_unpacked(file: Path, most: int | None = None) -> None:
    """Refuse a file that would be far larger unpacked, before all of it is.

    Args:
        file: gzip, Parquet, or a spreadsheet, which is a zip archive; others are as large as they are.
        most: bytes unpacked; by default as of an import.

    Raises:
        ProblemError: 413 it would.
        GoneError: the client has gone.
    """
    most = most or MOST_BYTES
    with file.open("rb") as stream:
        start = stream.read(4)
    if start == b"PAR1":
        from pyarrow import ArrowException
        from pyarrow.parquet import ParquetFile

        try:
            with ParquetFile(file) as table:
                rows = table.metadata.num_rows
            size = unpacked_bytes(file)
        except (ArrowException, OSError):
            return  # said with its place when it is read
        if rows > MOST_ROWS or size > most:
            raise too_large(f"{rows} rows in {size} bytes", most)
    elif start == b"PK\x03\x04":
        with suppress(BadZipFile, OSError), ZipFile(file) as archive:
            size = sum(part.file_size for part in archive.infolist())
            if size > most:
                raise too_large(f"{size} bytes", most)
    elif start[:2] == b"\x1f\x8b":
        size = 0
        with suppress(EOFError, OSError, zlib.error), gzip.open(file) as packed:
            while piece := packed.read(1 << 20):
                require_client()
                size += len(piece)
                if size > most:
                    raise too_large(f"more than {most} bytes", most)


def _limited(source: ReadingSource) -> Iterator[ReadingBlock]:
    """Yield readings whose time rises, as long as they are not too many and somebody waits for them.

    Raises:
        ReadingsError: they cannot be used.
        ProblemError: 413 they are too many.
        GoneError: the client has gone.
    """
    rows, last = 0, -math.inf
    for block in source.blocks():
        require_client()
        if not len(block):
            continue
        require_increasing(block.t_s, last, rows, source.path.name)
        rows, last = rows + len(block), float(block.t_s[-1])
        if rows > MOST_ROWS:
            raise too_large(f"more than {MOST_ROWS} rows")
        yield block


def too_large(found: str, most: int | None = None) -> ProblemError:
    """Return the refusal of readings that are too many."""
    return ProblemError(
        413,
        f"readings of {found}",
        f"at most {MOST_ROWS} rows in {most or MOST_BYTES} bytes unpacked",
        "Send a longer recording in parts: fingertwin replay SESSION --to ADDRESS --speed max",
    )


def _store(parts: Services, name: str, session: Session, source: ReadingSource, *, hidden: bool) -> None:
    digest = sha256_of(source.path)
    description = json.dumps(description_of(session, source.path, digest), sort_keys=True)
    cursor = parts.ingest.describe(name, STREAM, description.encode(), hidden=hidden)
    if cursor["ended"] and not cursor["missing"]:
        return
    for chunk in chunks_of(_limited(source)):
        body = chunk.to_bytes()
        sent = Sent(body, digest_of(body), epoch_of(digest))
        parts.ingest.put_chunk(name, STREAM, chunk.first_seq, len(chunk), sent, hidden=hidden)
