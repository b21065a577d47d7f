"""OptoForce: golden bytes, its count, what a byte sum can and cannot tell, and that it streams."""

from __future__ import annotations

import numpy as np
import pytest

from daq.drivers.optoforce import OptoForce
from daq.errors import DriverError
from daq.standins.optoforce import OptoForceStandIn
from tests.daq.drivers.scripted import Scripted

GOLDEN = bytes.fromhex("aa070810000100000064ff9c003200010002fffd04fa")
SCALE = {"counts_per_N": 100, "counts_per_Nmm": 2}


def frames(n: int, first: int = 0) -> list[bytes]:
    wrench = np.random.default_rng(1).uniform(-50.0, 50.0, (n, 6))
    return OptoForceStandIn().encode(wrench, first + np.arange(n), np.zeros(n))


def test_golden_bytes() -> None:
    decoder = OptoForce(SCALE).decoder()
    got = [decoder.feed(GOLDEN), decoder.feed(GOLDEN[:5]), decoder.feed(GOLDEN[5:6])]
    # A frame counts once the next one begins right after it.
    assert [len(s) for s in got] == [0, 0, 1]
    assert got[2].wrench[0] == pytest.approx([1.0, -1.0, 0.5, 0.5, 1.0, -1.5])
    assert got[2].sequence is not None
    assert got[2].sequence.tolist() == [1]
    assert not got[2].overload.any()


def test_the_stand_in_writes_the_golden_bytes() -> None:
    wrench = np.array([[1.0, -1.0, 0.5, 0.5, 1.0, -1.5]])
    assert OptoForceStandIn().encode(wrench, np.array([1]), np.array([0.0])) == [GOLDEN]


def test_axes_may_have_scales_of_their_own() -> None:
    cell = OptoForce({"counts_per_N": "100, 50, 25", "counts_per_Nmm": "1,2,4"})
    got = cell.decoder().feed(GOLDEN * 2)
    assert got.wrench[0] == pytest.approx([1.0, -2.0, 2.0, 1.0, 1.0, -0.75])


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"counts_per_N": "1,2", "counts_per_Nmm": 2}, "has 2 numbers; expected one, or three"),
        ({"counts_per_N": 0, "counts_per_Nmm": 2}, "a number above 0"),
        ({"counts_per_N": "many", "counts_per_Nmm": 2}, "'many'"),
        ({"counts_per_N": 100}, "lacks counts_per_Nmm"),
    ],
)
def test_a_scale_that_is_none_is_refused(given: dict[str, float | str], said: str) -> None:
    with pytest.raises(DriverError, match=said):
        OptoForce(given)


def test_the_count_goes_on_where_its_16_bits_wrap() -> None:
    got = OptoForce(SCALE).decoder().feed(b"".join(frames(6, 65533)))
    assert got.sequence is not None
    assert got.sequence.tolist() == [65533, 65534, 65535, 65536, 65537]


def test_status_is_kept_and_the_bits_that_were_named_are_overload() -> None:
    sent = OptoForceStandIn().encode(np.ones((4, 6)), np.arange(4), np.zeros(4), np.array([0, 0x10, 0x400, 0]))
    assert OptoForce(SCALE).decoder().feed(b"".join(sent)).overload.tolist() == [False] * 3
    got = OptoForce({**SCALE, "overload_bits": 0x3F0}).decoder().feed(b"".join(sent))
    assert got.status.tolist() == [0, 0x10, 0x400]
    assert got.overload.tolist() == [False, True, False]


def test_a_changed_byte_costs_its_frame_and_one_in_a_header_the_frame_before_too() -> None:
    sent = frames(8)
    for place, left in ((11, [0, 1, 2, 4, 5, 6]), (0, [0, 1, 4, 5, 6])):
        damaged = bytearray(sent[3])
        damaged[place] ^= 0xFF
        got = OptoForce(SCALE).decoder().feed(b"".join([*sent[:3], bytes(damaged), *sent[4:]]))
        assert got.sequence is not None
        assert got.sequence.tolist() == left
        assert got.rejected == 1


def test_a_sum_that_holds_by_chance_across_a_gap_makes_no_reading() -> None:
    first, second = frames(2, 7)
    # The frame's head, then a gap, then bytes of the next frame that happen to complete its sum.
    joined = bytearray(first[:10] + b"\x00" * 10 + b"\x00\x00")
    joined[20:22] = (sum(joined[:20]) & 0xFFFF).to_bytes(2, "big")
    after = frames(3, 20)
    got = OptoForce(SCALE).decoder().feed(first + second + bytes(joined) + b"\x01" + b"".join(after))
    assert got.sequence is not None
    assert got.sequence.tolist() == [7, 8, 20, 21]


def test_two_frames_joined_where_whole_ones_were_lost_make_no_reading() -> None:
    sent = frames(60)
    # The beginning of one and the end of another, and a sum that holds by chance: only its count tells.
    joined = bytearray(sent[30][:12] + sent[33][12:20])
    joined += (sum(joined) & 0xFFFF).to_bytes(2, "big")
    got = OptoForce(SCALE).decoder().feed(b"".join([*sent[:30], bytes(joined), *sent[34:]]))
    assert got.sequence is not None
    assert got.sequence.tolist() == [*range(30), *range(34, 59)]
    assert got.rejected == 1


@pytest.mark.parametrize("steps", [[0], [10], [1, 2, 3], [3] * 10 + [4]])
def test_however_its_count_rises_nothing_is_lost(steps: list[int]) -> None:
    count = np.cumsum(np.resize(steps, 200))
    sent = OptoForceStandIn().encode(np.ones((200, 6)), count, np.zeros(200))
    got = OptoForce(SCALE).decoder().feed(b"".join(sent))
    assert got.sequence is not None
    assert got.sequence.tolist() == count[:-1].tolist()


def test_headers_without_frames_are_passed_over() -> None:
    decoder = OptoForce(SCALE).decoder()
    got = decoder.feed(GOLDEN[:4] * 20_000)
    assert len(got) == 0
    assert got.skipped > 79_900


def test_it_is_listened_to_and_never_told_anything() -> None:
    link = Scripted([], then=[GOLDEN[5:], GOLDEN, GOLDEN[:6]])
    cell = OptoForce(SCALE)
    cell.start(link)
    cell.stop(link)
    link.close()


@pytest.mark.parametrize(("says", "said"), [(b"", "sends nothing"), (b"1.0,2.0\r\n" * 9, "the device says 31 2e 30")])
def test_another_device_or_none_is_said(says: bytes, said: str) -> None:
    with pytest.raises(DriverError, match=said):
        OptoForce(SCALE).start(Scripted([], then=[says]))


def test_its_rate_is_what_was_said() -> None:
    assert OptoForce(SCALE).rate_hz is None
    assert OptoForce({**SCALE, "rate_hz": "333"}).rate_hz == 333.0
