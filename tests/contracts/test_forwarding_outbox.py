"""The outbox of a journal and its uplink: what is noted when, on a full disk too, and what goes into it again."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from daq.journal.writer import Event
from tests.contracts.forwarding import Bench, fill, joined
from tests.contracts.ingest import made


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    out = Bench(tmp_path)
    yield out
    out.close()


def test_an_event_that_is_damaged_on_the_disk_holds_up_none_that_comes_after_it_was_sent(bench: Bench) -> None:
    fill(bench, 2)
    bench.settle()
    with bench.journal.transaction() as connection:
        connection.execute("UPDATE events SET value = '{}' WHERE id = 1")
    bench.journal.event(Event("mark", 2.0, {"i": 2}))
    bench.settle()
    assert [e["value"] for e in bench.receiver.events(bench.session)] == [{"i": 0}, {"i": 1}, {"i": 2}]


class Counting:
    """A connection that counts its transactions, and finds the disk full as often as it is told when one is noted."""

    def __init__(self, connection: sqlite3.Connection) -> None:
        self._connection = connection
        self.transactions = self.full = 0

    def execute(self, query: str, *values: Any) -> Any:
        self.transactions += query == "BEGIN IMMEDIATE"
        if query.startswith("UPDATE outbox") and self.full:
            self.full -= 1
            error = sqlite3.OperationalError("database or disk is full")
            error.sqlite_errorcode = sqlite3.SQLITE_FULL
            raise error
        return self._connection.execute(query, *values)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._connection, name)


def test_what_waited_is_noted_as_sent_many_at_a_time_and_what_is_new_at_once(bench: Bench) -> None:
    stream = fill(bench, 64)
    counting = Counting(bench.journal._connection)
    bench.journal._connection = counting  # type: ignore[assignment]
    bench.settle()
    assert len(bench.outbox("sent")) == 64
    assert counting.transactions == 4
    for i in range(64, 67):
        bench.journal.append(stream, made(i * 40, 40))
        bench.until(lambda i=i: (stream, i * 40) in bench.outbox("sent"))  # type: ignore[misc]
        # One for the chunk, one for its acknowledgement.
        assert counting.transactions == 4 + 2 * (i - 63)


def test_a_disk_that_is_full_when_they_are_noted_stops_nothing_for_good(bench: Bench) -> None:
    stream = fill(bench, 20)
    counting = Counting(bench.journal._connection)
    bench.journal._connection = counting  # type: ignore[assignment]
    counting.full = 3
    bench.until(lambda: "disk full" in (bench.uplink.status().problem or ""))
    assert bench.outbox("sent") == set()
    bench.settle()
    assert counting.full == 0
    assert bench.outbox("sent") == {(stream, i * 40) for i in range(20)}
    # None was sent twice for it.
    assert len([line for line in bench.wire.log if "chunks" in line]) == 20


def test_what_a_service_refused_is_sent_once_it_was_mended_and_put_back_into_the_outbox(bench: Bench) -> None:
    stream, handle = fill(bench, 4), bench.receiver.handle
    mended = False

    def handled(request: httpx.Request) -> httpx.Response:
        bad = request.url.path.endswith(("/chunks/40", "/chunks/120")) and not mended
        return httpx.Response(422, json={"detail": "made up"}) if bad else handle(request)

    bench.receiver.handle = handled  # type: ignore[method-assign]
    bench.settle()
    aside = {(stream, 40), (stream, 120)}
    assert bench.outbox("quarantined") == bench.journal.set_aside() == aside
    for mended in (False, True):
        bench.kill()
        bench.open()
        assert bench.journal.requeue() == 2
        assert bench.journal.set_aside() == set()
        bench.settle()
        # A service that was not mended refuses them once more.
        assert bench.journal.set_aside() == (set() if mended else aside)
    assert bench.journal.requeue() == 0
    assert joined(bench.at_receiver(stream)) == joined([made(i * 40, 40) for i in range(4)])
    kinds = [e["kind"] for e in bench.receiver.events(bench.session) if e["kind"] != "mark"]
    assert kinds == ["quarantined"] * 2 + ["requeued"] + ["quarantined"] * 2 + ["requeued"]
