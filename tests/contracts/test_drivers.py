"""What every load-cell driver keeps, with its stand-in: readings, damage, conversation, and what it says of itself."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import TypeVar

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from daq import drivers, standins
from daq.acquisition.sample_clock import SampleClock
from daq.drivers.base import Decoder, LoadCell, Samples
from daq.errors import DriverError
from daq.standins.base import StandIn
from tests.contracts.mutations import KINDS, Damaged, damage_datagrams, damage_stream, held_bytes

Floats = NDArray[np.float64]
T = TypeVar("T", bound=np.generic)
DRIVERS = tuple(drivers.REGISTRY)
PAIRED = tuple(name for name in DRIVERS if name in standins.REGISTRY)
READINGS, MUTATIONS = 300, 60
# No cell that is meant for fingers resolves less [N, N mm]; how much finer one is, its own tests say.
COARSEST = np.array([0.1, 0.1, 0.1, 2.0, 2.0, 2.0])
MOST_HELD_BYTES = 1 << 13
# A sum of bytes, unlike a CRC, does not see most of what is overwritten with noise inside a record.
SUMS = ("optoforce",)
UNITS = ("N", "Nmm", "Nm", "V", "mV", "s", "ms", "hz", "Hz", "K", "mm", "deg", "bits", "baud", "counts", "volts")
# What is a ratio has none.
RATIOS = ("speed",)


def cell_of(name: str) -> LoadCell:
    return drivers.driver(name)(standins.stand_in(name).settings)


@dataclass(frozen=True, eq=False)
class Sent:
    """Readings as a stand-in writes them, and as they decode undamaged: from the record with number `first`."""

    wrench: Floats
    records: list[bytes]
    decoded: Samples
    first: int


def portions(name: str, records: list[bytes]) -> list[bytes]:
    return records if standins.stand_in(name).datagrams else [b"".join(records)]


def fed(decoder: Decoder, pieces: list[bytes] | tuple[bytes, ...]) -> Samples:
    """All samples of some portions as if they had come at once."""
    got = [decoder.feed(piece) for piece in pieces]
    timed = [s for s in got if len(s)] or got[:1]
    return Samples(
        np.concatenate([s.wrench for s in got]),
        np.concatenate([s.status for s in got]),
        np.concatenate([s.overload for s in got]),
        joined([s.sequence for s in timed]),
        joined([s.device_s for s in timed]),
        sum(s.rejected for s in got),
        sum(s.skipped for s in got),
    )


def joined(parts: list[NDArray[T] | None]) -> NDArray[T] | None:
    there = [p for p in parts if p is not None]
    assert len(there) in (0, len(parts)), "a count or clock comes and goes"
    return np.concatenate(there) if there else None


def first_decoded(wrench: Floats, decoded: Floats) -> int:
    """Number of the first record that was decoded: what a stream begins with may be the rest of a record."""
    return int(np.argmin(np.abs(wrench[:2] - decoded[0]).sum(axis=1)))


def millis(count: NDArray[np.int64], from_s: float = 0.0) -> Floats:
    return count.astype(np.float64) * 1e-3 + from_s


@cache
def sent(name: str, seed: int = 0, first: int = 0, from_s: float = 0.0) -> Sent:
    rng = np.random.default_rng(seed)
    wrench = rng.uniform(-1.0, 1.0, (READINGS, 6)) * np.array([15.0, 15.0, 15.0, 150.0, 150.0, 150.0])
    count = np.arange(READINGS)
    records = standins.stand_in(name)().encode(wrench, first + count, millis(count, from_s))
    decoded = fed(cell_of(name).decoder(), portions(name, records))
    return Sent(wrench, records, decoded, first_decoded(wrench, decoded.wrench))


# The count near where 16 and 32 bits end, and the time near where 32 bits of microseconds do.
@pytest.mark.parametrize(("first", "from_s"), [(0, 0.0), (65_400, 4294.8), (2**32 - 100, 1e4)])
@pytest.mark.parametrize("name", PAIRED)
def test_readings_come_back_in_order(name: str, first: int, from_s: float) -> None:
    kind = drivers.driver(name)
    case = sent(name, 0, first, from_s)
    got, begin = case.decoded, case.first
    # The last record of some waits for the next one.
    assert len(got) >= READINGS - begin - 1
    written = case.wrench[begin : begin + len(got)]
    assert (np.abs(got.wrench - written) <= COARSEST).all()
    assert got.rejected == 0
    assert (got.status == 0).all()
    assert not got.overload.any()
    if kind.clock == "device":
        assert got.device_s is not None
        assert np.diff(got.device_s) == pytest.approx(1e-3, abs=2e-6)
    if kind.clock == "counter":
        assert got.sequence is not None
    if got.sequence is not None:
        assert (np.diff(got.sequence) == 1).all()


@pytest.mark.parametrize("name", PAIRED)
def test_what_was_decoded_is_written_and_decoded_the_same_again(name: str) -> None:
    got = sent(name).decoded.wrench
    count = np.arange(len(got))
    records = standins.stand_in(name)().encode(got, count, millis(count))
    again = fed(cell_of(name).decoder(), portions(name, records)).wrench
    begin = first_decoded(got, again)
    assert again == pytest.approx(got[begin : begin + len(again)], rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("name", [n for n in PAIRED if not standins.stand_in(n).datagrams])
@given(cuts=st.lists(st.floats(0.0, 1.0), max_size=40), step=st.integers(1, 40))
@settings(max_examples=25, deadline=None)
def test_portions_make_no_difference(name: str, cuts: list[float], step: int) -> None:
    case = sent(name)
    stream = b"".join(case.records)[7:]
    head = range(0, min(400, len(stream)), step)
    places = sorted({0, len(stream), *head, *(int(c * len(stream)) for c in cuts)})
    got = fed(cell_of(name).decoder(), [stream[a:b] for a, b in pairwise(places)])
    whole = cell_of(name).decoder().feed(stream)
    assert (got.wrench == whole.wrench).all()
    assert (got.status == whole.status).all()
    for one, other in ((got.sequence, whole.sequence), (got.device_s, whole.device_s)):
        assert (one is None) == (other is None)
        assert one is None or other is None or (one == other).all()
    assert (got.rejected, got.skipped) == (whole.rejected, whole.skipped)
    assert len(got) >= READINGS - 4


@pytest.mark.parametrize("name", PAIRED)
def test_any_bytes_are_survived_and_not_kept(name: str) -> None:
    rng = np.random.default_rng(7)
    record = sent(name).records[0]
    noise = [rng.bytes(int(n)) for n in rng.integers(0, 700, 300)]
    same = [bytes([value]) * 700 for value in (0x00, 0x0A, 0x20, 0x30, 0x2C, 0xAA, 0xFF) for _ in range(20)]
    heads = [record[:size] * 30 for size in range(1, len(record))]
    decoder = cell_of(name).decoder()
    for piece in [*noise, *same, *heads, b""]:
        got = decoder.feed(piece)
        assert np.isfinite(got.wrench).all()
        assert got.wrench.shape == (len(got.status), 6)
        assert held_bytes(decoder) <= MOST_HELD_BYTES
    got = fed(decoder, portions(name, sent(name).records))
    assert len(got) >= READINGS - 3


def mutated(name: str, seed: int) -> Damaged:
    """A damaged stream of a driver's; the same seed gives the same one, so that a benchmark may try many."""
    rng = np.random.default_rng(seed)
    records = sent(name).records
    if standins.stand_in(name).datagrams:
        return damage_datagrams(records, rng)
    return damage_stream(records, [k for k in KINDS if k != "overwritten" or name not in SUMS], rng)


def check_mutated(name: str, seed: int) -> None:
    """Decode a damaged stream, in portions."""
    case, damaged = sent(name), mutated(name, seed)
    rng = np.random.default_rng(seed + 1)
    pieces = list(damaged.pieces)
    if not standins.stand_in(name).datagrams:
        stream = pieces[0]
        places = sorted({0, len(stream), *(int(p) for p in rng.integers(0, len(stream) + 1, 20))})
        pieces = [stream[a:b] for a, b in pairwise(places)]
    decoder = cell_of(name).decoder()
    got = fed(decoder, pieces)
    assert held_bytes(decoder) <= MOST_HELD_BYTES
    assert np.isfinite(got.wrench).all()
    numbers = {row.tobytes(): case.first + i for i, row in enumerate(case.decoded.wrench)}
    found = [numbers.get(row.tobytes()) for row in got.wrench]
    if drivers.driver(name).checksum:
        assert None not in found, f"seed {seed}: a reading that was never sent"
    missing = damaged.whole & set(numbers.values()) - set(found)
    assert len(missing) <= 2 * damaged.damages, f"seed {seed}: {sorted(missing)} are missing"


@pytest.mark.parametrize("name", PAIRED)
def test_damage_costs_little_and_invents_nothing(name: str) -> None:
    for seed in range(MUTATIONS):
        check_mutated(name, seed)


@pytest.mark.parametrize("name", PAIRED)
def test_a_device_that_begins_anew_is_seen_at_once_and_its_times_are_right(name: str) -> None:
    cell = cell_of(name)
    interval_s, count, away_s = 1.0 / (cell.rate_hz or 1000.0), 200, 1.0
    device, decoder = standins.stand_in(name)(), cell.decoder()
    clock = SampleClock(cell.rate_hz, held_back=cell.held_back)
    number, wrench = np.arange(count), np.random.default_rng(3).uniform(-5.0, 5.0, (2 * count, 6))
    # Its count and its clock were not at their beginning before; afterwards they are, and it was away for a second.
    on_s = np.arange(float(count)) * interval_s
    records = device.encode(wrench[:count], 5000 + number, on_s + 5000 * interval_s)
    records += standins.stand_in(name)().encode(wrench[count:], number, on_s)
    sent_s = np.concatenate([on_s, on_s + on_s[-1] + interval_s + away_s])
    told: list[float] = []
    of: list[int] = []
    breaks: list[int] = []
    for record, arrival_s in zip(records, sent_s, strict=True):
        got = decoder.feed(record)
        times = clock.times(got, arrival_s, len(record))
        of += [int(np.argmin(np.abs(wrench - row).sum(axis=1))) for row in got.wrench]
        breaks += [of[len(told) + place] for place, _ in clock.breaks]
        told += times.tolist()
    # Some wait for the next record or are refused beside the break.
    assert len(told) >= 2 * count - 3
    assert (np.diff(told) > 0.0).all()
    # A record that waits for the next one is told that much later, always.
    error_s = np.array(told) - sent_s[of]
    assert np.abs(error_s - np.median(error_s[: count - 10])).max() <= 1.1 * interval_s
    assert breaks == [min(i for i in of if i >= count)]


class Wire:
    """A transport with a stand-in at its other end, which streams some records with every read."""

    def __init__(self, device: StandIn) -> None:
        self._device = device
        self._answers: deque[bytes] = deque()
        self._count = 0

    def write(self, data: bytes) -> None:
        # A serial line may bring a message in any portions.
        for piece in [data] if self._device.datagrams else [data[:1], data[1:]]:
            if answer := self._device.hear(piece):
                self._answers.append(answer)

    def read(self, timeout_s: float) -> bytes:
        assert timeout_s >= 0.0
        if not self._answers and not self._device.datagrams:
            self._answers.append(self._device.hear(b""))
        answer = self._answers.popleft() if self._answers else b""
        if answer or not self._device.streaming:
            return answer
        count = self._count + np.arange(1 if self._device.datagrams else 5)
        self._count += len(count)
        return b"".join(self._device.encode(np.ones((len(count), 6)), count, millis(count)))

    def close(self) -> None:
        pass


@pytest.mark.parametrize("name", PAIRED)
def test_driver_and_stand_in_hold_their_conversation(name: str) -> None:
    device = standins.stand_in(name)()
    always = device.streaming
    cell, wire = cell_of(name), Wire(device)
    # Twice, as after a cable was pulled: the second time it may stream already.
    for _ in range(2):
        cell.start(wire)
        assert device.streaming
        got = fed(cell.decoder(), [wire.read(0.1) for _ in range(10)])
        assert len(got) >= 5
        assert (np.abs(got.wrench - 1.0) <= COARSEST).all()
    cell.stop(wire)
    assert device.streaming == always


@pytest.mark.parametrize("name", PAIRED)
def test_a_device_that_says_nothing_is_refused_in_one_line(name: str) -> None:
    class Silent(Wire):
        def write(self, data: bytes) -> None:
            assert data

        def read(self, timeout_s: float) -> bytes:
            return b""

    with pytest.raises(DriverError) as caught:
        cell_of(name).start(Silent(standins.stand_in(name)()))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", DRIVERS)
def test_a_driver_says_what_it_is(name: str) -> None:
    kind = drivers.driver(name)
    assert kind.name == name
    assert kind.title
    assert kind.source
    assert kind.example.startswith(f"fingertwin log --driver {name} ")
    for setting in kind.settings:
        assert setting.text
        if setting.kind == "number" and setting.name not in RATIOS:
            assert set(setting.name.split("_")) & set(UNITS), f"{setting.name} states no unit"
        if setting.default is None:
            # It cannot run without: the example shows it.
            assert f"--set {setting.name}=" in kind.example


@pytest.mark.parametrize("name", DRIVERS)
def test_settings_that_are_unknown_or_missing_are_refused_in_one_line(name: str) -> None:
    kind = drivers.driver(name)
    given_settings = dict(standins.stand_in(name).settings) if name in PAIRED else {}
    with pytest.raises(DriverError, match="has no setting colour") as caught:
        kind({**given_settings, "colour": "red"})
    assert "\n" not in str(caught.value)
    required = [s.name for s in kind.settings if s.default is None]
    for missing in required:
        others = {key: value for key, value in given_settings.items() if key != missing}
        with pytest.raises(DriverError, match="lacks ") as caught:
            kind(others)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", PAIRED)
def test_a_stand_in_is_of_its_driver(name: str) -> None:
    kind = standins.stand_in(name)
    assert kind.name == name
    assert kind.datagrams == (drivers.driver(name).link == "udp")
