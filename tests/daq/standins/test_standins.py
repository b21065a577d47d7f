"""A stand-in over a real wire, logged by the sampling thread: what is logged is what was played."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daq.acquisition.acquire import Acquisition
from daq.acquisition.records import Record
from daq.acquisition.transports import connect
from daq.drivers.robotiq import Robotiq
from daq.errors import DriverError
from daq.recordings.readings import ReadingBlock
from daq.standins import stand_in
from daq.standins.faults import Faults
from daq.standins.robotiq import RobotiqStandIn
from daq.standins.run import Player, resampled
from daq.standins.wires import PtyWire, TcpWire, Wire
from tests.daq.standins.heard import Heard

RATE = 100.0


def played(seconds: float) -> ReadingBlock:
    """Fx says the number of the reading, in hundredths of a newton."""
    n = int(seconds * RATE)
    wrench = np.zeros((n, 6))
    wrench[:, 0] = np.arange(n) / 100.0
    wrench[:, 5] = 78.0  # 4E 00: half of a header
    return ReadingBlock(np.arange(n) / RATE, wrench)


class Deaf(RobotiqStandIn):
    """Streams, and at its baud rate understands nothing that it is told."""

    def hear(self, data: bytes) -> bytes:
        self.streaming = True
        return b""


@contextmanager
def playing(
    wire: Wire, seconds: float, faults: Faults | None = None, device: RobotiqStandIn | None = None
) -> Iterator[None]:
    over = threading.Event()
    player = Player(device or RobotiqStandIn(), wire, [played(seconds)], faults)
    thread = threading.Thread(target=player.run, args=(over.is_set,))
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
        wire.close()


def logged(address: str, seconds: float) -> list[Record]:
    cell = Robotiq()
    run = Acquisition(cell, lambda: connect(cell, address), chunk_s=0.05)
    run.start()
    timer = threading.Timer(seconds, run.stop)
    timer.start()
    out = list(run.records())
    timer.join()
    return out


def numbers(records: list[Record]) -> np.ndarray[Any, Any]:
    return np.concatenate([r.chunk.wrench[:, 0] for r in records if r.chunk is not None]) * 100.0


def wires(tmp_path: Path) -> dict[str, Wire]:
    out: dict[str, Wire] = {"tcp": TcpWire()}
    if hasattr(os, "openpty"):
        out["pty"] = PtyWire(str(tmp_path / "cell"))
    return out


def test_what_is_played_is_logged_in_order(tmp_path: Path) -> None:
    for name, wire in wires(tmp_path).items():
        with playing(wire, 30.0):
            records = logged(wire.address, 1.2)
        got = np.rint(numbers(records))
        assert len(got) > 80, name
        assert (np.diff(got) == 1).all(), name
        times = np.concatenate([r.chunk.t_s for r in records if r.chunk is not None])
        assert np.diff(times) == pytest.approx(0.01, abs=0.006)


def test_damage_on_the_way_costs_readings_and_never_invents_one(tmp_path: Path) -> None:
    wire = TcpWire()
    with playing(wire, 30.0, Faults(dropped_per_s=3.0, flipped_per_s=3.0, burst_s=0.016)):
        records = logged(wire.address, 2.5)
    got = np.rint(numbers(records))
    assert np.abs(got - numbers(records)).max() < 1e-9
    assert (np.diff(got) >= 1).all()
    assert any(e.kind == "damaged" for r in records for e in r.events)
    # Each damaged frame costs itself, and at most two that wait for the chain to be whole again.
    assert len(got) > 0.75 * (got[-1] - got[0])


def test_a_pulled_cable_comes_back(tmp_path: Path) -> None:
    for name, wire in wires(tmp_path).items():
        with playing(wire, 30.0, Faults(pulled_every_s=1.0, pulled_for_s=0.4)):
            records = logged(wire.address, 2.7)
        kinds = [e.kind for r in records for e in r.events]
        assert kinds.count("disconnected") >= 1, name
        assert kinds.count("reconnected") >= 1, name
        got = np.rint(numbers(records))
        assert (np.diff(got) >= 1).all(), name
        assert len(got) > 60, name


@pytest.mark.parametrize("name", ["gauge-volts", "optoforce", "robotiq-ft300", "text-lines"])
def test_after_a_pulled_cable_a_device_streams_as_when_it_was_switched_on(name: str) -> None:
    device, wire, now = stand_in(name)(), Heard(), [0.0]
    at_first = device.streaming
    player = Player(device, wire, [played(5.0)], Faults(pulled_every_s=1.0, pulled_for_s=0.5), clock=lambda: now[0])
    sent = []
    for tick in range(20):
        now[0] = 0.1 * tick
        player.turn()
        sent.append(len(wire.data))
    assert sent[10] == sent[14]
    assert (sent[19] > sent[15] > sent[14]) == at_first == device.streaming


def test_the_wrong_baud_rate_is_said() -> None:
    wire, cell = TcpWire(), Robotiq()
    with playing(wire, 30.0, Faults(wrong_baud=True), Deaf()):
        link = connect(cell, wire.address)
        with pytest.raises(DriverError, match="Robotiq FT300"):
            cell.start(link)
        link.close()


def test_readings_at_another_rate_follow_the_same_course() -> None:
    slow = [ReadingBlock(t, np.outer(np.sin(t), np.ones(6))) for t in (np.arange(0, 2, 0.04), np.arange(2, 4, 0.04))]
    fast = list(resampled(slow, 100.0))
    t_s = np.concatenate([b.t_s for b in fast])
    assert np.diff(t_s) == pytest.approx(0.01)
    assert (t_s[0], t_s[-1]) == pytest.approx((0.0, 3.96))
    assert np.concatenate([b.wrench[:, 2] for b in fast]) == pytest.approx(np.sin(t_s), abs=3e-4)


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="this system has no pseudo-terminals")
def test_a_link_takes_the_place_of_an_earlier_link_and_of_nothing_else(tmp_path: Path) -> None:
    mine, link, folder = tmp_path / "data.txt", tmp_path / "cell", tmp_path / "folder"
    mine.write_text("important")
    folder.mkdir()
    for taken in (mine, folder, tmp_path / "none" / "cell"):
        with pytest.raises(DriverError, match=f"the link {taken} cannot be made"):
            PtyWire(str(taken))
    assert (mine.read_text(), folder.is_dir()) == ("important", True)
    link.symlink_to("/dev/gone")
    wire = PtyWire(str(link))
    assert link.resolve().is_char_device()
    # What took the link's place meanwhile is the user's.
    link.unlink()
    link.write_text("mine")
    wire.close()
    assert link.read_text() == "mine"
