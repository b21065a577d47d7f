"""Frames with a check that is far too short: what holds by chance is refused, where a frame looks ahead."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.drivers.frames import FrameStream

LENGTH, HEADER = 12, b"\x20\x4e"
Octets = NDArray[np.uint8]


def valid(frames: Octets) -> NDArray[np.bool_]:
    return np.asarray(frames[:, 2:-1].sum(axis=1, dtype=np.uint64) % 256 == frames[:, -1])


def sent(count: int, rng: np.random.Generator) -> list[bytes]:
    body = rng.integers(0, 256, (count, LENGTH - 3), dtype=np.uint8)
    return [HEADER + row.tobytes() + bytes([int(row.sum(dtype=np.uint64)) % 256]) for row in body]


def decoded(stream: bytes, ahead: bool, rng: np.random.Generator) -> list[bytes]:
    """Frames of a stream in portions, which must make no difference."""
    whole = FrameStream(LENGTH, HEADER, valid, ahead=ahead).feed(stream)
    places = [0, *sorted(int(p) for p in rng.integers(0, len(stream), 40)), len(stream)]
    parted = FrameStream(LENGTH, HEADER, valid, ahead=ahead)
    found = [parted.feed(stream[a:b]) for a, b in pairwise(places)]
    assert (np.concatenate([f.frames for f in found]) == whole.frames).all()
    counts = [sum(f.rejected for f in found), sum(f.skipped for f in found)]
    assert counts == [whole.rejected, whole.skipped]
    return [row.tobytes() for row in whole.frames]


@pytest.mark.parametrize(("ahead", "most_false", "least_false"), [(False, 200, 20), (True, 1, 0)])
def test_bytes_that_are_lost_make_a_frame_of_two_only_without_looking_ahead(
    ahead: bool, most_false: int, least_false: int
) -> None:
    rng = np.random.default_rng(3)
    false = missing = 0
    damages = 10_000
    for _ in range(damages // 10):
        records = sent(60, rng)
        stream, taken = b"", 0
        for k in range(10):
            at = (6 * k + 3) * LENGTH + int(rng.integers(LENGTH))
            stream += b"".join(records)[taken:at]
            taken = at + int(rng.integers(1, LENGTH))
        stream += b"".join(records)[taken:]
        got = decoded(stream, ahead, rng)
        false += len(set(got) - set(records))
        missing += len(set(records) - set(got))
    # A check of 8 bits holds once in 256 times.
    assert least_false <= false <= most_false
    # Each loss costs the one or two frames that it touches, and one more where it took the next one's header.
    assert missing < 2.5 * damages


def test_without_damage_only_the_last_frame_waits() -> None:
    rng = np.random.default_rng(4)
    records = sent(50, rng)
    stream = b"".join(records)
    assert decoded(stream, True, rng) == records[:-1]
    assert decoded(stream + HEADER, True, rng) == records
    assert decoded(stream, False, rng) == records


def test_a_damaged_header_costs_its_frame_alone() -> None:
    rng = np.random.default_rng(5)
    records = sent(20, rng)
    for at in (0, 1):
        stream = bytearray(b"".join(records))
        stream[7 * LENGTH + at] ^= 0x81
        assert decoded(bytes(stream), True, rng) == [*records[:7], *records[8:-1]]
