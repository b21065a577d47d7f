"""ATI Net F/T: golden requests and records, buffered traffic, counters that wrap, and the conversation."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from daq.drivers.ati_netft import TRIES, AtiNetft
from daq.errors import DriverError
from daq.standins.ati_netft import AtiNetftStandIn
from tests.daq.drivers.scripted import Scripted

SCALE = {"counts_per_N": 1e6, "counts_per_Nmm": 1000.0, "rate_hz": 7000.0}
STOP = bytes.fromhex("1234000000000000")
START = bytes.fromhex("1234000200000000")
BUFFERED = bytes.fromhex("1234000300000000")


def record(sequence: int, status: int = 0, counts: tuple[int, ...] = (0, 0, 0, 0, 0, 0)) -> bytes:
    return struct.pack(">III6i", sequence, sequence * 7 % 2**32, status, *counts)


def test_golden_record() -> None:
    data = bytes.fromhex("00000005 00000023 00000000 000f4240 ffd9da60 00bc4b20 00002710 ffffb1e0 00000bb8")
    got = AtiNetft(SCALE).decoder().feed(data)
    assert got.wrench[0] == pytest.approx([1.0, -2.5, 12.34, 10.0, -20.0, 3.0])
    assert got.sequence is not None
    assert got.device_s is not None
    assert got.sequence.tolist() == [5]
    assert got.device_s.tolist() == [5 / 7000.0]
    assert (got.status[0], got.overload[0], got.rejected, got.skipped) == (0, False, 0, 0)


def test_buffered_datagrams_are_decoded_whole() -> None:
    rng = np.random.default_rng(1)
    counts = rng.integers(-(2**31), 2**31, (7000, 6))
    records = [record(i + 1, 0, tuple(row)) for i, row in enumerate(counts.tolist())]
    decoder = AtiNetft({**SCALE, "buffered": "yes"}).decoder()
    got = [decoder.feed(b"".join(records[i : i + 40])) for i in range(0, 7000, 40)]
    assert [len(s) for s in got] == [40] * 175
    wrench = np.concatenate([s.wrench for s in got])
    assert wrench == pytest.approx(counts / np.array([1e6] * 3 + [1000.0] * 3))
    sequence = np.concatenate([s.sequence for s in got if s.sequence is not None])
    assert sequence.tolist() == list(range(1, 7001))


def test_counts_wrap_and_lost_or_late_datagrams_show() -> None:
    decoder = AtiNetft(SCALE).decoder()
    seen = []
    for count in [2**32 - 2, 2**32 - 1, 0, 3, 2, 4]:
        got = decoder.feed(record(count))
        assert got.sequence is not None
        assert got.device_s is not None
        seen += got.sequence.tolist()
        assert got.device_s[0] == got.sequence[0] / 7000.0
    assert seen == [2**32 - 2, 2**32 - 1, 2**32, 2**32 + 3, 2**32 + 2, 2**32 + 4]


@pytest.mark.parametrize("cut", [1, 12, 35])
def test_a_datagram_of_a_wrong_length_is_refused_whole(cut: int) -> None:
    decoder = AtiNetft(SCALE).decoder()
    bad = (record(1) + record(2) + record(3))[:-cut]
    got = decoder.feed(bad)
    assert (len(got), got.rejected, got.skipped) == (0, 3, len(bad))
    after = decoder.feed(record(4))
    assert after.sequence is not None
    assert after.sequence.tolist() == [4]


@pytest.mark.parametrize(
    ("status", "overload"),
    [
        (0x88000000, True),
        (0xC0000000, True),
        (0x80000004, True),
        (0x80020000, True),
        (0x80000001, False),
        (0x00010000, False),
    ],
)
def test_status_bits(status: int, overload: bool) -> None:
    got = AtiNetft(SCALE).decoder().feed(record(1, status))
    assert (int(got.status[0]), bool(got.overload[0])) == (status, overload)


def test_overload_bits_are_settable_and_checked() -> None:
    got = AtiNetft({**SCALE, "overload_bits": "0, 5"}).decoder().feed(record(1, 0x20) + record(2, 1 << 30))
    assert got.overload.tolist() == [True, False]
    with pytest.raises(DriverError, match="bits 0 to 31"):
        AtiNetft({**SCALE, "overload_bits": "32"}).decoder()


@pytest.mark.parametrize(("buffered", "start"), [("no", START), ("yes", BUFFERED)])
def test_conversation_lets_a_stale_stream_go_by(buffered: str, start: bytes) -> None:
    link = Scripted([(STOP, record(77)), (start, record(1)), (STOP, b"")])
    cell = AtiNetft({**SCALE, "buffered": buffered})
    cell.start(link)
    cell.stop(link)
    link.close()


def test_a_lost_request_is_repeated() -> None:
    link = Scripted([(STOP, b""), (START, b""), (START, record(1))])
    AtiNetft(SCALE).start(link)
    link.close()


@pytest.mark.parametrize(("answers", "said"), [([b""] * TRIES, "no answer"), ([b"hello"], "a datagram of 5 bytes")])
def test_another_device_or_none_is_said(answers: list[bytes], said: str) -> None:
    link = Scripted([(STOP, b""), *((START, a) for a in answers)])
    with pytest.raises(DriverError, match=said):
        AtiNetft(SCALE).start(link)
    link.close()


@pytest.mark.parametrize("missing", ["counts_per_N", "counts_per_Nmm", "rate_hz"])
def test_what_the_box_knows_must_be_given(missing: str) -> None:
    with pytest.raises(DriverError, match=f"lacks {missing}"):
        AtiNetft({k: v for k, v in SCALE.items() if k != missing})


def test_the_stand_in_is_understood() -> None:
    device = AtiNetftStandIn()
    wrench = np.array([[1.0, -2.5, 12.34, 10.0, -20.0, 3.0], [5000.0, -5000.0, 0.0, 0.0, 0.0, 0.0]])
    first, second = device.encode(wrench, np.array([2**32, 2**32 + 1]), np.zeros(2), np.array([0, 1 << 30]))
    got = AtiNetft(device.settings).decoder().feed(first + second)
    assert got.wrench[0] == pytest.approx(wrench[0])
    assert got.wrench[1, :2] == pytest.approx([2147.483647, -2147.483648])
    assert got.overload.tolist() == [False, True]
    assert got.sequence is not None
    assert got.sequence.tolist() == [0, 1]
    assert device.hear(START) == b""
    assert device.streaming
    assert device.hear(STOP) == b""
    assert not device.streaming
