"""Ctrl-C or another such signal while a log writes: it ends the log, and breaks into nothing that is being written."""

from __future__ import annotations

import signal
import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daq.acquisition.acquire import Acquisition
from daq.drivers.recorded import Replay
from daq.journal.check import check
from daq.journal.writer import Journal
from daq.recordings.readings import ReadingBlock, write_readings
from server.bench.ending import ENDING
from server.commands.log import Logging


class Pressed:
    """A connection during whose statement of one kind, the n-th time, a signal comes."""

    def __init__(
        self, connection: sqlite3.Connection, moment: str, nth: int, number: signal.Signals = signal.SIGINT
    ) -> None:
        self._connection, self._moment, self._left, self._number = connection, moment, nth, number

    def execute(self, query: str, *values: Any) -> Any:
        answer = self._connection.execute(query, *values)
        self._left -= query.startswith(self._moment)
        if not self._left:
            self._left = -1
            signal.raise_signal(self._number)
        return answer

    def __getattr__(self, name: str) -> Any:
        return getattr(self._connection, name)


@pytest.fixture
def acquisition(tmp_path: Path) -> Iterator[Acquisition]:
    """Of a recording that is ten chunks long."""
    t_s = np.arange(40_000) / 1000.0
    path = write_readings(tmp_path / "played.parquet", [ReadingBlock(t_s, np.outer(t_s, np.ones(6)))])
    cell = Replay({"speed": "0"})
    run = Acquisition(cell, lambda: cell.own_transport(str(path)), chunk_s=1e-9)
    run.start()
    yield run
    run.stop()


@pytest.mark.parametrize("moment", ["BEGIN", "INSERT INTO chunks", "INSERT INTO outbox", "COMMIT"])
@pytest.mark.parametrize("nth", [2, 5])
@pytest.mark.parametrize("number", ENDING)
def test_what_was_read_is_all_written_wherever_a_signal_falls(
    acquisition: Acquisition, moment: str, nth: int, number: signal.Signals, tmp_path: Path
) -> None:
    handler = signal.getsignal(number)
    path = tmp_path / "journal.sqlite3"
    with Journal.create(path, "bench", 0) as journal:
        logging = Logging(journal, acquisition.cell, {}, quiet=True)
        journal._connection = Pressed(journal._connection, moment, nth, number)  # type: ignore[assignment]
        told = logging.run(acquisition)
        [ended] = [e for e in journal.events() if e.kind == "ended"]
        chunks = list(journal.read(logging.stream))
    # The device's thread says how many readings it handed on; none is lost, and none is there twice.
    assert told["samples"] == ended.value["samples"] == sum(len(c) for c in chunks) > 0
    assert [c.first_seq for c in chunks] == np.cumsum([0, *(len(c) for c in chunks[:-1])]).tolist()
    assert check(path).faults == ()
    assert signal.getsignal(number) is handler


def test_a_second_ctrl_c_breaks_off_and_what_was_kept_stays(acquisition: Acquisition, tmp_path: Path) -> None:
    path = tmp_path / "journal.sqlite3"
    with Journal.create(path, "bench", 0) as journal:
        logging = Logging(journal, acquisition.cell, {}, quiet=True)
        once = Pressed(journal._connection, "INSERT INTO outbox", 3)
        journal._connection = Pressed(once, "INSERT INTO outbox", 3)  # type: ignore[arg-type, assignment]
        with pytest.raises(KeyboardInterrupt):
            logging.run(acquisition)
    report = check(path)
    assert report.faults == ()
    assert report.chunks[logging.stream] == 2
