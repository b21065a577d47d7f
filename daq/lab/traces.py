"""Everything numeric in a recording, over time, before anybody has said what is what."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from daq.errors import ReadingsError
from daq.journal.export import export
from daq.lab.channels import TIMESTAMP, Channel, LabChannels
from daq.lab.files import Increment
from daq.lab.levels import still_spans
from daq.lab.opened import open_channels
from daq.lab.proposals import propose_time, stated_unit
from daq.recordings.windows import Span
from daq.units import factor_of

Floats = NDArray[np.float64]

# So many channels that are left out are named each.
_FEW = 3
_JOURNAL = b"SQLite format 3\x00"


@dataclass(frozen=True, eq=False)
class Traces:
    """A recording's channels.

    Attributes:
        t: (n,) time, in `unit`.
        unit: s, or what the file counts in where it states no unit.
        names: of the channels; units: as the file states them, nothing where it does not.
        values: (n, k) in those units.
        notes: what the reader should know.
    """

    t: Floats
    unit: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Floats
    notes: tuple[str, ...]

    def plateaus(self) -> list[Span]:
        """Return spans in which nothing leaves its level by more than noise, or a thousandth of its range."""
        return still_spans(self.t, self.values, 4e-3 * np.ptp(self.values, axis=0))


@contextmanager
def as_recording(path: Path) -> Iterator[Path]:
    """Yield a recording's file; a journal is exported for as long.

    Raises:
        InputError: the journal cannot be read.
    """
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
    """Read all numbers of a recording.

    Raises:
        ReadingsError: it is no recording, or has no numbers.
    """
    source = open_channels(path)
    sound = [c for c in source.channels if not c.fault]
    faults = [f"{c.name} is left out: it {c.fault}" for c in source.channels if c.fault]
    left_out = faults if len(faults) <= _FEW else [f"{len(faults)} channels are left out: {faults[0]}; and so on"]
    if not sound:
        raise ReadingsError(f"{source.path.name} has no channel of numbers", "one at least")
    doubts: list[str] = []
    try:
        time = propose_time(source, sound[0], set(), doubts)
    except ReadingsError:
        time = None
    clock = None if time is None or isinstance(time, Increment) else source.channel(time.channel)
    used = [c for c in sound if c is not clock] or sound
    used, apart = _together(source, used, clock)
    blocks = list(source.blocks([*(c.name for c in used), *([clock.name] if clock else [])]))
    if not blocks:
        raise ReadingsError(f"{source.path.name} has no readings", "at least one in each channel")
    whole = np.concatenate(blocks)
    t, unit = np.arange(len(whole), dtype=np.float64), "reading"
    if clock is not None and time is not None and not isinstance(time, Increment):
        stated = "s" if time.unit == TIMESTAMP else time.unit or ""
        factor = factor_of(stated, "time")
        t, unit = (whole[:, -1] * factor, "s") if factor is not None else (whole[:, -1], stated or clock.name)
        whole = whole[:, :-1]
    elif used[0].increment_s is not None:
        t, unit = used[0].start_s + used[0].increment_s * t, "s"
    cut = (f"{source.path.name} is cut off: what all its channels have is shown",) if source.cut_off else ()
    notes = (*cut, *source.notes, *left_out, *apart, *doubts)
    return Traces(t, unit, tuple(c.name for c in used), tuple(stated_unit(c) for c in used), whole, notes)


def _together(source: LabChannels, channels: list[Channel], clock: Channel | None) -> tuple[list[Channel], list[str]]:
    """Return channels that share the first one's start, increment and count, and why others are left out."""
    first = clock or channels[0]

    def shared(c: Channel) -> bool:
        return (c.start_s, c.increment_s, c.count) == (first.start_s, first.increment_s, first.count)

    own = [c for c in channels if shared(c)] or channels[:1]
    apart = [c.name for c in channels if c not in own]
    if len(apart) > _FEW:
        return own, [f"{len(apart)} channels are left out, {apart[0]} and others: they start or step otherwise"]
    return own, [f"{name} is left out: it starts or steps otherwise" for name in apart]
