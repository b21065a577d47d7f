"""A journal replayed gives the same readings at the same times as when it was recorded, through a lost cable too."""

from __future__ import annotations

import threading
import time
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from daq.acquire import Acquisition
from daq.blocks import Chunk
from daq.drivers.base import LoadCell
from daq.drivers.gauge_lines import GaugeLines
from daq.drivers.robotiq import Robotiq
from daq.errors import DriverError
from daq.journal.reader import JournalReader
from daq.journal.rows import Event
from daq.journal.writer import Journal
from daq.readings import ReadingBlock
from daq.replay import JournalReplay, is_journal
from daq.standins.faults import Faults
from daq.standins.robotiq import RobotiqStandIn
from daq.standins.run import Player
from daq.standins.wires import TcpWire
from daq.transports import connect
from server.commands.log import about_cell
from tests.daq.cal_files import nano17


def keep(run: Acquisition, cell: LoadCell, path: Path) -> str:
    """Write all that is handed on into a new journal; return the stream."""
    with closing(Journal.create(path, "bench")) as journal:
        stream = journal.add_stream(cell.name, cell.values, {}, cell.clock)
        for record in run.records():
            events = [Event(e.kind, e.at_s, e.value) for e in record.events]
            if record.chunk is not None:
                journal.append(stream, record.chunk, events)
            else:
                for event in events:
                    journal.event(Event(event.kind, event.at_s, event.value, stream))
    return stream


def kept(path: Path, stream: str) -> Chunk:
    """A whole stream as one."""
    with JournalReader.open(path) as journal:
        chunks = list(journal.read(stream))
    return Chunk(
        0,
        np.concatenate([c.t_s for c in chunks]),
        np.concatenate([c.wrench for c in chunks]),
        np.concatenate([c.status for c in chunks]),
        np.concatenate([c.overload for c in chunks]),
        b"".join(c.raw for c in chunks),
        [r for c in chunks for r in c.reads],
        0.0,
        sum(c.rejected for c in chunks),
    )


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three seconds of a cell whose cable is pulled once, and whose bytes are damaged."""
    path = tmp_path_factory.mktemp("log") / "journal.sqlite3"
    wire, over, cell = TcpWire(), threading.Event(), Robotiq()
    t_s = np.arange(0.0, 20.0, 0.01)
    block = ReadingBlock(t_s, np.outer(np.sin(t_s), np.arange(1.0, 7.0)))
    faults = Faults(pulled_every_s=1.5, pulled_for_s=0.3, flipped_per_s=6.0, burst_s=0.016)
    player = threading.Thread(target=Player(RobotiqStandIn(), wire, [block], faults).run, args=(over.is_set,))
    player.start()
    run = Acquisition(cell, lambda: connect(cell, wire.address))
    run.start()
    timer = threading.Timer(2.8, run.stop)
    timer.start()
    keep(run, cell, path)
    over.set()
    player.join()
    wire.close()
    return path


@pytest.mark.parametrize("speed", [0.0, 4.0])
def test_the_same_bytes_give_the_same_readings_at_the_same_times(recorded: Path, tmp_path: Path, speed: float) -> None:
    assert is_journal(recorded)
    cell = JournalReplay(recorded, speed=speed)
    began = time.monotonic()
    run = Acquisition(cell, lambda: connect(cell, str(recorded)))
    run.start()
    stream = keep(run, cell, tmp_path / "again.sqlite3")
    assert speed == 0.0 or time.monotonic() - began > 0.5
    old, new = kept(recorded, cell.stream.id), kept(tmp_path / "again.sqlite3", stream)
    assert len(old) > 100
    assert new.raw == old.raw
    assert list(new.reads) == list(old.reads)
    assert (new.wrench == old.wrench).all()
    assert (new.t_s == old.t_s).all()
    assert new.rejected == old.rejected > 0
    with JournalReader.open(tmp_path / "again.sqlite3") as journal:
        kinds = [e.kind for e in journal.events(stream)]
    assert kinds.count("disconnected") == kinds.count("reconnected") >= 1
    # A replay of the replay is the same again.
    assert JournalReplay(tmp_path / "again.sqlite3").decoder().feed(old.raw[:160]).wrench.shape[1] == 6


def test_a_stream_that_is_not_there_is_said(recorded: Path) -> None:
    with pytest.raises(DriverError, match="0 streams in journal"):
        JournalReplay(recorded, "ffffffffffff0")
    with pytest.raises(DriverError, match="speed is -1"):
        JournalReplay(recorded, speed=-1.0)


def test_gauge_volts_are_decoded_by_the_calibration_that_the_journal_holds(tmp_path: Path) -> None:
    path = nano17(tmp_path)
    cell = GaugeLines({"calibration": str(path)})
    with closing(Journal.create(tmp_path / "journal.sqlite3", "bench")) as journal:
        journal.add_stream(cell.name, cell.values, about_cell(cell, {"serial": "FT1"}), cell.clock)
    lines = b"0.1,0.2,0.3,0.4,0.5,0.6\r\n" * 4
    expected = cell.decoder().feed(lines).wrench
    path.unlink()
    again = JournalReplay(tmp_path / "journal.sqlite3")
    assert len(expected) > 1
    assert (again.decoder().feed(lines).wrench == expected).all()
