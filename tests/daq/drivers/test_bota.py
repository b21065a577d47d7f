"""Bota SensONE: golden bytes, its clock, what is no wrench, and the conversation that starts its stream."""

from __future__ import annotations

import numpy as np
import pytest

from daq.drivers.bota import TRIES, Bota
from daq.errors import DriverError
from daq.standins.bota import BotaStandIn
from tests.daq.drivers.scripted import Scripted

GOLDEN = bytes.fromhex("aa00000000803f000000c0000060400ad7233c0ad7a3bc8fc2f53c40e201000000cc415535")
LINE = b"c,0,1,0,4"


def frames(n: int, first_s: float = 0.0, status: int = 0, value: float = 1.5) -> list[bytes]:
    wrench = np.full((n, 6), value)
    time_s = np.array([first_s + 1e-3 * i for i in range(n)])
    return BotaStandIn().encode(wrench, np.arange(n), time_s, np.full(n, status))


def test_golden_bytes() -> None:
    got = Bota().decoder().feed(GOLDEN * 3)
    assert len(got) == 2
    assert got.wrench[0] == pytest.approx([1.0, -2.0, 3.5, 10.0, -20.0, 30.0], abs=1e-6)
    assert got.device_s is not None
    assert got.device_s[0] == pytest.approx(0.123456)
    assert (got.status == 0).all()
    assert (got.rejected, got.skipped) == (0, 0)


def test_the_stand_in_writes_the_golden_bytes() -> None:
    wrench = np.array([[1.0, -2.0, 3.5, 10.0, -20.0, 30.0]])
    assert BotaStandIn().encode(wrench, np.array([0]), np.array([0.123456])) == [GOLDEN]


def test_the_clock_goes_on_where_its_32_bits_wrap() -> None:
    wraps_s = 2**32 * 1e-6
    got = Bota().decoder().feed(b"".join(frames(5, wraps_s - 0.002)))
    assert got.device_s == pytest.approx(wraps_s + np.array([-0.002, -0.001, 0.0, 0.001]), abs=1e-6)


def test_status_is_kept_and_beyond_range_is_overload() -> None:
    decoder = Bota().decoder()
    got = decoder.feed(b"".join(frames(2, 0.0, 0x2) + frames(3, 0.1, 0x4)))
    assert got.status.tolist() == [2, 2, 4, 4]
    assert got.overload.tolist() == [True, True, False, False]


@pytest.mark.parametrize("bad", [{"status": 0x8}, {"value": np.nan}, {"value": np.inf}, {"value": 1e30}])
def test_gauges_and_what_is_no_number_are_refused(bad: dict[str, float]) -> None:
    status, value = int(bad.get("status", 0)), bad.get("value", 1.5)
    got = Bota().decoder().feed(b"".join(frames(2) + frames(1, 0.1, status, value) + frames(3, 0.2)))
    assert len(got) == 4
    assert got.rejected == 1


# In its payload, and in its header: then the frame before it has none right behind, but one further.
@pytest.mark.parametrize("at", [9, 0])
def test_a_flipped_bit_costs_its_frame_alone(at: int) -> None:
    sent = frames(8)
    damaged = bytearray(sent[3])
    damaged[at] ^= 0x40
    got = Bota().decoder().feed(b"".join([*sent[:3], bytes(damaged), *sent[4:]]))
    assert got.device_s == pytest.approx([0.0, 0.001, 0.002, 0.004, 0.005, 0.006])
    assert got.rejected == 1


# Bytes were doubled, and the 37 that stand where the next frame should have a CRC that holds by chance.
CHANCE = bytes.fromhex("aa000014f7dc408800e23f352564c1bfe139bd0000cc4123a1aa000014f7dc408800e23f35")


def test_parts_of_two_frames_are_no_reading_though_their_crc_holds() -> None:
    sent = frames(12)
    stream = b"".join([*sent[:5], CHANCE, sent[6][12:], *sent[7:]])
    whole = Bota().decoder().feed(stream)
    assert whole.device_s == pytest.approx([0.0, 0.001, 0.002, 0.003, 0.004, 0.007, 0.008, 0.009, 0.01])
    decoder = Bota().decoder()
    single = [decoder.feed(stream[i : i + 1]) for i in range(len(stream))]
    assert (np.concatenate([s.wrench for s in single]) == whole.wrench).all()
    # Where a header follows, it is a reading like any other.
    assert len(Bota().decoder().feed(b"".join([*sent[:5], CHANCE, *sent[5:]]))) == 12


def test_conversation() -> None:
    link = Scripted(
        [(b"C", b"r,0,C,0\r\n"), (LINE, b"r,0,c,0\r\n"), (b"R", b"r,0,R,0\r\n"), (b"C", b"")],
        then=[b"boot...\r\nApp ", b"Init\r\n"],
    )
    cell = Bota()
    cell.start(link)
    cell.stop(link)
    link.close()


def test_one_that_streams_already_is_asked_again_until_it_answers() -> None:
    stream = b"".join(frames(5))
    link = Scripted(
        [
            (b"C", b""),
            (b"C", stream + b"r,0,C,0\r\n"),
            (b"c,1,1,0,4", b"r,0,c,0"),
            (b"R", stream),
        ],
        then=[stream[:90], b""],
    )
    Bota({"temperature_compensation": "on"}).start(link)
    link.close()


def test_one_that_stays_quiet_may_wait_for_its_configuration() -> None:
    link = Scripted([(b"C", b"r,0,C,0"), (LINE, b"r,0,c,0"), (b"R", b"r,0,R,0")])
    Bota().start(link)
    link.close()


@pytest.mark.parametrize(("answer", "said"), [(b"", "no answer to C"), (b"GSV-3 1.0\r\n", "the device says b'GSV-3")])
def test_another_device_or_none_is_said(answer: bytes, said: str) -> None:
    with pytest.raises(DriverError, match=said):
        Bota().start(Scripted([(b"C", answer), *[(b"C", b"")] * (TRIES - 1)]))
