"""Rows of a replay: exact, in any portions, and never wrong after damage."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from daq.drivers.recorded import ROW, Feed, Replay, RowDecoder, rows_of
from daq.recordings.readings import ReadingBlock
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
