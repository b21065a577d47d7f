"""Robotiq FT300: golden bytes, and the conversation that starts and stops its stream."""

from __future__ import annotations

import pytest

from daq.drivers.robotiq import HEADER, STOP, TRIES, Robotiq
from daq.errors import DriverError
from tests.daq.drivers.scripted import Scripted

GOLDEN = bytes.fromhex("204e640006ffd2040a00ecff03007bb4")
START = bytes.fromhex("0910019a0001020200cdca")
STARTED = bytes.fromhex("0910019a00012152")


def test_golden_bytes() -> None:
    decoder = Robotiq().decoder()
    got = [decoder.feed(piece) for piece in (GOLDEN, GOLDEN[:15], GOLDEN[15:], GOLDEN[:1], GOLDEN[1:2])]
    # The first frame after switching on counts once the second follows it; that one once the third begins.
    assert [len(s) for s in got] == [0, 0, 1, 0, 1]
    assert got[2].wrench[0] == pytest.approx([1.0, -2.5, 12.34, 10.0, -20.0, 3.0])


def test_a_header_inside_the_payload_and_a_flipped_bit_cost_one_frame() -> None:
    inside = bytes.fromhex("204e204e204ed2040a00ecff0300")
    from daq.drivers.robotiq import with_crc

    frame = with_crc(inside)
    damaged = bytearray(frame)
    damaged[7] ^= 0x10
    stream = frame * 3 + bytes(damaged) + frame * 3 + HEADER
    got = Robotiq().decoder().feed(stream)
    assert len(got) == 6
    assert got.rejected == 1
    assert (got.wrench == got.wrench[0]).all()


def test_conversation() -> None:
    link = Scripted([(STOP, b""), (START, STARTED), (STOP, b"")])
    cell = Robotiq()
    cell.start(link)
    cell.stop(link)
    link.close()


@pytest.mark.parametrize(("answer", "said"), [(b"", "no answer"), (b"GSV-3 1.0\r\n" * 40, "the device says")])
def test_another_device_or_none_is_said(answer: bytes, said: str) -> None:
    with pytest.raises(DriverError, match=said):
        Robotiq().start(Scripted([(STOP, b""), (START, answer)] * TRIES))
