"""The uplink's thread over a real connection, and what crosses the wire."""

from __future__ import annotations

import threading
import time
from email.utils import formatdate
from itertools import pairwise
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daq.acquisition.blocks import Chunk
from daq.drivers.robotiq import HEADER, Robotiq, with_crc
from daq.errors import InputError
from daq.journal.writer import Event, Journal
from daq.uplink.parts import part
from daq.uplink.thread import Uplink
from daq.uplink.wire import Cursor, retry_after_s, without
from tests.contracts.ingest import SmallReceiver, made, serving


@pytest.fixture
def journal(tmp_path: Path) -> Journal:
    return Journal.create(tmp_path / "bench.journal", "bench", 0)


def test_a_thread_sends_what_is_appended_while_it_runs(journal: Journal, tmp_path: Path) -> None:
    receiver = SmallReceiver(tmp_path / "service.db")
    session = receiver.new_session()
    stream = journal.add_stream("made", {}, {})
    with serving(receiver.handle) as url:
        uplink = Uplink(journal, url, session)
        uplink.start()
        for i in range(20):
            journal.append(stream, made(i * 30, 30), [Event("mark", float(i), {"i": i})])
            uplink.wake()
        assert uplink.flush(20.0)
        assert receiver.stored(session, stream) == [made(i * 30, 30).to_bytes() for i in range(20)]
        assert [e["value"]["i"] for e in receiver.events(session)] == list(range(20))
        journal.append(stream, made(600, 30))
        assert uplink.flush(20.0)
        assert len(receiver.stored(session, stream)) == 21
        status = uplink.status()
        uplink.stop()
    assert (status.sent, status.quarantined, status.problem) == (21, 0, None)
    assert journal.pending() == []
    journal.close()


def test_a_service_that_comes_late_and_goes_away_costs_nothing(journal: Journal, tmp_path: Path) -> None:
    receiver = SmallReceiver(tmp_path / "service.db")
    session = receiver.new_session()
    stream = journal.add_stream("made", {}, {})
    with serving(receiver.handle) as url:
        port = int(url.rpartition(":")[2])
    uplink = Uplink(journal, url, session, chance=lambda: 0.0)
    uplink.start()
    journal.append(stream, made(0, 30))
    assert not uplink.flush(0.2)
    problem = uplink.status().problem
    assert problem is not None
    assert problem.startswith("no answer")
    with serving(receiver.handle, port):
        assert uplink.flush(20.0)
    journal.append(stream, made(30, 30))
    with serving(receiver.handle, port):
        assert uplink.flush(20.0)
        assert uplink.status().problem is None
    uplink.stop()
    journal.close()
    assert receiver.stored(session, stream) == [made(0, 30).to_bytes(), made(30, 30).to_bytes()]


def test_appending_does_not_wait_for_a_service_that_hangs(journal: Journal, tmp_path: Path) -> None:
    hung, go_on = threading.Event(), threading.Event()

    def hanging(request: httpx.Request) -> httpx.Response:
        hung.set()
        go_on.wait(20.0)
        raise httpx.ReadTimeout("too late")

    stream = journal.add_stream("made", {}, {})
    with serving(hanging) as url:
        uplink = Uplink(journal, url, "S")
        uplink.start()
        assert hung.wait(10.0)
        began = time.monotonic()
        for i in range(10):
            journal.append(stream, made(i * 30, 30))
            uplink.wake()
        took_s = time.monotonic() - began
        assert not go_on.is_set()
        go_on.set()
        uplink.stop()
    assert took_s < 5.0
    assert len(journal.pending()) == 10
    journal.close()


def test_a_failure_within_the_uplink_is_said_and_survived(journal: Journal, tmp_path: Path) -> None:
    receiver = SmallReceiver(tmp_path / "service.db")
    session = receiver.new_session()
    stream = journal.add_stream("made", {}, {})
    journal.append(stream, made(0, 30))
    failures = [KeyError("made up"), ZeroDivisionError("made up")]

    def failing(request: httpx.Request) -> httpx.Response:
        if failures:
            raise failures.pop()
        return receiver.handle(request)

    client = httpx.Client(base_url="http://service", transport=httpx.MockTransport(failing))
    uplink = Uplink(journal, "http://service", session, client=client)
    uplink.start()
    waited = time.monotonic() + 10.0
    while not (problem := uplink.status().problem) and time.monotonic() < waited:
        time.sleep(0.005)
    assert problem is not None
    assert "ZeroDivisionError" in problem
    assert uplink.flush(20.0)
    uplink.stop()
    journal.close()
    assert len(receiver.stored(session, stream)) == 1


def test_a_session_that_the_service_does_not_begin_is_told_at_once_and_as_the_cause(journal: Journal) -> None:
    def refusing(request: httpx.Request) -> httpx.Response:
        if request.method == "POST":
            return httpx.Response(422, json={"detail": "a finger of wood"})
        return httpx.Response(404, json={"detail": "there is no session S"})

    client = httpx.Client(base_url="http://service", transport=httpx.MockTransport(refusing))
    uplink = Uplink(journal, "http://service", "S", client=client, begins=True)
    journal.append(journal.add_stream("made", {}, {}), made(0, 30))
    uplink.step()
    refusal = "the service says 422 a finger of wood"
    assert journal.alarms.get_nowait() == ("session_refused", f"session S was not begun: {refusal}")
    uplink.step()
    assert uplink.status().problem == f"{refusal}; the service says 404 there is no session S"
    uplink.stop()
    journal.close()


def test_readings_of_a_session_do_not_go_to_another_of_its_name(journal: Journal) -> None:
    there, asked = [409], []

    def answering(request: httpx.Request) -> httpx.Response:
        asked.append(request.url.path)
        if request.method == "POST":
            return httpx.Response(there[0], json={"detail": "session S is there, and differs"})
        return httpx.Response(404, json={"detail": "no such stream"})

    client = httpx.Client(base_url="http://service", transport=httpx.MockTransport(answering))
    clock = [0.0]
    uplink = Uplink(
        journal, "http://service", "S", client=client, begins=True, document={"id": "S"}, clock=lambda: clock[0]
    )
    journal.append(journal.add_stream("made", {}, {}), made(0, 30))
    for _ in range(3):
        uplink.step()
        clock[0] += 100.0
    assert set(asked) == {"/api/v1/sessions"}
    refusal = "the service says 409 session S is there, and differs"
    assert uplink.status().problem == refusal
    assert journal.alarms.get_nowait() == ("session_refused", f"session S was not begun: {refusal}")
    assert journal.alarms.empty()
    there[0] = 201  # it was removed there
    uplink.step()
    uplink.step()
    assert refusal not in (uplink.status().problem or "")
    assert len(set(asked)) == 2
    uplink.stop()
    journal.close()


@pytest.mark.parametrize("url", ["bench-pc:8000", "ftp://bench-pc", "", "http://", "http://a:b"])
def test_no_address_is_said_in_one_line(journal: Journal, url: str) -> None:
    with pytest.raises(InputError, match="http://bench-pc:8000") as caught:
        Uplink(journal, url, "S")
    assert "\n" not in str(caught.value)
    journal.close()


# ----- a chunk in parts


def robotiq_chunk(records: int, cuts: list[int]) -> Chunk:
    """A chunk that came in reads that ended at these bytes, with what they decode to."""
    rng = np.random.default_rng(records)
    counts = rng.integers(-3000, 3000, (records, 6)).astype("<i2")
    stream = b"".join(with_crc(HEADER + row.tobytes()) for row in counts)
    ends = sorted({len(stream), *(c % len(stream) for c in cuts)} - {0})
    reads = [(b - a, 0.01 * i) for i, (a, b) in enumerate(zip([0, *ends[:-1]], ends, strict=True))]
    got = Robotiq().decoder().feed(stream)
    t_s = np.arange(len(got)) / 100.0
    return Chunk(7, t_s, got.wrench, got.status, got.overload, stream, reads, 1e9, got.rejected, got.skipped)


@given(st.integers(2, 40), st.lists(st.integers(0, 10_000), max_size=60), st.lists(st.integers(0, 10_000), max_size=6))
def test_parts_decode_as_the_whole(records: int, cuts: list[int], bounds: list[int]) -> None:
    whole = robotiq_chunk(records, cuts)
    at = sorted({0, len(whole), *(b % len(whole) for b in bounds)})
    parts = [part(whole, a, b) for a, b in pairwise(at)]
    # As they are sent and stored.
    parts = [Chunk.from_bytes(p.to_bytes()) for p in parts]
    assert [p.first_seq for p in parts] == [7 + a for a in at[:-1]]
    assert b"".join(p.raw for p in parts) == whole.raw
    assert [tuple(r) for p in parts for r in p.reads] == whole.reads
    assert (np.concatenate([p.wrench for p in parts]) == whole.wrench).all()
    assert (np.concatenate([p.t_s for p in parts]) == whole.t_s).all()
    decoder, decoded = Robotiq().decoder(), []
    for piece in parts:
        begin = 0
        for size, _ in piece.reads:
            decoded.append(decoder.feed(piece.raw[begin : begin + size]).wrench)
            begin += size
        assert begin == len(piece.raw)
    assert (np.concatenate(decoded) == whole.wrench).all()
    # A part of a part is that part of the whole: what was sent before a restart is known again after it.
    middle = len(whole) // 2
    assert part(whole, 0, middle).to_bytes() == part(Chunk.from_bytes(whole.to_bytes()), 0, middle).to_bytes()


def test_parts_are_smaller_than_the_whole_in_proportion() -> None:
    whole = robotiq_chunk(200, list(range(0, 3200, 32)))
    sizes = [len(part(whole, a, a + 50).to_bytes()) for a in range(0, 200, 50)]
    assert max(sizes) < 0.3 * len(whole.to_bytes())


# ----- answers


@pytest.mark.parametrize(
    "value",
    [
        None, [], "x", {}, {"next_seq": 5}, {"next_seq": -1, "missing": []}, {"next_seq": True, "missing": []},
        {"next_seq": 5.0, "missing": []}, {"next_seq": 5, "missing": [[0]]}, {"next_seq": 5, "missing": [[0, 6]]},
        {"next_seq": 5, "missing": [[3, 3]]}, {"next_seq": 5, "missing": [[2, 3], [0, 1]]},
        {"next_seq": 5, "missing": [["0", "1"]]}, {"next_seq": 5, "missing": {}},
    ],
)  # fmt: skip
def test_what_is_no_answer_acknowledges_nothing(value: object) -> None:
    with pytest.raises(ValueError, match="no "):
        Cursor.of_answer(value)


def test_a_cursor_holds_what_is_neither_missing_nor_beyond() -> None:
    cursor = Cursor.of_answer({"next_seq": 10, "missing": [[2, 4]], "ended": False, "epoch": "e"})
    held = {(a, b) for a in range(12) for b in range(a, 12) if cursor.holds(a, b)}
    assert held == {(a, b) for a, b in [*_within(0, 2), *_within(4, 10)] if a < b}
    assert Cursor(10, ended=True).holds(10, 10)


def _within(begin: int, end: int) -> list[tuple[int, int]]:
    return [(a, b) for a in range(begin, end + 1) for b in range(a, end + 1)]


_RANGES = st.lists(st.tuples(st.integers(0, 20), st.integers(0, 20)), max_size=4)


@given(_RANGES, _RANGES)
def test_ranges_without_others_are_the_numbers_that_are_left(some: list[Any], gone: list[Any]) -> None:
    left = {n for a, b in without(some, gone) for n in range(a, b)}
    assert left == {n for a, b in some for n in range(a, b)} - {n for a, b in gone for n in range(a, b)}


@pytest.mark.parametrize(
    ("headers", "asked_s"),
    [
        ({}, None),
        ({"Retry-After": "12"}, 12.0),
        ({"Retry-After": "999999999999"}, 3600.0),
        ({"Retry-After": "-5"}, None),
        ({"Retry-After": "soon"}, None),
        ({"Retry-After": formatdate(1030, usegmt=True)}, 30.0),
        ({"Retry-After": formatdate(900, usegmt=True)}, 0.0),
        # The clock here is wrong by a day: the service's own says 30 s.
        ({"Retry-After": formatdate(87430, usegmt=True), "Date": formatdate(87400, usegmt=True)}, 30.0),
    ],
)
def test_how_long_the_service_asks_for(headers: dict[str, str], asked_s: float | None) -> None:
    assert retry_after_s(headers, 1000.0) == asked_s
