"""Rows of a replay: exact, in any portions, and never wrong after damage."""

from __future__ import annotations

from collections import deque
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daq.acquisition.acquire import Acquisition
from daq.acquisition.records import Record
from daq.drivers.recorded import ROW, Feed, Replay, RowDecoder, rows_of
from daq.errors import ReadingsError
from daq.recordings.readings import ReadingBlock, write_readings
from tests.settings import load_profile

load_profile()


def block(count: int, seed: int = 0, first_s: float = 0.0) -> ReadingBlock:
    rng = np.random.default_rng(seed)
    status = rng.integers(-5, 5, count)
    return ReadingBlock(first_s + np.arange(count) / 1000.0, rng.normal(size=(count, 6)) * 1e3, status)


@given(st.integers(2, 40), st.lists(st.integers(1, 500), max_size=20), st.integers(0, 1000))
def test_rows_come_back_to_the_last_bit_in_any_portions(count: int, cuts: list[int], seed: int) -> None:
    sent, decoder = block(count, seed), RowDecoder()
    data, got = rows_of(sent), []
    for cut in [*cuts, len(data)]:
        got.append(decoder.feed(data[:cut]))
        data = data[cut:]
    assert (np.concatenate([g.wrench for g in got]) == sent.wrench).all()
    times = [g.device_s for g in got if g.device_s is not None]
    assert (np.concatenate(times) == sent.t_s).all()
    assert sent.status is not None
    assert (np.concatenate([g.status for g in got]) == sent.status).all()


@given(st.integers(0, 71), st.integers(0, 7))
def test_a_flipped_bit_costs_its_row(at: int, bit: int) -> None:
    sent = block(9)
    data = bytearray(rows_of(sent))
    data[4 * ROW.itemsize + at] ^= 1 << bit
    got = RowDecoder().feed(bytes(data))
    assert (got.wrench == np.delete(sent.wrench, 4, axis=0)).all()


def test_a_shipped_session_is_played_by_its_name() -> None:
    transport = Replay({"speed": "0"}).own_transport("DEV-02")
    assert len(RowDecoder().feed(transport.read(0.1)).wrench)


def test_a_recording_plays_in_its_own_time() -> None:
    now = [0.0]

    def wait(seconds: float) -> None:
        now[0] += seconds

    feed = Feed([block(1000, first_s=5.0)], 2.0, clock=lambda: now[0], wait=wait)
    got, ends = RowDecoder(), []
    for _ in range(10_000):
        try:
            data = feed.read(0.01)
        except EOFError:
            break
        if data:
            times = got.feed(data).device_s
            assert times is not None
            ends.append((now[0], times[-1] if len(times) else None))
    # A second of recording at twice its pace, in portions.
    assert len(ends) > 20
    assert 0.45 < now[0] < 0.52
    assert all(t is None or abs((t - 5.0) / 2.0 - at) < 0.03 for at, t in ends)


def test_a_pause_in_a_recording_is_no_connection_that_was_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    """A bench that went on after a break has one; its recording had begun again at the pause, and never ended."""
    monkeypatch.setattr("daq.acquisition.acquire.GIVEN_UP_S", 0.1)
    opened: list[Feed] = []

    def opening() -> Feed:
        opened.append(Feed([block(100), block(100, first_s=1.0)], 1.0))
        return opened[-1]

    run = Acquisition(Replay(), opening, stale_s=0.1)
    run.start()
    records = list(run.records())
    assert [e.kind for r in records for e in r.events] == ["started", "stale", "stale", "gap", "ended"]
    assert sum(len(r.chunk) for r in records if r.chunk is not None) == 200
    assert len(opened) == 1


@pytest.mark.parametrize("at", [1, 70, 100])
@pytest.mark.parametrize("step_s", [0.0, -0.001, -3600.0])
def test_a_recording_is_played_as_far_as_its_time_rises(tmp_path: Path, at: int, step_s: float) -> None:
    sent = block(200, first_s=5.0)
    t_s = sent.t_s.copy()
    t_s[at + 1 :] += t_s[at] - t_s[at + 1] + step_s
    path = write_readings(tmp_path / "readings.csv", [ReadingBlock(t_s, sent.wrench, sent.status)])
    cell = Replay({"speed": "0"})
    run = Acquisition(cell, lambda: cell.own_transport(str(path)))
    run.start()
    records: deque[Record] = deque()
    with pytest.raises(ReadingsError, match=f"time goes from .* in row {at + 2} of readings.csv"):
        records.extend(run.records())
    assert sum(len(r.chunk) for r in records if r.chunk is not None) == at + 1
