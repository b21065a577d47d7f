"""Everything numeric in a recording, over time, before anybody has said what is what."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from daq.errors import ReadingsError
from daq.journal.export import export
from daq.lab.channels import TIMESTAMP, Channel
from daq.lab.envelope import Envelope
from daq.lab.files import Increment
from daq.lab.levels import StillSpans
from daq.lab.names import stated_unit
from daq.lab.opened import open_channels
from daq.lab.proposals import propose_time
from daq.recordings.columns import QUANTITIES
from daq.recordings.readings import ReadingBlock
from daq.recordings.windows import Span
from daq.units import factor_of

Floats = NDArray[np.float64]

# So many channels that are left out are named each.
_FEW = 3
_JOURNAL = b"SQLite format 3\x00"


@dataclass(frozen=True, eq=False)
class Traces:
    """A recording's channels, as they are drawn.

    Attributes:
        readings: their number.
        unit: of time: s, or what the file counts in where it states no unit.
        names: of the channels; units: as the file states them, nothing where it does not.
        lines: of each channel (n,) times and values: all of them, or the least and the greatest of each stretch.
        lows: (k,) least values; highs: (k,) greatest.
        plateaus: spans in which nothing leaves its level by more than noise, or a thousandth of its range.
        notes: what the reader should know.
    """

    readings: int
    unit: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    lines: tuple[tuple[Floats, Floats], ...]
    lows: Floats
    highs: Floats
    plateaus: list[Span]
    notes: tuple[str, ...]


@contextmanager
def as_recording(path: Path) -> Iterator[Path]:
    """Yield a recording's file; a journal is exported for as long.

    Raises:
        InputError: the journal cannot be read.
    """
    if path.is_dir():
        raise ReadingsError(f"{path} is a folder", "a recording", "Name a file in it")
    try:
        with path.open("rb") as stream:
            journal = stream.read(len(_JOURNAL)) == _JOURNAL
    except OSError as error:
        raise ReadingsError(f"{path} cannot be read ({error.strerror})", "a recording") from error
    if not journal:
        yield path
        return
    with tempfile.TemporaryDirectory(prefix="fingertwin-", ignore_cleanup_errors=True) as folder:
        target = Path(folder) / f"{path.stem}.parquet"
        export(path, target, None)
        yield target


def read_traces(path: Path) -> Traces:
    """Read all numbers of a recording, block by block.

    Raises:
        ReadingsError: it is no recording, or has no numbers.
    """
    source = open_channels(path)
    sound = [c for c in source.channels if not c.fault]
    faults = [f"{c.name} is left out: it {c.fault}" for c in source.channels if c.fault]
    left_out = faults if len(faults) <= _FEW else [f"{len(faults)} channels are left out: {faults[0]}; and so on"]
    if not sound:
        why = f": {faults[0].replace(' is left out: it', '', 1)}" if faults else ""
        raise ReadingsError(f"{source.path.name} has no channel of numbers{why}", "one at least")
    doubts: list[str] = []
    try:
        time = propose_time(source, sound[0], set(), doubts)
    except ReadingsError:
        time = None
    clock = None if time is None or isinstance(time, Increment) else source.channel(time.channel)
    used = [c for c in sound if c is not clock] or sound
    used, apart = _together(used, clock)
    names = [c.name for c in used]
    factor, start, step, unit = 1.0, 0.0, 1.0, "reading"
    if clock is not None and time is not None and not isinstance(time, Increment):
        names.append(clock.name)
        unit = "s" if time.unit == TIMESTAMP else time.unit or ""
        known = factor_of(unit, "time")
        factor, unit = (1.0, unit or clock.name) if known is None else (known, "s")
    elif used[0].increment_s is not None:
        start, step, unit = used[0].start_s, used[0].increment_s, "s"
    envelope, still = Envelope(len(used)), StillSpans()
    for block in source.blocks(names):
        counted = start + step * np.arange(envelope.readings, envelope.readings + len(block), dtype=np.float64)
        t, values = (block[:, -1] * factor, block[:, :-1]) if len(names) > len(used) else (counted, block)
        envelope.add(t, values)
        still.add(t, values)
    if not envelope.readings:
        raise ReadingsError(f"{source.path.name} has no readings", "at least one in each channel")
    cut = (f"{source.path.name} is cut off: what all its channels have is shown",) if source.cut_off else ()
    return Traces(
        readings=envelope.readings,
        unit=unit,
        names=tuple(c.name for c in used),
        units=tuple(stated_unit(c) for c in used),
        lines=envelope.lines(),
        lows=envelope.lows,
        highs=envelope.highs,
        plateaus=still.spans(4e-3 * (envelope.highs - envelope.lows)),
        notes=(*cut, *source.notes, *left_out, *apart, *doubts),
    )


def traces_of(readings: Iterable[ReadingBlock], plateaus: list[Span]) -> Traces:
    """Return the traces of readings whose plateaus are known, block by block."""
    envelope = Envelope(6)
    for block in readings:
        envelope.add(block.t_s, block.wrench)
    return Traces(
        readings=envelope.readings,
        unit="s",
        names=QUANTITIES[1:],
        units=("N",) * 3 + ("N mm",) * 3,
        lines=envelope.lines(),
        lows=envelope.lows,
        highs=envelope.highs,
        plateaus=plateaus,
        notes=(),
    )


def _together(channels: list[Channel], clock: Channel | None) -> tuple[list[Channel], list[str]]:
    """Return channels that share rows, start and increment, with the time's where it states one; why others do not."""
    rows = [c for c in channels if c.count == (clock or channels[0]).count] or channels[:1]
    first = rows[0] if clock is None or clock.increment_s is None else clock
    own = [c for c in rows if (c.start_s, c.increment_s) == (first.start_s, first.increment_s)] or rows[:1]
    apart = [c.name for c in channels if c not in own]
    if len(apart) > _FEW:
        return own, [f"{len(apart)} channels are left out, {apart[0]} and others: they start or step otherwise"]
    return own, [f"{name} is left out: it starts or steps otherwise" for name in apart]
