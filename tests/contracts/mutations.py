"""What happens to a load cell's bytes on their way: damage that knows which records it left whole."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

KINDS = ("flipped", "overwritten", "deleted", "inserted", "duplicated", "truncated")


@dataclass(frozen=True)
class Damaged:
    """Records as they arrive.

    Attributes:
        pieces: one stream of bytes, or datagrams.
        whole: numbers of the records that arrive as they were sent.
        damages: how many places were damaged.
    """

    pieces: tuple[bytes, ...]
    whole: frozenset[int]
    damages: int


def damage_stream(records: Sequence[bytes], kinds: Sequence[str], rng: np.random.Generator) -> Damaged:
    """Damage one to three places of a stream, each far from the others.

    Far, as no check sees everything: of two flipped bits in one record some sums see none. What lies in one place is
    one bit (`flipped`), or as many bytes as up to two records have.
    """
    stream = b"".join(records)
    ends = np.cumsum([len(r) for r in records])
    most = 2 * max(len(r) for r in records)
    count = int(rng.integers(1, 4))
    whole = set(range(len(records)))
    out, taken = bytearray(), 0
    for i in range(count):
        first, last = (len(stream) * i) // count + most, (len(stream) * (i + 1)) // count - 2 * most
        at, size = int(rng.integers(first, last)), int(rng.integers(1, most + 1))
        kind = kinds[int(rng.integers(len(kinds)))]
        if kind == "truncated" and count > 1:
            kind = "deleted"
        out += stream[taken:at]
        piece, upto = _damage(kind, stream, at, size, rng)
        out += piece
        taken = upto
        if kind == "truncated":
            taken = len(stream)
        whole -= set(_touched(ends, at, max(upto, at + 1) if kind != "inserted" else at))
        if kind == "truncated":
            whole -= set(range(int(np.searchsorted(ends, at, "right")), len(records)))
    out += stream[taken:]
    return Damaged((bytes(out),), frozenset(whole), count)


def _damage(kind: str, stream: bytes, at: int, size: int, rng: np.random.Generator) -> tuple[bytes, int]:
    """Return what stands in place of the bytes from here, and where the rest goes on."""
    if kind == "flipped":
        return bytes([stream[at] ^ (1 << int(rng.integers(8)))]), at + 1
    if kind == "overwritten":
        return rng.bytes(size), at + size
    if kind == "inserted":
        return rng.bytes(size), at
    if kind == "duplicated":
        return stream[at : at + size] + stream[at : at + size], at + size
    return b"", at + size


def _touched(ends: Any, first: int, last: int) -> range:
    """Numbers of the records that have bytes from first to last; of an empty piece the one that it lies inside."""
    start = int(np.searchsorted(ends, first, "right"))
    if first == last:
        inside = start == 0 or ends[start - 1] != first
        return range(start, start + int(inside))
    return range(start, int(np.searchsorted(ends, last - 1, "right")) + 1)


def damage_datagrams(records: Sequence[bytes], rng: np.random.Generator) -> Damaged:
    """Damage one to three datagrams: flipped, cut, lengthened, lost, doubled, or after one that nobody sent."""
    count = int(rng.integers(1, 4))
    places = sorted(int(p) for p in rng.choice(len(records), count, replace=False))
    pieces: list[bytes] = []
    for number, record in enumerate(records):
        if number not in places:
            pieces.append(record)
            continue
        at = int(rng.integers(len(record)))
        choices: tuple[tuple[bytes, ...], ...] = (
            (record[:at] + bytes([record[at] ^ (1 << int(rng.integers(8)))]) + record[at + 1 :],),
            (record[:at],),
            (record + rng.bytes(at + 1),),
            (),
            (record, record),
            (rng.bytes(at + 1), record),
        )
        pieces.extend(choices[int(rng.integers(len(choices)))])
    return Damaged(tuple(pieces), frozenset(range(len(records))) - set(places), count)


def held_bytes(thing: object, depth: int = 5) -> int:
    """How much text and bytes something keeps, in what it is made of."""
    if isinstance(thing, bytes | bytearray | str):
        return len(thing)
    if isinstance(thing, np.ndarray):
        return int(thing.nbytes)
    if depth == 0:
        return 0
    if isinstance(thing, Mapping):
        return sum(held_bytes(v, depth - 1) for v in thing.values())
    if isinstance(thing, Sequence):
        return sum(held_bytes(v, depth - 1) for v in thing)
    inside = getattr(thing, "__dict__", None)
    return 0 if inside is None else sum(held_bytes(v, depth - 1) for v in inside.values())
