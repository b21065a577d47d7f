"""Journals that are filled, torn off and altered."""

from __future__ import annotations

import shutil
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

from daq.journal.check import check
from daq.journal.wal import log_file
from daq.journal.writer import Event, Journal, JournalReader
from tests.daq.journal_writer import made_chunk

COUNT = 50


def written(path: Path, chunks: int = 10, samples: int = COUNT) -> str:
    """A closed journal with one stream; return its id."""
    with Journal.create(path, "bench 1", 0) as journal:
        return fill(journal, chunks, samples)


def fill(journal: Journal, chunks: int, samples: int = COUNT) -> str:
    stream = journal.add_stream("robotiq-ft300", {"port": "COM3"}, {"serial": "FTS-1"}, "counter")
    for i in range(chunks):
        journal.append(stream, made_chunk(i * samples, samples), [Event("mark", float(i), {"i": i})])
    return stream


def torn_off(path: Path) -> Path:
    """A copy of an open journal with its log, as a crash leaves it."""
    crashed = path.with_name("crashed.journal")
    shutil.copyfile(path, crashed)
    shutil.copyfile(log_file(path), log_file(crashed))
    shutil.copyfile(path.with_name(path.name + "-writer"), crashed.with_name(crashed.name + "-writer"))
    return crashed


def kinds(path: Path) -> set[str]:
    return {fault.kind for fault in check(path).faults}


def firsts(path: Path, stream: str) -> list[int]:
    with JournalReader.open(path) as journal:
        return [chunk.first_seq for chunk in journal.read(stream)]


def flip(path: Path, at: int, bit: int = 3) -> None:
    with path.open("r+b") as file:
        file.seek(at)
        octet = file.read(1)[0]
        file.seek(at)
        file.write(bytes([octet ^ 1 << bit]))


def altered(path: Path, statement: str, *values: Any) -> None:
    with closing(sqlite3.connect(path, isolation_level=None)) as connection:
        assert connection.execute(statement, values).rowcount == 1


class Interrupting:
    """A connection with a Ctrl-C just after one statement."""

    def __init__(self, connection: sqlite3.Connection, moment: str) -> None:
        self._connection, self._moment = connection, moment

    def execute(self, query: str, *values: Any) -> Any:
        answer = self._connection.execute(query, *values)
        if query.startswith(self._moment):
            raise KeyboardInterrupt
        return answer

    def __getattr__(self, name: str) -> Any:
        return getattr(self._connection, name)
