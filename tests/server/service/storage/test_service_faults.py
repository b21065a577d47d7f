"""The service's database on a disk that fails: nothing acknowledged is lost, nothing is made up."""

from __future__ import annotations

import tempfile
import threading
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path
from typing import ClassVar

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import initialize, rule, run_state_machine_as_test
from sqlalchemy import select, text
from sqlalchemy.exc import SQLAlchemyError

from server.service.ingest.ingest import Ingest, Sent
from server.service.ingest.windows import Windows
from server.service.operation.migrate import upgrade
from server.service.operation.scrub import damage_of
from server.service.sessions.sessions import Sessions
from server.service.storage.checksums import digest_of
from server.service.storage.database import Database
from server.service.storage.messages import Messages
from server.service.storage.schema import chunks, events, messages, streams
from tests.daq.failing_disk import OnFailingDisk
from tests.daq.faulty_disk import FAULTS, available
from tests.daq.journal_writer import made_chunk

pytestmark = pytest.mark.skipif(not available(), reason="SQLite's way to the disk cannot be taken over here")

FILE, SESSION, EPOCH, BENCHES = "fingertwin.db", "S", "e", ("a", "b", "c")


@cache
def begun() -> bytes:
    """Return the file of a database with a session and its streams."""
    with tempfile.TemporaryDirectory() as folder:
        database = Database(f"sqlite:///{folder}/{FILE}")
        upgrade(database)
        told = Messages(database)
        Sessions(database, told, frozenset(), Windows(database)).create(SESSION, None)
        for bench in BENCHES:
            Ingest(database, told).describe(SESSION, bench, b'{"driver": "made"}')
        database.close()
        return (Path(folder) / FILE).read_bytes()


def sent(body: bytes) -> Sent:
    return Sent(body, digest_of(body), EPOCH)


class FailingService(OnFailingDisk):
    """Three benches send chunks, at once, and events, while the disk fails, is mended and loses power."""

    tally: ClassVar[Counter[str]] = Counter()
    # Only that the database cannot be used now.
    refusal = SQLAlchemyError

    def __init__(self) -> None:
        super().__init__()
        self.acknowledged: dict[str, list[tuple[int, int]]] = {bench: [] for bench in BENCHES}
        # What was not acknowledged is sent again as it was: it may be there.
        self.asked = dict.fromkeys(BENCHES, (0, 0))
        self.noted: list[int] = []

    @initialize()
    def begin(self) -> None:
        home = self.first_home()
        (home / FILE).write_bytes(begun())
        self.live_in(home)

    def open(self) -> None:
        self.database = Database(f"sqlite:///{self.disk.folder / FILE}")
        self.ingest = Ingest(self.database, Messages(self.database))

    def close(self) -> None:
        self.database.close()

    @rule(fault=st.sampled_from(FAULTS), after=st.integers(0, 30), short=st.sampled_from([0.0, 0.5, 1.0]))
    def fail(self, fault: tuple[str, int], after: int, short: float) -> None:
        self.spoil(fault, after, short)
        self.put(700, 2)

    @rule(count=st.integers(1, 900), times=st.integers(1, 4))
    def put(self, count: int, times: int) -> None:
        """Have all benches send at once: those that wait for the first share a transaction."""
        for _ in range(times):
            inside, free, done = threading.Event(), threading.Event(), list[bool]()

            def hold(_: object, inside: threading.Event = inside, free: threading.Event = free) -> None:
                inside.set()
                free.wait(30)

            with ThreadPoolExecutor(len(BENCHES) + 1) as pool:
                first = pool.submit(self.tried, lambda hold=hold: self.database.together(hold))  # type: ignore[misc]
                while not (inside.is_set() or first.done()):
                    time.sleep(0.0002)
                trials = [pool.submit(self.put_one, bench, count) for bench in BENCHES]
                while inside.is_set() and len(self.database._waiting) < len(BENCHES):
                    time.sleep(0.0002)
                free.set()
                done = [trial.result() for trial in trials]
            self.tally["chunks acknowledged"] += sum(done)

    def put_one(self, bench: str, count: int) -> bool:
        mine = self.acknowledged[bench]
        seq = sum(mine[-1]) if mine else 0
        if self.asked[bench][0] != seq or not self.asked[bench][1]:
            self.asked[bench] = (seq, count)
        body = made_chunk(*self.asked[bench]).to_bytes()
        done = self.tried(lambda: self.ingest.put_chunk(SESSION, bench, *self.asked[bench], sent(body)))
        if done:
            mine.append(self.asked[bench])
        return done

    @rule()
    def note(self) -> None:
        number = len(self.noted)
        body = f'{{"kind": "note", "value": {{"number": {number}}}}}'.encode()
        if self.tried(lambda: self.ingest.put_event(SESSION, EPOCH, number, sent(body))):
            self.noted.append(number)
            self.tally["events acknowledged"] += 1

    @rule()
    def reopen(self) -> None:
        self.tally["databases closed and opened again"] += 1
        self.close()
        self.disk.mend()
        self.open()
        self.same()

    def same(self) -> None:
        with self.database.reading() as connection:
            assert connection.execute(text("PRAGMA integrity_check")).scalar() == "ok"
            for bench in BENCHES:
                query = select(chunks).where(chunks.c.stream == bench).order_by(chunks.c.first_seq)
                rows = connection.execute(query).all()
                found = [(row.first_seq, row.n) for row in rows]
                mine = self.acknowledged[bench]
                assert found[: len(mine)] == mine
                assert found[len(mine) :] in ([], [self.asked[bench]])
                assert all(row.payload == made_chunk(row.first_seq, row.n).to_bytes() for row in rows)
                stream = connection.execute(select(streams).where(streams.c.id == bench)).one()
                assert (stream.next_seq, stream.held) == (sum(found[-1]) if found else 0, sum(n for _, n in found))
            numbers = connection.execute(select(events.c.number).order_by(events.c.number)).scalars().all()
            assert numbers in (self.noted, [*self.noted, len(self.noted)])
            told = connection.execute(select(messages.c.body).where(messages.c.kind == "event")).scalars().all()
            assert [body["number"] for body in told] == numbers
        assert damage_of(self.database) == []


def test_nothing_acknowledged_is_lost_and_nothing_made_up() -> None:
    run_state_machine_as_test(FailingService, settings=settings(max_examples=8, stateful_step_count=15, deadline=None))


@pytest.mark.parametrize("fault", FAULTS)
def test_each_fault_comes_to_pass(fault: tuple[str, int]) -> None:
    machine = FailingService()
    try:
        machine.begin()
        machine.put(700, 1)
        if fault[0] in ("read", "map"):
            machine.close()
            machine.disk.fails, machine.disk.code = fault
            machine.open()
        machine.disk.fails, machine.disk.code = fault
        machine.put(700, 2)
        failed = machine.disk.failed[fault[0]]
        machine.reopen()
        assert failed or fault[0] == "truncate"
        machine.put(700, 2)
        assert [len(found) for found in machine.acknowledged.values()] >= [3, 3, 3]
    finally:
        machine.teardown()
