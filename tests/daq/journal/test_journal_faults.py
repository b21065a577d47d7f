"""A journal on a disk that fails: nothing that was acknowledged is lost without a word, and nothing is made up."""

from __future__ import annotations

import random
from collections import Counter
from pathlib import Path
from typing import ClassVar

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import initialize, precondition, rule, run_state_machine_as_test

from daq.errors import JournalError
from daq.journal.check import check
from daq.journal.writer import Event, Journal, JournalReader
from tests.daq.failing_disk import OnFailingDisk
from tests.daq.faulty_disk import FAULTS, FULL, Disk, available, faulty
from tests.daq.journal_writer import made_chunk

pytestmark = pytest.mark.skipif(not available(), reason="SQLite's way to the disk cannot be taken over here")


class FailingDisk(OnFailingDisk):
    """Chunks, events and notes about the outbox go into a journal while its disk fails, is mended and loses power."""

    tally: ClassVar[Counter[str]] = Counter()
    refusal = JournalError

    @initialize()
    def begin(self) -> None:
        home = self.first_home()
        Journal.create(home / "bench.journal", "bench", 0).close()
        self.stream, self.seq, self.asked = "", 0, (0, 0)
        self.acknowledged: list[tuple[int, int]] = []
        self.noted: list[int] = []
        self.live_in(home)
        self.stream = self.journal.add_stream("made", {}, {})

    @property
    def path(self) -> Path:
        return self.disk.folder / "bench.journal"

    def open(self) -> None:
        self.journal = Journal.open(self.path, 0)

    def close(self) -> None:
        self.journal.close()

    def look_at(self, home: Path) -> None:
        # Nothing is said to be missing.
        assert check(home / "bench.journal").faults == ()

    @rule(fault=st.sampled_from(FAULTS), after=st.integers(0, 12), short=st.sampled_from([0.0, 0.5, 1.0]))
    def fail(self, fault: tuple[str, int], after: int, short: float) -> None:
        self.spoil(fault, after, short)
        self.append(700, 3)

    @rule(count=st.integers(1, 900), times=st.integers(1, 6))
    def append(self, count: int, times: int) -> None:
        for _ in range(times):
            # What was not acknowledged is sent again as it was: it may be there.
            if self.asked[0] != self.seq or not self.asked[1]:
                self.asked = (self.seq, count)
            chunk = made_chunk(*self.asked)
            if self.tried(lambda chunk=chunk: self.journal.append(self.stream, chunk)):  # type: ignore[misc]
                self.acknowledged.append(self.asked)
                self.seq = chunk.next_seq
                self.tally["chunks acknowledged"] += 1

    @rule()
    def note(self) -> None:
        self.attempts += 1
        if self.tried(lambda: self.journal.event(Event("note", value={"number": self.attempts}))):
            self.noted.append(self.attempts)

    @precondition(lambda self: self.acknowledged)
    @rule(draw=st.randoms(use_true_random=False))
    def sent(self, draw: random.Random) -> None:
        first, _ = draw.choice(self.acknowledged)
        self.tried(lambda: self.journal.acknowledged(self.stream, first))

    @rule()
    def reopen(self) -> None:
        self.tally["journals closed and opened again"] += 1
        self.tried(self.close)
        reopened = self.tried(self.open)
        self.disk.mend()
        if not reopened:
            self.open()
        self.same()

    def same(self) -> None:
        with JournalReader.open(self.path) as reader:
            chunks = list(reader.read(self.stream))
            notes = [e.value["number"] for e in reader.events() if e.kind == "note"]
        assert self.journal.displaced is None, "its own writing is nobody else's"
        found = [(c.first_seq, len(c)) for c in chunks]
        assert found[: len(self.acknowledged)] == self.acknowledged
        assert found[len(self.acknowledged) :] in ([], [self.asked])
        assert all(c.to_bytes() == made_chunk(c.first_seq, len(c)).to_bytes() for c in chunks)
        assert [n for n in notes if n in self.noted] == self.noted
        assert set(notes) <= set(range(1, self.attempts + 1))
        assert check(self.path).faults == ()


def test_nothing_acknowledged_is_lost_and_nothing_made_up() -> None:
    run_state_machine_as_test(FailingDisk, settings=settings(max_examples=8, stateful_step_count=15, deadline=None))


@pytest.mark.parametrize("fault", FAULTS)
def test_each_fault_comes_to_pass_and_is_said(tmp_path: Path, fault: tuple[str, int]) -> None:
    home = tmp_path / "disk"
    home.mkdir()
    path = home / "bench.journal"
    Journal.create(path, "bench", 0).close()
    with faulty(Disk(home)) as disk:
        disk.fails, disk.code = fault
        if fault[0] in ("read", "map"):
            with pytest.raises(JournalError, match=r"bench\.journal"):
                Journal.open(path, 0)
        else:
            disk.mend()
            with Journal.open(path, 0) as journal:
                stream = journal.add_stream("made", {}, {})
                seq = journal.append(stream, made_chunk(0))
                disk.fails = fault[0]
                if fault[0] == "truncate":
                    seq = journal.append(stream, made_chunk(seq))  # of no need to a commit
                    disk.failed["truncate"] += 1
                else:
                    with pytest.raises(JournalError, match="disk full" if fault[1] == FULL else "the disk"):
                        journal.append(stream, made_chunk(seq))
                disk.mend()
                assert journal.next_seq(stream) == seq
                assert journal.append(stream, made_chunk(seq)) == seq + 700
        assert disk.failed[fault[0]] > 0
        disk.mend()
    assert check(path).faults == ()
