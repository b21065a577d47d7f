"""ATI Axia: golden lines, units, status, what damage costs, and the conversation."""

from __future__ import annotations

import numpy as np
import pytest

from daq.drivers.ati_axia import TRIES, AtiAxia, columns
from daq.drivers.base import Samples
from daq.errors import DriverError
from daq.standins.ati_axia import AtiAxiaStandIn
from tests.daq.drivers.scripted import Scripted

COMMAND = b"c #!ufxyztxyz\r"
WRENCH = [1.0, -2.5, 12.34, 10.0, -20.0, 3.0]


def line(count: int, status: str = "00000000", force: str = "N", torque: str = "Nm") -> bytes:
    forces = " ".join(f"{v} {force}" for v in ("1.000", "-2.500", "12.340"))
    torques = " ".join(f"{v} {torque}" for v in ("0.0100", "-0.0200", "0.0030"))
    return f"{count} {status} {forces} {torques}\r\n".encode()


LINES = [line(i) for i in range(1, 9)]


def decode(stream: bytes, settings: dict[str, str] | None = None, portion: int = 0) -> tuple[Samples, list[int]]:
    decoder = AtiAxia(settings).decoder()
    step = portion or len(stream)
    got = [decoder.feed(stream[i : i + step]) for i in range(0, len(stream), step)]
    counts: list[int] = []
    for part in got:
        assert part.sequence is not None
        counts += part.sequence.tolist()
    joined = Samples(
        np.concatenate([s.wrench for s in got]),
        np.concatenate([s.status for s in got]),
        np.concatenate([s.overload for s in got]),
        rejected=sum(s.rejected for s in got),
        skipped=sum(s.skipped for s in got),
    )
    return joined, counts


@pytest.mark.parametrize("portion", [1, 3, 60, 10_000])
def test_golden_lines(portion: int) -> None:
    got, counts = decode(b"".join(LINES), portion=portion)
    assert got.wrench == pytest.approx(np.array([WRENCH] * 8))
    assert counts == list(range(1, 9))
    assert (got.rejected, got.skipped) == (0, 0)


def test_the_manual_s_example_of_a_torque() -> None:
    stream = b"".join(b"%d 00000000 0.000 N 0.000 N 0.000 N 0.0009 Nm 0.0009 Nm 0.0000 Nm\r\n" % i for i in range(2))
    got, _ = decode(stream)
    assert got.wrench[0, 3:] == pytest.approx([0.9, 0.9, 0.0])


@pytest.mark.parametrize(
    ("force", "torque", "first_n", "first_nmm"),
    [("N", "Nmm", 1.0, 0.01), ("lbf", "lbf-in", 4.4482216, 1.1298483), ("kN", "kN-m", 1000.0, 10_000.0)],
)
def test_units_are_read_from_the_line(force: str, torque: str, first_n: float, first_nmm: float) -> None:
    got, _ = decode(b"".join(line(i, force=force, torque=torque) for i in range(3)))
    assert got.wrench[:, 0] == pytest.approx([first_n] * 3)
    assert got.wrench[:, 3] == pytest.approx([first_nmm] * 3)


@pytest.mark.parametrize(
    ("status", "overload"),
    [("88000000", True), ("C0000000", True), ("80000004", True), ("80000005", True), ("80000001", False)],
)
def test_status_bits(status: str, overload: bool) -> None:
    got, _ = decode(LINES[0] + line(2, status) + LINES[2])
    assert got.status.tolist() == [0, int(status, 16), 0]
    assert got.overload.tolist() == [False, overload, False]


def test_a_first_line_that_is_the_rest_of_one_does_not_count() -> None:
    stream = line(17)[1:] + line(18) + line(19)
    got, counts = decode(stream)
    assert counts == [18, 19]
    assert (got.rejected, got.skipped) == (0, len(line(17)) - 1)


@pytest.mark.parametrize(
    "bad",
    [
        LINES[3].replace(b"0.0200 Nm", b"0.0200 Nmm"),
        LINES[3].replace(b"0.0200 Nm", b"0.0200 N"),
        LINES[3].replace(b"0.0200 Nm", b"0.0200"),
        LINES[3].replace(b"-2.500 N", b"-2.5.0 N"),
        LINES[3].replace(b"-2.500 N", b"nan N"),
        LINES[3].replace(b"-2.500 N", b"-2500000000000.0 N"),
        LINES[3].replace(b"-2.500 N", b"1e999 N"),
        LINES[3].replace(b"-2.500 N", b"-2.500 \xce"),
        LINES[3].replace(b"00000000", b"0000000g"),
        LINES[3].replace(b"4 ", b"4294967296 ", 1),
        LINES[3][2:],
        b"7" * 400 + b"\r\n",
    ],
)
def test_a_damaged_line_costs_that_line(bad: bytes) -> None:
    for portion in (1, 1000):
        got, counts = decode(b"".join([*LINES[:3], bad, *LINES[4:]]), portion=portion)
        assert counts == [1, 2, 3, 5, 6, 7, 8]
        assert got.wrench == pytest.approx(np.array([WRENCH] * 7))
        assert (got.rejected, got.skipped) == (1, len(bad))


def test_the_counter_wraps_where_it_is_said_to() -> None:
    stream = b"".join(line(i) for i in (65534, 65535, 0, 1))
    assert decode(stream, {"counter_bits": "16"})[1] == [65534, 65535, 65536, 65537]


def test_commas_padding_and_another_order() -> None:
    stream = b"".join(b"0.0100 Nm, -0.0200 Nm,0.0030 Nm,  %d,1.000 N,-2.500 N,12.340 N\n" % i for i in (5, 6))
    got, counts = decode(stream, {"command": "c ;>utxyz#fxyz"})
    assert got.wrench == pytest.approx(np.array([WRENCH] * 2))
    assert counts == [5, 6]


@pytest.mark.parametrize("command", ["c #fxyz", "c ufxyztxyz", "s #fxyztxyz", "c #cfxyztxyz", "c #sfxyztxyz", "c", ""])
def test_a_command_that_cannot_be_read_is_refused(command: str) -> None:
    with pytest.raises(DriverError, match="each axis once"):
        columns(command)


def test_conversation() -> None:
    answer = b"c #!ufxyztxyz\r\n" + LINES[0]
    link = Scripted([(b"\r", LINES[5] + b">"), (COMMAND, answer), (b"\r", b"")])
    cell = AtiAxia()
    cell.start(link)
    cell.stop(link)
    link.close()


@pytest.mark.parametrize(
    ("answer", "said"),
    [(b"", "no answer"), (b"c #!ufxyztxyz\r\n", "the device says"), (b"c: no such command\r\n>" * 300, "the device")],
)
def test_another_device_or_none_is_said(answer: bytes, said: str) -> None:
    with pytest.raises(DriverError, match=said):
        AtiAxia().start(Scripted([(b"\r", b""), *[(COMMAND, answer)] * TRIES]))


def test_one_that_is_still_starting_up_is_asked_again() -> None:
    link = Scripted([(b"\r", b""), (COMMAND, b""), (COMMAND, b"Axia 1.2\r\n"), (COMMAND, LINES[0] + LINES[1])])
    AtiAxia().start(link)
    link.close()


@pytest.mark.parametrize("end", [b"\r", b"\n", b"\r\n"])
def test_whatever_ends_a_line(end: bytes) -> None:
    got, _ = decode(b"".join(LINES).replace(b"\r\n", end))
    assert (len(got), got.rejected, got.skipped) == (len(LINES), 0, 0)


def test_the_stand_in_writes_the_golden_lines_and_obeys() -> None:
    device = AtiAxiaStandIn()
    wrench = np.array([WRENCH, WRENCH])
    lines = device.encode(wrench, np.array([7, 8]), np.zeros(2), np.array([0, 0x80000005]))
    assert lines == [line(7), line(8, "80000005")]
    assert device.hear(COMMAND[:5]) == b""
    assert device.hear(COMMAND[5:]) == b"c #!ufxyztxyz\r\n"
    assert device.streaming
    device.hear(b"\r")
    assert not device.streaming
