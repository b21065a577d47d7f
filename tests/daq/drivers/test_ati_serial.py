"""ATI F/T controller: golden records, what damage costs in both forms, and the conversation."""

from __future__ import annotations

import numpy as np
import pytest

from daq.drivers.ati_serial import TRIES, AtiSerial
from daq.drivers.base import Samples
from daq.errors import DriverError
from daq.standins.ati_serial import AtiSerialStandIn
from tests.daq.drivers.scripted import Scripted

SCALE = {"counts_per_N": 100.0, "counts_per_Nmm": 10.0}
LINE = b"0,  -102,   -99,  -225,   -20,    39,   -39\r\n"
RECORD = bytes.fromhex("00 ff9a ff9d ff1f ffec 0027 ffd9")
WRENCH = [-1.02, -0.99, -2.25, -2.0, 3.9, -3.9]
PROMPT = b"\r\n>"
ASKED = [
    (b"CD R\r", b"CD R" + PROMPT),
    (b"CD A\r", b"CD A" + PROMPT),
    (b"CV 3F\r", b"CV 3F" + PROMPT),
    (b"SM 1\r", b"SM 1" + PROMPT),
    (b"QS\r", b"QS\r\n"),
]


def decode(stream: bytes, encoding: str = "ascii", portion: int = 0) -> Samples:
    decoder = AtiSerial({**SCALE, "encoding": encoding}).decoder()
    step = portion or len(stream)
    got = [decoder.feed(stream[i : i + step]) for i in range(0, len(stream), step)]
    return Samples(
        np.concatenate([s.wrench for s in got]),
        np.concatenate([s.status for s in got]),
        np.concatenate([s.overload for s in got]),
        rejected=sum(s.rejected for s in got),
        skipped=sum(s.skipped for s in got),
    )


def moving(n: int) -> tuple[np.ndarray, list[bytes]]:
    """Loads of both signs with a little noise, and their binary records."""
    rng = np.random.default_rng(3)
    slow = np.sin(np.arange(n)[:, None] / 40.0 + np.arange(6)) * [3.0, 4.0, 20.0, 30.0, 40.0, 20.0]
    device = AtiSerialStandIn()
    device.hear(b"CD B\r")
    wrench = slow + rng.normal(0.0, 0.05, (n, 6))
    return wrench, device.encode(wrench, np.arange(n), np.arange(n) / 295.0)


def test_golden_line() -> None:
    assert len(LINE) == 45
    got = decode(LINE)
    assert got.wrench[0] == pytest.approx(WRENCH)
    assert (got.status[0], got.overload[0], got.rejected, got.skipped) == (0, False, 0, 0)


def test_golden_binary_record_comes_once_four_others_follow() -> None:
    assert len(RECORD) == 13
    got = decode(RECORD * 7, "binary")
    assert len(got) == 3
    assert got.wrench == pytest.approx(np.array([WRENCH] * 3))
    assert len(decode(RECORD * 4, "binary")) == 0


@pytest.mark.parametrize("portion", [1, 7, 44, 45, 46])
def test_portions_do_not_matter(portion: int) -> None:
    stream = LINE[20:] + LINE * 5 + b"x" * 300 + b"\r\n" + LINE
    whole, parts = decode(stream), decode(stream, portion=portion)
    assert len(whole) == len(parts) == 6
    assert (whole.rejected, whole.skipped) == (parts.rejected, parts.skipped) == (1, 25 + 302)


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_an_error_is_an_overload(encoding: str) -> None:
    record = LINE if encoding == "ascii" else RECORD
    error = b"2" + record[1:] if encoding == "ascii" else b"\x02" + record[1:]
    got = decode(record * 2 + error + record * 6, encoding)
    assert got.status[:4].tolist() == [0, 0, 2, 0]
    assert got.overload[:4].tolist() == [False, False, True, False]
    assert got.wrench[2] == pytest.approx(WRENCH)


@pytest.mark.parametrize(
    "bad",
    [
        LINE[:5] + LINE[6:],  # a byte lost
        LINE[:5] + b" " + LINE[5:],  # one too many
        LINE.replace(b"  -102", b"-40000"),  # no int16
        LINE.replace(b"  -102", b"-0102 "),  # not right-aligned
        LINE.replace(b"  -102", b" -0102"),  # leading zero
        LINE.replace(b"  -102", b"  -1.2"),
        LINE.replace(b"  -102", b"  - 02"),
        LINE.replace(b",  -102", b";  -102"),
        b"A" + LINE[1:],
        b"\xff" * 43 + b"\r\n",
        LINE[:-2] + b" \n",
    ],
)
def test_a_damaged_line_costs_that_line(bad: bytes) -> None:
    got = decode(LINE * 2 + bad + LINE * 2)
    assert len(got) == 4
    assert (got.rejected, got.skipped) == (1, len(bad))


def test_a_lost_line_end_costs_two_lines_and_half_of_one_none() -> None:
    got = decode(LINE + LINE[:-2] + LINE + LINE)
    assert (len(got), got.rejected) == (2, 2)
    got = decode(LINE + LINE[:-1] + LINE + LINE)
    assert (len(got), got.rejected, got.skipped) == (4, 0, 0)


@pytest.mark.parametrize("end", [b"\r", b"\n", b"\r\n"])
@pytest.mark.parametrize("padded", [True, False])
@pytest.mark.parametrize("portion", [1, 7, 0])
def test_whatever_ends_a_line_and_pads_a_number(end: bytes, padded: bool, portion: int) -> None:
    line = LINE[:-2] if padded else LINE[:-2].replace(b" ", b"")
    got = decode((line + end) * 5, portion=portion)
    assert got.wrench == pytest.approx(np.array([WRENCH] * 5))
    assert (got.rejected, got.skipped) == (0, 0)
    # Whichever it is, a line of the other form is a damaged one.
    other = LINE[:-2].replace(b" ", b"") if padded else LINE[:-2]
    got = decode((line + end) * 5 + (other + end) + (line + end) * 2, portion=portion)
    assert (len(got), got.rejected, got.skipped) == (7, 1, len(other + end))


def test_a_stream_without_line_ends_is_not_kept() -> None:
    decoder = AtiSerial(SCALE).decoder()
    skipped = sum(decoder.feed(b"0," * 50).skipped for _ in range(1000))
    assert skipped > 100_000 - 200


@pytest.mark.parametrize("portion", [1, 5, 16, 1000])
def test_binary_noise_free_of_damage_is_all_there(portion: int) -> None:
    wrench, records = moving(2000)
    got = decode(b"".join(records), "binary", portion)
    assert len(got) == 2000 - 4
    assert np.abs(got.wrench - wrench[:-4]).max() <= 0.05 + 1e-9
    assert (got.rejected, got.skipped) == (0, 0)


def test_a_flipped_bit_in_the_error_byte_costs_one_binary_record() -> None:
    wrench, records = moving(300)
    records[100] = b"\x40" + records[100][1:]
    got = decode(b"".join(records), "binary")
    assert (len(got), got.rejected, got.skipped) == (295, 1, 13)
    assert np.abs(got.wrench - np.delete(wrench, 100, axis=0)[:-4]).max() <= 0.05 + 1e-9


@pytest.mark.parametrize("added", [-20, -12, -11, -6, -3, -2, -1, 1, 2, 5, 12])
def test_lost_or_added_bytes_cost_few_binary_records(added: int) -> None:
    wrench, records = moving(300)
    stream, rng = b"".join(records), np.random.default_rng(0)
    device = AtiSerialStandIn()
    device.hear(b"CD B\r")
    for where in range(100 * 13, 190 * 13, 17):
        got = decode(stream[:where] + rng.bytes(max(0, added)) + stream[where + max(0, -added) :], "binary")
        again = device.encode(got.wrench, np.arange(len(got)), np.zeros(len(got)), got.status)
        # Nothing in a record tells one that damage put together; they are few.
        assert len(set(again) - set(records)) <= 2
        assert len(got) >= 300 - 4 - 6
        assert got.rejected <= 3
        assert np.abs(got.wrench[-80:] - wrench[-84:-4]).max() <= 0.05 + 1e-9


def test_a_binary_stream_that_begins_inside_a_record_is_found() -> None:
    wrench, records = moving(300)
    for first in range(1, 13):
        got = decode(b"".join(records)[first:], "binary")
        assert len(got) >= 290
        assert np.abs(got.wrench[-200:] - wrench[-204:-4]).max() <= 0.05 + 1e-9


@pytest.mark.parametrize("portion", [1, 11, 64, 500])
def test_portions_do_not_matter_to_damaged_binary_either(portion: int) -> None:
    rng = np.random.default_rng(5)
    stream = bytearray(b"".join(moving(300)[1]))
    for where in sorted(rng.integers(0, len(stream), 12), reverse=True):
        stream[where : where + int(rng.integers(0, 9))] = rng.bytes(int(rng.integers(0, 9)))
    whole, parts = decode(bytes(stream), "binary"), decode(bytes(stream), "binary", portion)
    assert 200 < len(whole) < 296
    assert np.array_equal(whole.wrench, parts.wrench)
    assert (whole.rejected, whole.skipped) == (parts.rejected, parts.skipped)


def test_conversation() -> None:
    link = Scripted([(b"\r", LINE * 3 + PROMPT), *ASKED, (b"\r", b"")])
    cell = AtiSerial(SCALE)
    cell.start(link)
    cell.stop(link)
    link.close()


def test_binary_is_asked_for() -> None:
    asked = [(a.replace(b"CD A", b"CD B"), b.replace(b"CD A", b"CD B")) for a, b in ASKED]
    link = Scripted([(b"\r", PROMPT), *asked])
    AtiSerial({**SCALE, "encoding": "binary"}).start(link)
    link.close()


@pytest.mark.parametrize(
    ("answer", "said"), [(b"", "no answer"), (b"GSV-3 1.0\r\n>", "to CD R the device says"), (b"#" * 2000, "says")]
)
def test_another_device_or_none_is_said(answer: bytes, said: str) -> None:
    with pytest.raises(DriverError, match=said):
        AtiSerial(SCALE).start(Scripted([(b"\r", b""), *[(b"CD R\r", answer)] * TRIES]))


def test_one_without_echo_is_understood() -> None:
    silent = [(asked, answer.replace(asked[:-1], b"")) for asked, answer in ASKED[:-1]]
    link = Scripted([(b"\r", PROMPT), *silent, (b"QS\r", LINE[20:] + LINE)])
    AtiSerial(SCALE).start(link)
    link.close()


def test_one_that_is_still_starting_up_is_asked_again() -> None:
    link = Scripted([(b"\r", b""), (b"CD R\r", b""), (b"CD R\r", b"F/T 5.0\r\n"), *ASKED])
    AtiSerial(SCALE).start(link)
    link.close()


def test_one_that_does_not_fall_silent_is_said() -> None:
    with pytest.raises(DriverError, match="keeps sending"):
        AtiSerial(SCALE).start(Scripted([(b"\r", b"")], then=[LINE * 100] * 10))


def test_the_scale_must_be_given() -> None:
    with pytest.raises(DriverError, match="lacks counts_per_Nmm"):
        AtiSerial({"counts_per_N": 100.0})


def test_the_stand_in_writes_the_golden_records_and_obeys() -> None:
    device = AtiSerialStandIn()
    one = np.array([WRENCH])
    assert device.encode(one, np.array([0]), np.array([0.0])) == [LINE]
    assert device.hear(b"CD B\rQ") == b"CD B" + PROMPT
    assert device.encode(one, np.array([0]), np.array([0.0])) == [RECORD]
    assert device.hear(b"S\r") == b"QS\r\n"
    assert device.streaming
    device.hear(b"\r")
    assert not device.streaming
