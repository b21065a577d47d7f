"""OptoForce (OnRobot) six-axis sensors, over USB."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.drivers.base import (
    BOOT_S,
    Floats,
    LoadCell,
    Samples,
    Setting,
    Transport,
    Unwrap,
    heard_without_samples,
    samples,
)
from daq.errors import DriverError

HEADER = b"\xaa\x07\x08\x10"
FRAME = np.dtype([("header", ">u4"), ("count", ">u2"), ("status", ">u2"), ("counts", ">i2", (6,)), ("sum", ">u2")])
LENGTH = FRAME.itemsize
SUMMED = LENGTH - 2
# Of the next frame its header and count.
SEEN_AHEAD = 6
# So many equal steps of the count in a row are a rule.
STEADY = 16
UNKNOWN = "unknown"
MOST_BYTES = 1 << 16


class OptoForceDecoder:
    """Frames of `AA 07 08 10`, count, status, six int16 and the sum of all bytes before, all big-endian.

    Where bytes were lost, the parts of two frames can give the right sum by chance, about once in a thousand times. So
    a frame counts only where the next begins right after it, and waits for that. And where the count has risen steadily
    it must do so to the next, by whatever it rises; a device whose count does not is not held to that. What remains: a
    sum sees no two errors in a frame that cancel.
    """

    def __init__(self, counts_per_unit: Floats, overload_bits: int = 0) -> None:
        self._counts_per_unit = counts_per_unit
        self._overload_bits = overload_bits
        self._unwrap = Unwrap(1 << 16)
        self._held = b""
        self._aligned = False
        self._step, self._steady = -1, 0

    def feed(self, data: bytes) -> Samples:
        """Take bytes and return the readings that they complete."""
        buffer = self._held + data
        runs: list[NDArray[Any]] = []
        at = rejected = skipped = 0
        while len(buffer) - at >= LENGTH + SEEN_AHEAD:
            run = _run(buffer, at)
            steady = self._steady_until(buffer, at, run)
            if steady:
                runs.append(np.frombuffer(buffer, FRAME, steady, at))
                at += steady * LENGTH
                self._aligned = True
            if steady and steady == run:
                continue
            rejected += int(self._aligned)
            self._aligned = False
            next_at = buffer.find(HEADER, at + 1)
            if next_at < 0:
                next_at = len(buffer) - len(HEADER) + 1
            skipped += next_at - at
            at = next_at
        self._held = buffer[at:]
        table = np.concatenate(runs) if runs else np.zeros(0, dtype=FRAME)
        status = table["status"].astype(np.int64)
        return samples(
            table["counts"].astype(np.float64) / self._counts_per_unit,
            status,
            (status & self._overload_bits) != 0,
            sequence=self._unwrap(table["count"]),
            rejected=rejected,
            skipped=skipped,
        )

    def _steady_until(self, buffer: bytes, at: int, run: int) -> int:
        """Count the frames before one from which the count rises otherwise than it steadily did."""
        if run == 0:
            return 0
        behind = at + run * LENGTH + len(HEADER)
        next_count = int.from_bytes(buffer[behind : behind + 2], "big")
        counts = np.append(np.frombuffer(buffer, FRAME, run, at)["count"], next_count).astype(np.int64)
        steps, since = np.diff(counts) % (1 << 16), 0
        for place in np.flatnonzero(np.diff(steps, prepend=self._step)).tolist():
            if self._steady + place - since >= STEADY:
                self._step, self._steady = -1, 0
                return int(place)
            self._steady, since = 0, place
        self._step, self._steady = int(steps[-1]), min(self._steady + run - since, STEADY)
        return run


def _run(buffer: bytes, at: int) -> int:
    """Count the good frames that follow each other from here, each with the next one's header after it."""
    if not _good(buffer, at):
        return 0
    count = (len(buffer) - at - SEEN_AHEAD) // LENGTH
    octets = np.frombuffer(buffer, np.uint8, count * LENGTH, at).reshape(count, LENGTH)
    table = octets.view(FRAME)[:, 0]
    headed = table["header"] == int.from_bytes(HEADER, "big")
    good = headed & ((octets[:, :SUMMED].sum(axis=1, dtype=np.uint32) & 0xFFFF) == table["sum"])
    good[:-1] &= headed[1:]
    good[-1] &= buffer.startswith(HEADER, at + count * LENGTH)
    return count if good.all() else int(np.argmin(good))


def _good(buffer: bytes, at: int) -> bool:
    """Return whether one does; asked first, as most places where a header is looked for are none."""
    stated = int.from_bytes(buffer[at + SUMMED : at + LENGTH], "big")
    return (
        buffer.startswith(HEADER, at)
        and buffer.startswith(HEADER, at + LENGTH)
        and sum(buffer[at : at + SUMMED]) & 0xFFFF == stated
    )


class OptoForce(LoadCell):
    """OptoForce six-axis: 1 Mbaud, streams as it was set by its maker's program; its rate and filter are left alone."""

    name = "optoforce"
    title = "OptoForce, OnRobot six-axis (USB)"
    link = "serial"
    baud = 1_000_000
    settings = (
        Setting(
            "counts_per_N", "counts per newton, from its sheet: one number, or x,y,z where the axes differ", kind="text"
        ),
        Setting(
            "counts_per_Nmm", "counts per N mm, from its sheet: one number, or x,y,z where the axes differ", kind="text"
        ),
        Setting(
            "rate_hz",
            "how often a second its count rises, as it was set: without it arrivals tell the time",
            UNKNOWN,
            (UNKNOWN, "1000", "333", "100", "30", "10"),
        ),
        Setting(
            "overload_bits",
            "bits of its status word that mean overload, summed: 0 where they are not known",
            0,
            "count",
            -1,
        ),
    )
    example = (
        "fingertwin log --driver optoforce --port COM3 --set counts_per_N=100 --set counts_per_Nmm=2 "
        "--protocol levels --out DIR"
    )
    source = "frame as in public driver code, byte sum checked on golden bytes; meaning of the status bits not known"
    checksum = True
    held_back = 1
    clock = "counter"

    def __init__(self, given: Mapping[str, Any] | None = None) -> None:
        super().__init__(given)
        scales = [_three(self.name, name, self.text(name)) for name in ("counts_per_N", "counts_per_Nmm")]
        self._counts_per_unit = np.concatenate(scales)

    @property
    def rate_hz(self) -> float | None:
        """Rate that was set [Hz]; None where the settings do not say."""
        rate = self.text("rate_hz")
        return None if rate == UNKNOWN else float(rate)

    def decoder(self) -> OptoForceDecoder:
        """Return a fresh decoder."""
        return OptoForceDecoder(self._counts_per_unit, int(self.number("overload_bits")))

    def start(self, transport: Transport) -> None:
        """See that it streams; nothing is sent, as its one command would set its filter and zero anew too."""
        heard = heard_without_samples(transport, self.decoder(), BOOT_S, MOST_BYTES)
        if heard is not None:
            raise DriverError(
                f"the device says {heard[:16].hex(' ')}" if heard else "the device sends nothing",
                f"the stream of a six-axis OptoForce at {self.baud} baud",
                "Check cable and port; set its speed in the maker's program",
            )


def _three(driver: str, name: str, text: str) -> Floats:
    """Read one number for all axes, or three."""
    setting = Setting(name, "", above=0.0)
    numbers = [float(setting.parse(driver, part)) for part in text.split(",")]
    if len(numbers) not in (1, 3):
        raise DriverError(f"{driver}: {name} has {len(numbers)} numbers", "one, or three as x,y,z")
    return np.resize(np.array(numbers), 3)
