"""Simulated transmission faults of a device: bytes dropped, flipped, held back, or read at the wrong rate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Faults:
    """Frequencies of transmission faults; 0 is never.

    Attributes:
        dropped_per_s: a byte is lost.
        flipped_per_s: a bit is turned.
        lost_per_s: a whole record (or datagram) is lost.
        burst_s: bytes are held back and come together, as by a USB adapter's latency timer [s].
        pulled_every_s: the cable is pulled so often [s]; for `pulled_for_s`.
        pulled_for_s: how long the cable stays out [s].
        wrong_baud: every byte is read at the wrong rate.
        first_count: the device's count begins here, so that it wraps soon.
        saturated_every_s: so often the load leaves the cell's range, for a second [s].
    """

    dropped_per_s: float = 0.0
    flipped_per_s: float = 0.0
    lost_per_s: float = 0.0
    burst_s: float = 0.0
    pulled_every_s: float = 0.0
    pulled_for_s: float = 2.0
    wrong_baud: bool = False
    first_count: int = 0
    saturated_every_s: float = 0.0


class FaultyWire:
    """Does to records what the faults say, always the same for one seed."""

    def __init__(self, faults: Faults, seed: int = 0) -> None:
        self._faults = faults
        self._rng = np.random.default_rng(seed)
        # Faults whose time has come while nothing was on the wire: they befall the next records, so that the rates
        # hold for a slow device too, most of whose turns send nothing.
        self._losses = self._flips = self._drops = 0

    def carry(self, records: list[bytes], passed_s: float) -> list[bytes]:
        """Return what arrives of some records that took so long to send [s]."""
        self._losses += int(self._rng.poisson(self._faults.lost_per_s * passed_s))
        self._flips += int(self._rng.poisson(self._faults.flipped_per_s * passed_s))
        self._drops += int(self._rng.poisson(self._faults.dropped_per_s * passed_s))
        out = [bytearray(r) for r in records]
        while self._losses and out:
            del out[int(self._rng.integers(len(out)))]
            self._losses -= 1
        while self._flips and (where := self._somewhere(out)) is not None:
            where[0][where[1]] ^= 1 << int(self._rng.integers(8))
            self._flips -= 1
        while self._drops and (where := self._somewhere(out)) is not None:
            del where[0][where[1]]
            self._drops -= 1
        return [_garbled(r) if self._faults.wrong_baud else bytes(r) for r in out]

    def _somewhere(self, records: list[bytearray]) -> tuple[bytearray, int] | None:
        full = [r for r in records if r]
        if not full:
            return None
        record = full[int(self._rng.integers(len(full)))]
        return record, int(self._rng.integers(len(record)))


def _garbled(record: bytearray) -> bytes:
    """Sample bits at half their rate: half as many bytes, of every other bit."""
    bits = np.unpackbits(np.frombuffer(bytes(record), np.uint8), bitorder="little")[::2]
    return np.packbits(bits, bitorder="little").tobytes()
