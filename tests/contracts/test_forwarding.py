"""Journal, uplink and receiver together: whatever goes wrong between them, all arrives, once and in order."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import httpx
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from daq.acquisition.blocks import Chunk
from daq.journal.writer import Event
from tests.contracts.forwarding import FAULTS, Bench, fill, joined
from tests.contracts.ingest import Put, made


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    out = Bench(tmp_path)
    yield out
    out.close()


def test_all_arrives_with_its_description_and_events(bench: Bench) -> None:
    stream = fill(bench, 5)
    bench.journal.append(stream, made(200, 0))
    bench.settle()
    assert bench.receiver.stored(bench.session, stream) == [made(i * 40, 40).to_bytes() for i in range(5)] + [
        made(200, 0).to_bytes()
    ]
    assert [e["value"] for e in bench.receiver.events(bench.session)] == [{"i": i} for i in range(5)]
    assert bench.outbox("pending") == bench.outbox("quarantined") == set()
    assert bench.uplink.status() == replace(bench.uplink.status(), sent=6, quarantined=0, problem=None, caught_up=True)
    # Before any chunk: the stream and what the service has of it.
    assert [line.split()[0] for line in bench.wire.log[:2]] == ["PUT", "GET"]
    assert "chunks" not in "".join(bench.wire.log[:2])


def test_a_large_chunk_goes_in_parts_and_what_changed_meanwhile_is_no_conflict(bench: Bench) -> None:
    bench.receiver.most_bytes = 2200
    stream = fill(bench, 2)
    whole = [made(0, 40), made(40, 40)]
    assert len(whole[0].to_bytes()) > 2200
    bench.until(lambda: bench.at_receiver(stream))
    assert [len(c) for c in bench.at_receiver(stream)] == [20]
    # Killed between two parts; then the service takes larger ones.
    bench.kill()
    bench.open()
    bench.receiver.most_bytes = 1 << 20
    bench.settle()
    assert [len(c) for c in bench.at_receiver(stream)] == [20, 20, 40]
    assert joined(bench.at_receiver(stream)) == joined(whole)
    assert bench.outbox("sent") == {(stream, 0), (stream, 40)}


def test_a_whole_that_was_stored_is_found_by_its_parts(bench: Bench) -> None:
    stream = fill(bench, 1)
    bench.until(lambda: any("cursor" in line for line in bench.wire.log))
    bench.until(lambda: bench.at_receiver(stream), "500 after")
    assert bench.outbox("sent") == set()
    bench.receiver.most_bytes = 2200
    bench.settle()
    assert [len(c) for c in bench.at_receiver(stream)] == [40]
    assert bench.outbox("sent") == {(stream, 0)}


def test_a_sample_that_is_too_large_is_set_aside(bench: Bench) -> None:
    bench.receiver.most_bytes = 800
    stream = bench.journal.add_stream("made", {}, {})
    bench.journal.append(stream, replace(made(0, 1), raw=b"x" * 900, reads=[(900, 0.0)]))
    bench.journal.append(stream, made(1, 2))
    bench.settle()
    assert bench.outbox("quarantined") == {(stream, 0)}
    assert bench.outbox("sent") == {(stream, 1)}


@pytest.mark.parametrize("status", [400, 401, 403, 404, 410, 422])
def test_a_chunk_that_alone_is_refused_is_set_aside_with_an_alarm(bench: Bench, status: int) -> None:
    stream = fill(bench, 3)
    handle, bad = bench.receiver.handle, f"/{stream}/chunks/40"

    def refusing(request: httpx.Request) -> httpx.Response:
        return httpx.Response(status, json={"detail": "why"}) if request.url.path.endswith(bad) else handle(request)

    bench.receiver.handle = refusing  # type: ignore[method-assign]
    bench.settle()
    assert bench.outbox("quarantined") == {(stream, 40)}
    assert bench.outbox("sent") == {(stream, 0), (stream, 80)}
    alarm = [e for e in bench.journal.events() if e.kind == "quarantined"]
    assert [(e.stream, dict(e.value)) for e in alarm] == [
        (stream, {"first_seq": 40, "reason": f"the service says {status} why"})
    ]
    code, said = bench.journal.alarms.get_nowait()
    assert (code, f"the service says {status} why" in said, bench.journal.alarms.empty()) == ("quarantined", True, True)
    # It stays here, and is not sent again when the service is asked what it lacks.
    assert len(list(bench.journal.read(stream))) == 3
    bench.kill()
    bench.open()
    before = len(bench.wire.log)
    bench.settle()
    assert not [line for line in bench.wire.log[before:] if "chunks" in line]


def test_another_chunk_at_the_service_is_a_conflict_that_is_set_aside(bench: Bench) -> None:
    stream = fill(bench, 2)
    bench.until(lambda: any("cursor" in line for line in bench.wire.log))
    put = Put.__new__(Put)
    put.client, put.session, put.stream = bench.receiver.client(), bench.session, stream
    assert put.chunk(made(40, 40, salt=9)).is_success
    bench.settle()
    assert bench.outbox("quarantined") == {(stream, 40)}
    assert bench.outbox("sent") == {(stream, 0)}


def test_a_bench_that_is_turned_away_sets_nothing_aside_says_so_once_and_comes_back(bench: Bench) -> None:
    stream = fill(bench, 3)
    handle, status = bench.receiver.handle, 200
    bench.receiver.handle = (  # type: ignore[method-assign]
        lambda request: handle(request) if status == 200 else httpx.Response(status, json={"detail": "no token"})
    )
    bench.until(lambda: bench.at_receiver(stream))
    status = 401
    for _ in range(20):
        bench.step()
    assert bench.outbox("quarantined") == set()
    problem = bench.uplink.status().problem
    assert problem is not None
    assert "401 no token" in problem
    assert [e.value["reason"] for e in bench.journal.events() if e.kind == "uplink_refused"] == [
        "the service says 401 no token"
    ]
    told = f"session {bench.session} takes nothing: the service says 401 no token"
    assert bench.journal.alarms.get_nowait() == ("uplink_refused", told)
    assert bench.journal.alarms.empty()
    status = 200
    bench.settle()
    assert joined(bench.at_receiver(stream)) == joined([made(i * 40, 40) for i in range(3)])


def test_a_service_that_was_put_back_gets_again_what_it_lost(bench: Bench, tmp_path: Path) -> None:
    stream = fill(bench, 3)
    bench.settle()
    backup = tmp_path / "backup.db"
    shutil.copyfile(bench.receiver.path, backup)
    for i in range(3, 6):
        bench.journal.append(stream, made(i * 40, 40), [Event("mark", float(i), {"i": i})])
    bench.journal.append(stream, made(240, 0))
    bench.settle()
    bench.receiver.close()
    shutil.copyfile(backup, bench.receiver.path)
    bench.receiver.restart()
    assert len(bench.at_receiver(stream)) == 3
    # Nothing is new; it is found by looking now and then.
    bench.now_s += 61.0
    bench.settle()
    assert joined(bench.at_receiver(stream)) == joined([made(i * 40, 40) for i in range(6)] + [made(240, 0)])
    assert bench.receiver.stored(bench.session, stream)[-1] == made(240, 0).to_bytes()
    assert [e["value"] for e in bench.receiver.events(bench.session)] == [{"i": i} for i in range(6)]


def test_a_journal_that_was_put_back_has_another_epoch_and_overwrites_nothing(bench: Bench, tmp_path: Path) -> None:
    stream = fill(bench, 2)
    bench.journal.close(tmp_path / "backup")
    bench.open()
    bench.journal.append(stream, made(80, 40))
    bench.settle()
    epoch = bench.journal.epoch
    bench.journal.close()
    shutil.copyfile(tmp_path / "backup", bench.path)
    bench.open()
    assert bench.journal.epoch != epoch
    bench.settle()
    ahead = [e.value for e in bench.journal.events() if e.kind == "service_ahead"]
    assert ahead == [{"next_seq_here": 80, "next_seq_there": 120, "epoch_there": epoch}]
    bench.journal.append(stream, made(80, 40, salt=3))
    bench.settle()
    assert bench.outbox("quarantined") == {(stream, 80)}
    assert bench.receiver.stored(bench.session, stream)[2] == made(80, 40).to_bytes()


def test_a_chunk_that_is_damaged_on_the_disk_is_not_sent_and_holds_up_no_other(bench: Bench) -> None:
    stream = fill(bench, 3)
    with bench.journal.transaction() as connection:
        connection.execute("UPDATE chunks SET payload = zeroblob(99) WHERE first_seq = 40")
    bench.settle()
    assert bench.outbox("quarantined") == {(stream, 40)}
    assert [c.first_seq for c in bench.at_receiver(stream)] == [0, 80]


@pytest.mark.parametrize(
    ("fault", "least_s", "most_s"), [("429", 7.0, 9.0), ("503", 20.0, 25.0), ("500", 0.12, 0.25), ("lost", 0.12, 0.25)]
)
def test_the_service_is_left_alone_for_as_long_as_it_asks(
    bench: Bench, fault: str, least_s: float, most_s: float
) -> None:
    fill(bench, 1)
    bench.wire.faults = [fault]
    assert least_s <= bench.step() <= most_s
    bench.now_s -= 0.01
    # Not asked again before the time is over.
    assert bench.uplink.step() == pytest.approx(0.01)
    assert len(bench.wire.log) == 1


def test_failures_are_followed_by_ever_longer_pauses_up_to_half_a_minute(bench: Bench) -> None:
    fill(bench, 1)
    bench.wire.faults = ["lost"] * 12
    pauses = [bench.step() for _ in range(12)]
    assert pauses == sorted(pauses)
    assert pauses[0] < 0.3
    assert pauses[-1] == pytest.approx(30.0 * 0.75)
    bench.settle()
    bench.wire.faults = ["lost"]
    bench.now_s += 61.0
    assert max(bench.step() for _ in range(3)) < 0.3


@pytest.mark.parametrize("fault", ["lost", "late", "unheard", "500", "500 after", "408", "429", "302", "login page"])
def test_an_event_whose_answer_was_lost_is_sent_again_in_its_place(bench: Bench, fault: str) -> None:
    for n in range(4):
        bench.journal.event(Event("mark", float(n), {"n": n}))
    bench.until(lambda: bench.wire.log)
    for _ in range(4):
        bench.wire.faults = [fault, ""]
        bench.until(lambda: not bench.wire.faults, None)
    bench.settle()
    assert [e["value"]["n"] for e in bench.receiver.events(bench.session)] == list(range(4))
    numbers = [line.split()[1] for line in bench.wire.log if "/" in line and "cursor" not in line]
    assert [n.rpartition("/")[2] for n in dict.fromkeys(numbers)] == ["0", "1", "2", "3"]
    # None was lost and only found again by asking what the service has.
    assert len([line for line in bench.wire.log if "cursor" in line]) == 1


class Forwarding(RuleBasedStateMachine):
    """Whatever goes wrong: in the end the receiver has all that was appended, once, and in order."""

    def __init__(self) -> None:
        super().__init__()
        self.folder = Path(tempfile.mkdtemp())
        self.bench = Bench(self.folder)
        self.model: dict[str, list[Chunk]] = {}
        self.marks: list[int] = []
        self.ended: set[str] = set()

    @initialize()
    def begin(self) -> None:
        self.add_stream()

    @rule()
    @precondition(lambda self: len(self.model) < 3)
    def add_stream(self) -> None:
        self.model[self.bench.journal.add_stream("made", {"n": len(self.model)}, {})] = []

    @rule(which=st.integers(0, 2), count=st.integers(1, 40), marks=st.integers(0, 2))
    def append(self, which: int, count: int, marks: int) -> None:
        stream = list(self.model)[which % len(self.model)]
        if stream not in self.ended:
            self._append(stream, count, marks)

    @rule(which=st.integers(0, 2))
    def end_stream(self, which: int) -> None:
        stream = list(self.model)[which % len(self.model)]
        if stream not in self.ended:
            self.ended.add(stream)
            self._append(stream, 0, 1)

    def _append(self, stream: str, count: int, marks: int) -> None:
        chunks = self.model[stream]
        chunk = made(chunks[-1].next_seq if chunks else 0, count)
        numbers = [len(self.marks) + i for i in range(marks)]
        self.bench.journal.append(stream, chunk, [Event("mark", 0.0, {"n": n}) for n in numbers])
        chunks.append(chunk)
        self.marks += numbers

    @rule(faults=st.lists(st.sampled_from(["", "refused", *FAULTS]), min_size=1, max_size=6))
    def go_wrong(self, faults: list[str]) -> None:
        self.bench.wire.faults += faults
        for _ in faults:
            self.bench.step()

    @rule(steps=st.integers(1, 8))
    def work(self, steps: int) -> None:
        for _ in range(steps):
            self.bench.step()

    @rule()
    def arrive_late(self) -> None:
        self.bench.wire.arrive()

    @rule(most_bytes=st.sampled_from([700, 1200, 2500, 1 << 20]), steps=st.integers(0, 12))
    def limit(self, most_bytes: int, steps: int) -> None:
        self.bench.receiver.most_bytes = most_bytes
        self.work(steps)

    @rule()
    def kill_bench(self) -> None:
        self.bench.kill()
        self.bench.open()

    @rule()
    def restart_receiver(self) -> None:
        self.bench.receiver.restart()

    @rule(by_s=st.sampled_from([-1e6, -3600.0, 3600.0, 1e6]))
    def step_clock(self, by_s: float) -> None:
        self.bench.wire.wall_s += by_s

    @invariant()
    def what_is_acknowledged_is_at_the_receiver(self) -> None:
        bench = self.bench
        sent = bench.outbox("sent")
        for stream, chunks in self.model.items():
            parts = bench.at_receiver(stream)
            there = {c.first_seq + i: c.wrench[i].tobytes() for c in parts for i in range(len(c))}
            for chunk in chunks:
                if (stream, chunk.first_seq) in sent:
                    assert [there.get(chunk.first_seq + i) for i in range(len(chunk))] == [
                        row.tobytes() for row in chunk.wrench
                    ]

    def teardown(self) -> None:
        bench = self.bench
        try:
            bench.wire.faults, bench.receiver.most_bytes = [], 1 << 20
            bench.wire.arrive()
            bench.settle()
            self._compare()
        finally:
            bench.close()
            shutil.rmtree(self.folder)

    def _compare(self) -> None:
        bench = self.bench
        aside = bench.outbox("quarantined")
        assert bench.outbox("pending") == set()
        # Nothing is set aside but what was refused, as a whole or in a part.
        for stream, first in aside:
            chunk = next(c for c in self.model[stream] if c.first_seq == first)
            assert any(s == stream and first <= f <= chunk.next_seq for s, f in bench.wire.refused)
        for stream, chunks in self.model.items():
            wanted = [c for c in chunks if (stream, c.first_seq) not in aside]
            ranges = [(c.first_seq, c.next_seq) for c in wanted]
            there = bench.at_receiver(stream)
            # Parts of what was set aside may be there, too.
            got = [c for c in there if any(a <= c.first_seq and c.next_seq <= b for a, b in ranges)]
            if not aside:
                assert len(got) == len(there)
            assert joined(got) == joined(wanted)
        events = bench.receiver.events(bench.session)
        assert [e["value"]["n"] for e in events if e["kind"] == "mark"] == self.marks
        assert len(events) == len(bench.journal.events())


Forwarding.TestCase.settings = settings(max_examples=40, stateful_step_count=40, deadline=None)
test_whatever_goes_wrong_all_arrives_once_and_in_order = Forwarding.TestCase
