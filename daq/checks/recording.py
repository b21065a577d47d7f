"""Look at a recording as a whole, block by block: its clock, gaps, saturation, stuck channels and status flags."""

from __future__ import annotations

from collections.abc import Iterator
from copy import deepcopy
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.cells import CellSpec, at_limit
from daq.findings import Finding, finding
from daq.quoting import counted
from daq.recordings.gaps import GAP_INTERVALS, Gap, GapFinder
from daq.recordings.readings import HEADERS, ReadingBlock

Floats = NDArray[np.float64]

AXES = HEADERS[1:]
JUMP_S = 10.0
# Of the intervals, so many may be wide without a reading missing before the clock is called irregular.
MOST_LATE = 0.05
RATE_TOLERANCE = 0.02
_MOST_KEPT = 10000


@dataclass
class RecordingScan:
    """Counts gathered while a recording streams past.

    Attributes:
        range: (6,) full scale of the cell, None where it is not known.
    """

    range: Floats | None = None
    rows: int = 0
    first_s: float = np.nan
    last_s: float = np.nan
    interval_s: float = np.nan
    gaps: list[Gap] = field(default_factory=list)
    gap_count: int = 0
    lost: int = 0
    late: int = 0
    least: Floats = field(default_factory=lambda: np.full(6, np.inf))
    most: Floats = field(default_factory=lambda: np.full(6, -np.inf))
    saturated: Floats = field(default_factory=lambda: np.zeros(6))
    saturated_s: float = np.nan
    unchanged: Floats = field(default_factory=lambda: np.zeros(6))
    run: Floats = field(default_factory=lambda: np.ones(6))
    longest: Floats = field(default_factory=lambda: np.ones(6))
    longest_end_s: Floats = field(default_factory=lambda: np.zeros(6))
    flags: int = 0
    flagged: int = 0
    flagged_first_s: float = np.nan
    _last: Floats | None = None
    _finder: GapFinder = field(default_factory=GapFinder)

    @classmethod
    def by(cls, spec: CellSpec | None, rate_hz: float | None = None) -> RecordingScan:
        """Begin a scan of readings of a cell, at a rate that is stated; None for what is not known."""
        return cls(range=None if spec is None else np.array(spec.range), _finder=GapFinder(rate_hz))

    def watch(self, blocks: Iterator[ReadingBlock]) -> Iterator[ReadingBlock]:
        """Pass blocks on, looking at each."""
        try:
            for block in blocks:
                self.take(block)
                yield block
        finally:
            self._note(self._finder.finish())

    def so_far(self) -> RecordingScan:
        """Return the scan of what has come, as of a recording that ends here; this one can go on."""
        out = deepcopy(self)
        out._note(out._finder.finish())
        return out

    def take(self, block: ReadingBlock) -> None:
        """Look at the next readings."""
        if not len(block):
            return
        t, w = block.t_s, block.wrench
        if self.rows == 0:
            self.first_s = float(t[0])
        self._note(self._finder.take(t))
        self.least = np.minimum(self.least, w.min(axis=0))
        self.most = np.maximum(self.most, w.max(axis=0))
        if self.range is not None:
            over = at_limit(w, self.range)
            if over.any() and not self.saturated.any():
                self.saturated_s = float(t[np.argmax(over.any(axis=1))])
            self.saturated += over.sum(axis=0)
        self._runs(t, w)
        if block.status is not None and block.status.any():
            at = np.flatnonzero(block.status)
            if not self.flagged:
                self.flagged_first_s = float(t[at[0]])
            self.flagged += len(at)
            self.flags |= int(np.bitwise_or.reduce(block.status[at]))
        self.rows += len(t)
        self.last_s = float(t[-1])
        self._last = w[-1].copy()

    def _note(self, gaps: list[Gap]) -> None:
        if np.isnan(self.interval_s):
            self.interval_s = self._finder.interval_s
        self.late = self._finder.late
        self.gap_count += len(gaps)
        self.lost += sum(g.lost for g in gaps)
        self.gaps += gaps[: _MOST_KEPT - len(self.gaps)]

    def _runs(self, t: Floats, w: Floats) -> None:
        """Follow how long each channel has kept one value."""
        before = w[0] if self._last is None else self._last
        for k in range(6):
            same = np.diff(w[:, k], prepend=before[k]) == 0.0
            if self._last is None:
                same[0] = False
            self.unchanged[k] += np.count_nonzero(same)
            changes = np.flatnonzero(~same)
            if not len(changes):
                lengths, ends = np.array([self.run[k] + len(t)]), np.array([len(t) - 1])
                self.run[k] += len(t)
            else:
                starts = np.concatenate([[0], changes])
                ends = np.concatenate([changes, [len(t)]]) - 1
                lengths = (ends - starts + 1).astype(float)
                lengths[0] += self.run[k]
                self.run[k] = lengths[-1]
            best = int(np.argmax(lengths))
            if lengths[best] > self.longest[k]:
                self.longest[k], self.longest_end_s[k] = lengths[best], t[max(int(ends[best]), 0)]

    def facts(self) -> dict[str, Any]:
        """Return the recording's numbers."""
        return {
            "readings": self.rows,
            "start_s": self.first_s,
            "end_s": self.last_s,
            "rate_hz": 1.0 / self.interval_s if self.interval_s > 0.0 else None,
            "gaps": self.gap_count,
            "lost_readings": self.lost,
            "least_N_Nmm": self.least.tolist(),
            "greatest_N_Nmm": self.most.tolist(),
            "flagged_readings": self.flagged,
        }


def unknown_range() -> Finding:
    """Return the note on a cell whose range is not known."""
    return finding(
        "note",
        "saturation_skipped",
        "load_cell",
        "the cell's range is not known, so saturation was not looked for",
        remedy="State its calibration, such as `model: ATI Nano17-E SI-25-0.25`",
    )


def recording_findings(
    scan: RecordingScan, file: str, rate_hz: float | None, spec: CellSpec | None, *, apart: bool = False
) -> list[Finding]:
    """Judge a scan.

    Args:
        scan: of the recording.
        file: name of the readings.
        rate_hz: that the session states.
        spec: of the cell, None where it is not known.
        apart: whether all saturated readings lie outside the windows, and so enter no force.
    """
    out: list[Finding] = []
    if not scan.rows:
        return out
    out += _clock(scan, file, rate_hz)
    for k in np.flatnonzero(scan.saturated):
        assert spec is not None  # noqa: S101 - saturation is only counted against a range
        unit = "N" if k < 3 else "N mm"
        out.append(
            finding(
                "warning" if apart else "error",
                "saturation",
                f"{file}: {AXES[k]}",
                f"{counted(int(scan.saturated[k]), 'reading')} at or beyond full scale "
                f"({spec.range[k]:g} {unit}, {spec.name}), "
                f"the first at {scan.saturated_s:.6g} s" + (", none of them in a window" if apart else ""),
                "readings inside the cell's range",
                "Compare known weights before and after: an overload can damage the cell"
                if apart
                else "Exclude the cases there, or use a cell with a larger range",
            )
        )
    out += _stuck(scan, file)
    if scan.flagged:
        out.append(
            finding(
                "warning",
                "status_flags",
                file,
                f"{scan.flagged} readings carry status flags (0x{scan.flags & 0xFFFFFFFF:08x} together), the first at "
                f"{scan.flagged_first_s:.6g} s",
                "status 0",
                "Look the bits up in the cell's manual. Of gauge volts, bit 0 is gauge 1 at the end of its range",
            )
        )
    return out


def _clock(scan: RecordingScan, file: str, rate_hz: float | None) -> list[Finding]:
    out: list[Finding] = []
    rate = 1.0 / scan.interval_s if scan.interval_s > 0.0 else 0.0
    if rate_hz is not None and rate and abs(rate / rate_hz - 1.0) > RATE_TOLERANCE:
        out.append(
            finding(
                "warning",
                "sample_rate",
                file,
                f"readings come at {rate:.4g} Hz",
                f"{rate_hz:.4g} Hz, as load_cell.rate_hz states",
                "Correct the one that is wrong: a wrong clock scales creep and drift",
            )
        )
    jumps = [g for g in scan.gaps if g.end_s - g.start_s > JUMP_S]
    gaps = scan.gap_count - len(jumps)
    if scan.late > MOST_LATE * scan.rows:
        out.append(
            finding(
                "warning",
                "irregular_clock",
                file,
                f"{scan.late} of {scan.rows} intervals exceed {GAP_INTERVALS:g} times the usual "
                f"{scan.interval_s:.4g} s, without a reading missing",
                "readings at a steady rate",
                "Were they stamped on arrival? Stamp them by the cell's counter",
            )
        )
    if gaps > 0:
        longest = max((g for g in scan.gaps if g not in jumps), key=lambda g: g.end_s - g.start_s)
        lost = scan.lost - sum(g.lost for g in jumps)
        out.append(
            finding(
                "warning",
                "gaps",
                file,
                f"{gaps} {'gap' if gaps == 1 else 'gaps'}, about {lost} readings lost, "
                f"the longest from {longest.start_s:.6g} to {longest.end_s:.6g} s",
                f"a reading every {scan.interval_s:.4g} s",
                "Look for a full buffer or a loose cable",
            )
        )
    out += [
        finding(
            "warning",
            "time_jump",
            file,
            f"time jumps from {start:.6g} to {end:.6g} s",
            f"a reading every {scan.interval_s:.4g} s",
            "Was the recording paused, or the clock set? Tare again after a pause",
        )
        for start, end, _ in jumps[:5]
    ]
    return out


def _stuck(scan: RecordingScan, file: str) -> list[Finding]:
    out: list[Finding] = []
    for k, name in enumerate(AXES):
        if scan.most[k] == scan.least[k]:
            moment = k >= 3
            out.append(
                finding(
                    "warning" if moment else "error",
                    "constant_channel",
                    f"{file}: {name}",
                    f"{scan.rows} readings are all {scan.most[k]:g}" + (", and count as not read" if moment else ""),
                    "the noise of a live channel",
                    "Look for a broken wire, or a column that was filled in",
                )
            )
            continue
        # A run of equal values this long does not come about by chance among so many readings.
        share = min(max(float(scan.unchanged[k]) / scan.rows, 1e-6), 1.0 - 1e-9)
        usual = np.log(scan.rows) / -np.log(share)
        if scan.longest[k] > 50 + 10.0 * usual:
            end = scan.longest_end_s[k]
            out.append(
                finding(
                    "warning",
                    "stuck_channel",
                    f"{file}: {name}",
                    f"{int(scan.longest[k])} readings alike until {end:.6g} s",
                    f"changes within about {usual:.0f} readings, as in the rest",
                    "Look for a frozen driver, and exclude the cases there",
                )
            )
    return out
