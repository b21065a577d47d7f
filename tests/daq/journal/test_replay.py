"""A journal replayed gives the same readings at the same times as when it was recorded, through a lost cable too."""

from __future__ import annotations

import threading
import time
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from daq.acquisition.acquire import Acquisition
from daq.acquisition.blocks import Chunk
from daq.acquisition.transports import connect
from daq.drivers.base import LoadCell, Transport
from daq.drivers.gauge_lines import GaugeLines
from daq.drivers.robotiq import Robotiq
from daq.errors import DriverError, JournalError
from daq.journal.export import export
from daq.journal.reader import JournalReader
from daq.journal.replay import JournalReplay, _reads, is_journal
from daq.journal.rows import Event
from daq.journal.writer import Journal
from daq.recordings.readings import ReadingBlock
from daq.standins.faults import Faults
from daq.standins.robotiq import RobotiqStandIn
from daq.standins.run import Player
from daq.standins.wires import TcpWire
from server.commands.log_parts import about_cell
from tests.daq.acquisition.test_acquire import Portions
from tests.daq.cal_files import nano17


def keep(run: Acquisition, cell: LoadCell, path: Path) -> str:
    """Write all that is handed on into a new journal; return the stream."""
    with closing(Journal.create(path, "bench")) as journal:
        stream = journal.add_stream(cell.name, cell.values, {}, cell.clock)
        for record in run.records():
            journal.keep(stream, record.chunk, [Event(e.kind, e.at_s, e.value) for e in record.events])
    return stream


def kept(path: Path, stream: str) -> Chunk:
    """A whole stream as one, with the bytes that made no reading."""
    with JournalReader.open(path) as journal:
        chunks, without = list(journal.read(stream)), list(journal.undecoded(stream))
    reads = [(len(data), arrival_s, data) for arrival_s, data in _reads(path, stream)]
    return Chunk(
        0,
        np.concatenate([c.t_s for c in chunks]),
        np.concatenate([c.wrench for c in chunks]),
        np.concatenate([c.status for c in chunks]),
        np.concatenate([c.overload for c in chunks]),
        b"".join(data for _, _, data in reads),
        [(size, arrival_s) for size, arrival_s, _ in reads],
        0.0,
        sum(c.rejected for c in [*chunks, *without]),
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


class Odd(Robotiq):
    """Robotiq's, whose bytes are not understood for a while; it says something as it starts."""

    def start(self, transport: Transport) -> None:
        transport.read(1.0)

    def stop(self, transport: Transport) -> None:
        """It only ever streams."""


def test_what_was_not_understood_is_replayed_in_its_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("daq.acquisition.acquire.UNDECODED_S", 0.02)
    frames = RobotiqStandIn().encode(np.outer(np.arange(40.0), np.ones(6)), np.arange(40), np.zeros(40))
    # The first frame is cut by reads; two ends of frames stand around bytes that make no sense for a while.
    portions = [
        frames[0][:9],
        frames[0][9:],
        *frames[1:20],
        frames[20][:7],
        *[b"?" * 5] * 30,
        frames[20][7:],
        *frames[21:],
    ]
    cell, link = Odd(), Portions([*portions])
    run = Acquisition(cell, lambda: link, chunk_s=0.005)
    run.start()
    path, again = tmp_path / "journal.sqlite3", tmp_path / "again.sqlite3"
    stream = keep(run, cell, path)
    with JournalReader.open(path) as journal:
        assert sum(len(c.raw) for c in journal.undecoded(stream)) > 50
    old = kept(path, stream)
    assert old.raw == b"".join(portions)
    # The readings around: but for those beside the damage, and the last one.
    assert 36 <= len(old) < 40
    replay = JournalReplay(path, speed=0.0)
    run = Acquisition(replay, lambda: connect(replay, str(path)))
    run.start()
    new = kept(again, keep(run, replay, again))
    assert (new.raw, list(new.reads)) == (old.raw, list(old.reads))
    assert (new.wrench == old.wrench).all()
    assert (new.t_s == old.t_s).all()


def test_a_stream_that_is_not_there_is_said(recorded: Path) -> None:
    with pytest.raises(DriverError, match="0 streams called ffffffffffff0 in journal"):
        JournalReplay(recorded, "ffffffffffff0")
    with pytest.raises(DriverError, match="speed is -1"):
        JournalReplay(recorded, speed=-1.0)


def test_two_streams_are_told_with_commands_that_take_one(tmp_path: Path) -> None:
    path, cell = tmp_path / "journal.sqlite3", Robotiq()
    with closing(Journal.create(path, "bench")) as journal:
        ids = [journal.add_stream(cell.name, cell.values, {}, cell.clock)[:12] for _ in range(2)]
    with pytest.raises(DriverError, match="fingertwin log --driver replay .* --set stream=ID .* of " + " ".join(ids)):
        JournalReplay(path)
    with pytest.raises(JournalError, match="fingertwin journal export .* --stream ID; .* of " + " ".join(ids)):
        export(path, tmp_path / "out.csv")


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
