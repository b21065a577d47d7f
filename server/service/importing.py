"""A session's folder that was sent as it is: read by what the command line reads folders with, then kept."""

from __future__ import annotations

import base64
import binascii
import hashlib
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from daq.export import sha256_of
from daq.protocols import protocol_names
from daq.readings import ReadingBlock, open_readings
from daq.session_models import Session
from daq.sessions import SESSION_FILE, read_session, read_yaml, whole_document
from daq.uplink.recording import STREAM, chunks_of, description_of, epoch_of
from server.service.ingest import Sent
from server.service.problems import ProblemError, shortened
from server.service.services import Services

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9 ._()+-]{0,99}")
# Of a description: YAML can name one part in many places, and so be far larger than its text.
_MOST_VALUES, _MOST_LEVELS = 300_000, 32


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
        ProblemError: 409 another session has the id; 422 it is no session's folder.
    """
    with TemporaryDirectory(prefix="fingertwin-") as temporary:
        # The folder's name stands in messages.
        folder = Path(temporary) / "the folder"
        folder.mkdir()
        _write(folder, files)
        session = _read(parts, folder)
        source = None if session.readings_path is None else open_readings(session.readings_path)
        if source is not None:
            # Before anything is kept: every row can be used.
            for _ in source.blocks():
                pass
        document = whole_document(session, name)
        new = parts.sessions.create(str(document["id"]), document)
        if source is not None:
            _store(parts, str(document["id"]), session, source.path, source.blocks())
    return str(document["id"]), new


def _write(folder: Path, files: Sequence[tuple[str, str]]) -> None:
    names = [name for name, _ in files]
    if SESSION_FILE not in names:
        there = f"the files {', '.join(names[:5])}" if names else "no file"
        raise ProblemError(
            422, f"{shortened(there)}, none of them {SESSION_FILE}", f"a session's folder: {SESSION_FILE}, readings"
        )
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
    data = read_yaml(folder / SESSION_FILE)
    _require_plain(data)
    if isinstance(data, Mapping):
        here = {p.name for p in folder.iterdir()}
        known = {"readings": here, "finger": here | parts.sessions.fingers, "protocol": here | {*protocol_names()}}
        for key, names in known.items():
            value = data.get(key)
            # Nothing outside of the folder is looked at, whatever the description says.
            if isinstance(value, str) and value not in names and (key != "protocol" or _is_path(value)):
                raise ProblemError(
                    422,
                    f"{SESSION_FILE}: {key} names {shortened(value)!r}, which is not among the files",
                    f"one of {', '.join(sorted(here - {SESSION_FILE})) or 'the files that are sent'}"[:300],
                    "Choose the whole folder",
                )
    return read_session(folder)


def _is_path(value: str) -> bool:
    return "/" in value or "\\" in value


def _require_plain(data: Any) -> None:
    """Refuse a description that is far larger than its text, or holds itself."""
    level, count = [data] if isinstance(data, dict | list) else [], 0
    for _ in range(_MOST_LEVELS):
        if not level:
            return
        count += sum(map(len, level))
        if count > _MOST_VALUES:
            raise ProblemError(422, f"{SESSION_FILE} with more than {_MOST_VALUES} values", "a session's description")
        values = (v for item in level for v in (item.values() if isinstance(item, dict) else item))
        level = [v for v in values if isinstance(v, dict | list)]
    raise ProblemError(422, f"{SESSION_FILE} with more than {_MOST_LEVELS} levels", "a session's description")


def _store(parts: Services, name: str, session: Session, file: Path, blocks: Iterator[ReadingBlock]) -> None:
    digest = sha256_of(file)
    description = description_of(session, file, digest)
    cursor = parts.ingest.describe(name, STREAM, json.dumps(description, sort_keys=True).encode())
    if cursor["ended"] and not cursor["missing"]:
        return
    for chunk in chunks_of(blocks):
        body = chunk.to_bytes()
        sent = Sent(body, hashlib.sha256(body).hexdigest(), epoch_of(digest))
        parts.ingest.put_chunk(name, STREAM, chunk.first_seq, len(chunk), sent)
