"""The sampling thread: chunks without gaps in their numbers, and an event for everything that happens."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from daq.acquisition.acquire import Acquisition
from daq.acquisition.records import Record
from daq.checks.recording import RecordingScan
from daq.drivers.base import LoadCell, Samples, Transport, samples
from daq.drivers.looks import looks_like
from daq.errors import DriverError, LinkLostError
from daq.recordings.readings import ReadingBlock


class Counting(LoadCell):
    """One byte a reading: its own count modulo 128, the top bit is an overload."""

    name = "counting"
    title = "test"
    link = "none"
    example = ""
    source = ""
    clock = "counter"

    def __init__(self, given: Mapping[str, Any] | None = None) -> None:
        super().__init__(given)
        self.started = self.stopped = 0

    @property
    def rate_hz(self) -> float:
        return 1000.0

    def decoder(self) -> CountingDecoder:
        return CountingDecoder()

    def start(self, transport: Transport) -> None:
        self.started += 1

    def stop(self, transport: Transport) -> None:
        self.stopped += 1


class CountingDecoder:
    def feed(self, data: bytes) -> Samples:
        octets = np.frombuffer(data, np.uint8)
        values = (octets & 0x7F).astype(np.int64)
        wrench = np.tile(values[:, None] / 10.0, (1, 6))
        over = octets > 127
        return samples(wrench, status=over.astype(np.int64), overload=over, sequence=values)


class Portions:
    """Gives one portion a read; None is a pulled cable, a number is silence [s], the end is the end of a file."""

    def __init__(self, portions: list[bytes | float | None]) -> None:
        self._portions = deque(portions)
        self.closed = 0

    def write(self, data: bytes) -> None:
        raise NotImplementedError

    def read(self, timeout_s: float) -> bytes:
        if not self._portions:
            raise EOFError
        portion = self._portions.popleft()
        if portion is None:
            raise LinkLostError("the cable was pulled")
        if isinstance(portion, bytes):
            time.sleep(0.001)
            return portion
        time.sleep(timeout_s)
        if portion > timeout_s:
            self._portions.appendleft(portion - timeout_s)
        return b""

    def close(self) -> None:
        self.closed += 1


def taken(links: list[Portions | DriverError], **options: Any) -> tuple[list[Record], Counting]:
    cell, queue = Counting(), deque(links)

    def connect() -> Transport:
        link = queue.popleft() if queue else DriverError("none there")
        if isinstance(link, DriverError):
            raise link
        return link

    run = Acquisition(cell, connect, chunk_s=0.02, **options)
    run.start()
    out = list(run.records())
    run.stop()
    assert all(link.closed == 1 for link in links if isinstance(link, Portions))
    return out, cell


def kinds(records: list[Record]) -> list[str]:
    return [e.kind for r in records for e in r.events]


def numbered(records: list[Record]) -> np.ndarray[Any, Any]:
    """All wrenches, after checking that the chunks' numbers follow each other."""
    next_seq = 0
    for record in records:
        if record.chunk is not None:
            assert record.chunk.first_seq == next_seq
            next_seq = record.chunk.next_seq
    return np.concatenate([r.chunk.wrench for r in records if r.chunk is not None])


def test_every_byte_arrives_once_as_read_and_as_decoded() -> None:
    sent = [bytes([k % 128]) for k in range(200)]
    records, cell = taken([Portions([*sent])])
    chunks = [r.chunk for r in records if r.chunk is not None]
    assert len(chunks) > 3
    assert b"".join(c.raw for c in chunks) == b"".join(sent)
    assert all(c.packed_bytes == len(c.to_bytes()) for c in chunks)
    assert numbered(records)[:, 0] == pytest.approx(np.arange(200) % 128 / 10.0)
    times = np.concatenate([c.t_s for c in chunks])
    assert (np.diff(times) > 0.0).all()
    # The device's count wraps at 128: of a driver that does not carry it on it is told that it began anew.
    assert [kind for kind in kinds(records) if kind != "gap"] == ["started", "ended"]
    gaps = [e for r in records for e in r.events if e.kind == "gap"]
    assert not any(gap.value["counted"] for gap in gaps)
    # A machine that is busy is slower than the rate that was stated, which is a gap too.
    [anew] = [gap for gap in gaps if gap.value["restarted"]]
    assert anew.at_s == pytest.approx(times[128])
    assert (cell.started, cell.stopped) == (1, 1)


def test_what_the_device_counted_and_did_not_arrive_is_a_gap() -> None:
    records, _ = taken([Portions([bytes([1, 2, 3]), bytes([10, 11])])])
    gaps = [e for r in records for e in r.events if e.kind == "gap"]
    assert [g.value for g in gaps] == [{"lost_samples": 6, "counted": True}]


def test_gaps_are_those_that_a_check_of_the_readings_finds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Counting, "clock", "recording")
    monkeypatch.setattr(CountingDecoder, "feed", lambda _, data: recorded(data))
    counts = [k for k in range(1, 100) if k not in (30, 50, 51)]
    links: list[Portions | DriverError] = [
        Portions([*(bytes(counts[a : a + 3]) for a in range(0, len(counts), 3)), None]),
        Portions([bytes([k]) for k in range(120, 127)]),
    ]
    records, _ = taken(links)
    scan = RecordingScan()
    chunks = [r.chunk for r in records if r.chunk is not None and len(r.chunk)]
    for _ in scan.watch(ReadingBlock(c.t_s, c.wrench) for c in chunks):
        pass
    gaps = [e for r in records for e in r.events if e.kind == "gap"]
    assert scan.gap_count == len(gaps) == 3
    assert [g.end_s for g in scan.gaps] == pytest.approx([e.at_s for e in gaps])
    assert [g.lost for g in scan.gaps] == [e.value["lost_samples"] for e in gaps]


def recorded(data: bytes) -> Samples:
    """Tell the time of each reading too, as a recording does: 10 ms for each that is counted."""
    values = np.frombuffer(data, np.uint8).astype(np.int64)
    return samples(np.tile(values[:, None] / 10.0, (1, 6)), sequence=values, device_s=values / 100.0)


def test_a_device_faster_than_the_rate_that_was_set_ends_the_log_and_loses_nothing() -> None:
    cell, given = Counting(), Portions([bytes(range(100)) for _ in range(300)])
    run = Acquisition(cell, lambda: given, chunk_s=0.02)
    cell.values["rate_hz"] = 1000.0
    run.start()
    records: list[Record] = []
    with pytest.raises(DriverError, match=r"counting sends \S+ readings a second; expected 1000, as rate_hz says"):
        records.extend(run.records())
    run.stop()
    assert len(numbered(records)) == 100 * (300 - len(given._portions)) > 0
    # Readings of two seconds may have been waiting: the rate is not wrong for that.
    cell, given = Counting(), Portions([bytes(range(100)) for _ in range(20)])
    run = Acquisition(cell, lambda: given, chunk_s=0.02)
    cell.values["rate_hz"] = 1000.0
    run.start()
    assert len(numbered(list(run.records()))) == 2000
    run.stop()
    # A rate that is no setting is the maker's: what is read is kept.
    records, _ = taken([Portions([bytes(range(100)) for _ in range(300)])])
    assert len(numbered(records)) == 30_000


def test_an_overload_is_told_when_it_begins_and_ends() -> None:
    records, _ = taken([Portions([bytes([1, 2]), bytes([3 | 128, 4 | 128]), bytes([5 | 128, 6]), bytes([7])])])
    assert kinds(records) == ["started", "overload", "overload_ended", "ended"]


def test_a_pulled_cable_is_told_and_comes_back() -> None:
    links: list[Portions | DriverError] = [
        Portions([bytes([1, 2, 3]), None]),
        DriverError("not yet"),
        Portions([bytes([0, 1])]),
    ]
    records, cell = taken(links)
    assert kinds(records) == ["started", "disconnected", "reconnected", "gap", "ended"]
    back = next(e for r in records for e in r.events if e.kind == "reconnected")
    assert back.value["tries"] == 2
    assert back.value["away_s"] > 0.7
    [gap] = [e for r in records for e in r.events if e.kind == "gap"]
    assert gap.value["lost_s"] == pytest.approx(back.value["away_s"], abs=0.1)
    assert gap.value["lost_samples"] == pytest.approx(1000.0 * gap.value["lost_s"], rel=0.1)
    assert gap.at_s == next(r.chunk for r in records if r.chunk is not None and r.chunk.first_seq == 3).t_s[0]
    assert len(numbered(records)) == 5
    assert (cell.started, cell.stopped) == (2, 1)


def test_silence_is_told_and_then_a_new_connection_is_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("daq.acquisition.acquire.GIVEN_UP_S", 0.2)
    links: list[Portions | DriverError] = [Portions([bytes([1]), 0.15, bytes([2]), 9.0]), Portions([bytes([5])])]
    records, _ = taken(links, stale_s=0.1)
    assert kinds(records) == ["started", "stale", "stale", "stale", "disconnected", "reconnected", "ended"]


def test_what_nobody_took_before_the_end_is_counted_too() -> None:
    run = Acquisition(Counting(), lambda: Portions([bytes([k % 128]) for k in range(100)]), chunk_s=0.005, waiting=3)
    run.start()
    run._thread.join()
    records = list(run.records())
    lost = [e.value["lost_samples"] for r in records for e in r.events if e.kind == "overrun"]
    assert len(lost) == 1
    assert len(numbered(records)) + lost[0] == 100
    assert kinds(records)[-1] == "ended"


def test_what_nobody_takes_in_time_is_counted() -> None:
    cell = Counting()
    portions: list[bytes | float | None] = [bytes([k % 128]) for k in range(400)]
    run = Acquisition(cell, lambda: Portions(portions), chunk_s=0.005, waiting=5)
    run.start()
    time.sleep(0.3)
    records = []
    for record in run.records():
        records.append(record)
        time.sleep(0.002)
    lost = sum(e.value["lost_samples"] for r in records for e in r.events if e.kind == "overrun")
    assert lost > 0
    assert len(numbered(records)) + lost == 400
    assert kinds(records)[-1] == "ended"


def test_a_device_that_is_not_there_starts_nothing() -> None:
    def connect() -> Transport:
        raise DriverError("no port COM9")

    run = Acquisition(Counting(), connect)
    with pytest.raises(DriverError, match="no port COM9"):
        run.start()
    run.stop()
    assert threading.active_count() < 10


def test_a_stop_stops_the_device() -> None:
    cell = Counting()
    run = Acquisition(cell, lambda: Portions([bytes([1]), 60.0]), stale_s=99.0)
    run.start()
    time.sleep(0.2)
    began = time.monotonic()
    run.stop()
    assert time.monotonic() - began < 1.0
    assert cell.stopped == 1
    assert kinds(list(run.records()))[-1] == "ended"


class Deaf(Counting):
    """Nothing that is read makes sense."""

    class _Decoder(CountingDecoder):
        def feed(self, data: bytes) -> Samples:
            return samples(np.zeros((0, 6)), skipped=len(data))

    def decoder(self) -> CountingDecoder:
        return self._Decoder()


def test_bytes_that_never_make_a_sample_are_said_and_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("daq.acquisition.acquire.UNDECODED_S", 0.02)
    sent: list[bytes | float | None] = [bytes([k]) for k in range(100)]
    run = Acquisition(Deaf(), lambda: Portions(sent), chunk_s=0.005)
    run.start()
    records = list(run.records())
    chunks = [r.chunk for r in records if r.chunk is not None]
    assert len(chunks) > 1
    assert [len(c) for c in chunks] == [0] * len(chunks)
    assert b"".join(c.raw for c in chunks) == bytes(range(100))
    assert sum(c.skipped for c in chunks) == 100
    # At once, and not with each of them again.
    [said] = [e for r in records for e in r.events if e.kind == "undecoded"]
    assert said.at_s < 0.5
    assert said.value["looks"].startswith("binary such as ")


def test_each_time_that_bytes_are_not_understood_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    class Picky(Counting):
        class _Decoder(CountingDecoder):
            def feed(self, data: bytes) -> Samples:
                return super().feed(data) if data != b"?" else samples(np.zeros((0, 6)), skipped=1)

        def decoder(self) -> CountingDecoder:
            return self._Decoder()

    monkeypatch.setattr("daq.acquisition.acquire.UNDECODED_S", 0.02)
    run = Acquisition(Picky(), lambda: Portions([*[b"?"] * 60, bytes([1]), bytes([2]), *[b"?"] * 60]), chunk_s=0.005)
    run.start()
    records = list(run.records())
    assert kinds(records).count("undecoded") == 2
    assert len(numbered(records)) == 2


def test_a_fault_of_ours_ends_the_stream_and_is_raised() -> None:
    class Faulty(Counting):
        class _Decoder(CountingDecoder):
            def feed(self, data: bytes) -> Samples:
                raise ZeroDivisionError

        def decoder(self) -> CountingDecoder:
            return self._Decoder()

    run = Acquisition(Faulty(), lambda: Portions([bytes([1]), 9.0]))
    run.start()
    with pytest.raises(ZeroDivisionError):
        list(run.records())


class Greeting(Counting):
    """Says something while it is started, some of it before it was asked to."""

    def start(self, transport: Transport) -> None:
        assert transport.read(0.1) == b"boot"
        transport.write(b"go")
        assert transport.read(0.1) == bytes([1, 2])
        assert transport.read(0.1) == bytes([3])


class Asked(Portions):
    def write(self, data: bytes) -> None:
        pass


def test_what_came_since_the_device_was_asked_begins_the_stream() -> None:
    run = Acquisition(Greeting(), lambda: Asked([b"boot", bytes([1, 2]), bytes([3]), bytes([4]), bytes([5])]))
    run.start()
    records = list(run.records())
    assert (numbered(records)[:, 0] * 10.0).tolist() == pytest.approx([1, 2, 3, 4, 5])
    assert b"".join(r.chunk.raw for r in records if r.chunk is not None) == bytes([1, 2, 3, 4, 5])
    assert kinds(records) == ["started", "ended"]


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"", "nothing"),
        (bytes(500), "500 times 00"),
        (b"1.0;2.0\r\n3.0;4.0\r\n5.0;6.0\r\n", "text such as '3.0;4.0', lines end in CR LF"),
        (b"1.0;2.0\r3.0;4.0\r5.0;6.0\r", "lines end in CR alone"),
        (b"1.0;2.0\n3.0;4.0\n5.0;6.0\n", "lines end in LF alone"),
        (b"0.123" * 30, "without line ends"),
        (bytes(range(128, 256)), "binary such as f0 f1 f2"),
    ],
)
def test_what_bytes_look_like(data: bytes, said: str) -> None:
    assert said in looks_like(data)
