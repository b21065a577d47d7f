"""Six gauge voltages as text lines over serial, turned into a wrench by the cell's calibration file."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.drivers.base import (
    BOOT_S,
    NOTHING,
    Integers,
    LoadCell,
    Samples,
    Setting,
    Transport,
    heard_without_samples,
    samples,
)
from daq.errors import DriverError
from daq.signals.gauges import GaugeCalibration, read_calibration, saturated, voltages

Floats = NDArray[np.float64]

# Without a line's end in so many bytes it is none.
LONGEST_LINE = 512
# More than a board says while it starts up.
MOST_BYTES = 1 << 13
# No gauge amplifier says more; it is a damaged number, or one in another unit.
MOST_V = 100.0

CALIBRATION = Setting("calibration", "path of the cell's calibration file (.cal), from the maker's disk", kind="text")
ZERO = Setting("zero_V", "six gauge voltages without load, such as '0 0 0 0 0 0'", "0 0 0 0 0 0", kind="text")
LIMIT = Setting("limit_V", "a gauge at or beyond ± this is saturated; 0 takes the calibration's OutputRange", 0.0)

_ENDS = re.compile(rb"[\r\n]")
_NUMBER = {
    name: re.compile(rf"[+-]?(?:\d+{sign}?\d*|{sign}\d+)(?:[eE][+-]?\d{{1,3}})?", re.ASCII)
    for name, sign in (("point", r"\."), ("comma", ","))
}
_BETWEEN = {"point": re.compile(r"\s*[,;]\s*|\s+"), "comma": re.compile(r"\s*;\s*|\s+")}


class Gauges:
    """A calibration with its zero and limit."""

    def __init__(self, cell: LoadCell) -> None:
        self.calibration: GaugeCalibration = read_calibration(cell.text(CALIBRATION.name))
        self.zero_V = voltages(cell.text(ZERO.name), f"{cell.name}: {ZERO.name}")
        given = cell.number(LIMIT.name)
        if given < 0.0:
            raise DriverError(f"{cell.name}: {LIMIT.name} is {given:g}", "volts, or 0")
        limit = given or self.calibration.limit_V
        if limit is None:
            raise DriverError(
                f"{self.calibration.name} states no range of the gauges",
                "their limit in volts",
                f"Give it with --set {LIMIT.name}=VALUE",
            )
        self.limit_V = limit

    def samples(self, volts: Floats, sequence: Integers | None = None, rejected: int = 0, skipped: int = 0) -> Samples:
        """Turn gauge voltages (n, 6) into samples; the status says which gauges are saturated, bit 0 the first."""
        status = saturated(volts, self.limit_V)
        wrench = self.calibration.wrench(volts, self.zero_V)
        return samples(wrench, status, status > 0, sequence, rejected=rejected, skipped=skipped)


class GaugeLinesDecoder:
    """Lines of numbers; the first is a part of one, and dropped."""

    def __init__(self, gauges: Gauges, decimal: str, columns: int, first_gauge: int, volts_per_unit: float) -> None:
        self._gauges = gauges
        self._number, self._between = _NUMBER[decimal], _BETWEEN[decimal]
        self._columns, self._first = columns, first_gauge - 1
        self._volts_per_unit = volts_per_unit
        self._held = b""
        # Until a line's end was seen, what comes belongs to a line that began before.
        self._partial = True
        # A line that is too long has been refused; the rest of it is still to come.
        self._refused = False

    def feed(self, data: bytes) -> Samples:
        """Take bytes and return the readings that they complete."""
        *lines, rest = _ENDS.split(self._held + data)
        rows: list[list[float]] = []
        rejected = skipped = 0
        for line in lines:
            if self._partial:
                skipped += len(line) + 1
            elif not self._refused and line:
                row = self._row(line)
                rejected += row is None
                if row is not None:
                    rows.append(row)
            self._partial = self._refused = False
        if self._partial:
            skipped += len(rest)
        elif len(rest) > LONGEST_LINE and not self._refused:
            rejected += 1
            self._refused = True
        self._held = b"" if self._partial or self._refused else rest
        return self._gauges.samples(np.array(rows) if rows else NOTHING, rejected=rejected, skipped=skipped)

    def _row(self, line: bytes) -> list[float] | None:
        if len(line) > LONGEST_LINE:
            return None
        fields = self._between.split(line.decode("ascii", "replace").strip())
        if len(fields) != self._columns:
            return None
        row = []
        for field in fields[self._first : self._first + 6]:
            if not self._number.fullmatch(field):
                return None
            volts = float(field.replace(",", ".")) * self._volts_per_unit
            if not abs(volts) <= MOST_V:
                return None
            row.append(volts)
        return row


class GaugeLines(LoadCell):
    """Any amplifier or microcontroller that writes a line of gauge voltages for each reading."""

    name = "gauge-volts"
    title = "six gauge voltages as text lines, for cells with an ATI calibration file"
    link = "serial"
    baud = 115200
    settings = (
        CALIBRATION,
        LIMIT,
        ZERO,
        Setting("columns", "numbers in a line", 6, "count", 5),
        Setting("first_gauge", "which of a line's numbers is gauge 1; the others follow it", 1, "count", 0),
        Setting("decimal", "decimal sign in the lines", "point", ("point", "comma")),
        Setting("volts_per_unit", "1 for lines in V, 0.001 for mV", 1.0, "number", 0.0),
    )
    example = "fingertwin log --driver gauge-volts --port COM3 --set calibration=FT.cal --protocol levels --out DIR"
    source = "the lines are the lab's own; calibration as in the maker's file, checked on two real ones"

    def __init__(self, given: Mapping[str, Any] | None = None) -> None:
        super().__init__(given)
        self.gauges = Gauges(self)
        if self.number("first_gauge") + 5 > self.number("columns"):
            raise DriverError(
                f"{self.name}: gauge 1 is number {self.values['first_gauge']} of {self.values['columns']} in a line",
                "six numbers from there on",
            )

    @property
    def rate_hz(self) -> None:
        """The lines do not say."""
        return None

    def decoder(self) -> GaugeLinesDecoder:
        """Return a fresh decoder."""
        return GaugeLinesDecoder(
            self.gauges,
            self.text("decimal"),
            int(self.number("columns")),
            int(self.number("first_gauge")),
            self.number("volts_per_unit"),
        )

    def start(self, transport: Transport) -> None:
        """See a first line of the right form; the device streams of itself."""
        heard = heard_without_samples(transport, self.decoder(), BOOT_S, MOST_BYTES)
        if heard is not None:
            raise DriverError(
                f"the device says {heard[:64]!r}" if heard else "no lines come",
                f"lines of {self.values['columns']} numbers with decimal {self.values['decimal']}s",
                "Check port, speed (--baud) and the settings columns and decimal",
            )
