"""The channels of a TDMS file."""

from __future__ import annotations

import logging
import struct
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.errors import ReadingsError
from daq.lab.channels import BLOCK_ROWS, TIMESTAMP, Channel, LabChannels
from daq.lab.tdms_segments import TDMS, Bounded, fault_of, last_segment

Floats = NDArray[np.float64]

# What the reader of TDMS raises on damaged bytes.
_UNREADABLE = (
    ValueError, KeyError, TypeError, IndexError, AttributeError, ArithmeticError, MemoryError, OSError, EOFError,
    NotImplementedError, struct.error,
)  # fmt: skip
# The scales that npTDMS applies.
_SCALES = (
    "Linear", "Polynomial", "RTD", "Strain", "Table", "Thermistor", "Thermocouple", "Add", "Subtract", "AdvancedAPI",
)  # fmt: skip


class TdmsChannels(LabChannels):
    """A TDMS file."""

    def __init__(self, path: Path) -> None:
        self.path = path
        # It brings no types; and it is needed only here.
        self._nptdms: Any = import_module("nptdms")
        # What it would write to the terminal is said here, once and in words.
        for name in ("nptdms.reader", "nptdms.tdms_segment", "nptdms.scaling", "nptdms.types"):
            logging.getLogger(name).setLevel(logging.ERROR)
        out = []
        # Opened here, since the reader leaves open what it fails on.
        try:
            with path.open("rb") as stream:
                self._end = last_segment(stream)
            with self._opened(self._require_sound) as file:
                self.cut_off = self._end < path.stat().st_size or bool(file.file_status.incomplete_final_segment)
                self._require_values(file)
                self._origin = _origin(file)
                for group in file.groups():
                    out += [self._describe(group, c, file) for c in group.channels() if len(c)]
        except _UNREADABLE as error:
            if isinstance(error, ReadingsError):
                raise
            raise self._torn(error) from error
        self.channels = tuple(out)

    def _require_values(self, file: Any) -> None:
        """Refuse a file whose last index tells more values than there are bytes, unless the end was cut off.

        Raises:
            ReadingsError: it does; or none of them is there.
        """
        statuses = file.file_status.channel_statuses or {}
        told = max((s.expected_length for s in statuses.values()), default=0)
        held = any(len(c) for g in file.groups() for c in g.channels())
        size = self.path.stat().st_size
        if told > size and not (held and self.cut_off):
            raise ReadingsError(
                f"{self.path.name} tells {told} values of a channel and has {size} bytes",
                "values that are there",
                "Copy it again",
            )

    def blocks(self, names: Sequence[str]) -> Iterator[Floats]:
        """Yield the numbers (n, k) of some channels."""
        wanted = [self.channel(name) for name in names]
        try:
            with self._opened() as file:
                sources = [file[c.group][c.name.removeprefix(c.group + "/")] for c in wanted]
                lengths = {len(s) for s in sources}
                if len(lengths) > 1 and not self.cut_off:
                    said = ", ".join(f"{c.name} {len(s)}" for c, s in zip(wanted, sources, strict=True))
                    raise ReadingsError(
                        f"{self.path.name} has channels of different length ({said})", "as many values in each"
                    )
                origins: list[Any] = [None] * len(sources)
                count = min(lengths)
                for at in range(0, count, BLOCK_ROWS):
                    rows = min(BLOCK_ROWS, count - at)
                    columns = [self._numbers(s, at, rows, i, origins) for i, s in enumerate(sources)]
                    yield np.stack(columns, axis=1)
        except _UNREADABLE as error:
            if isinstance(error, ReadingsError):
                raise
            raise self._torn(error) from error

    def _numbers(self, source: Any, at: int, rows: int, which: int, origins: list[Any]) -> Floats:
        values = np.asarray(source.read_data(at, rows))
        if values.dtype.kind == "M":
            if origins[which] is None:
                origins[which] = values[0]
            return np.asarray((values - origins[which]) / np.timedelta64(1, "ns") * 1e-9, dtype=np.float64)
        if values.dtype.kind not in "fiu":
            raise ReadingsError(f"{self.path.name}: {source.name} holds {values.dtype}", "numbers")
        return values.astype(np.float64)

    @contextmanager
    def _opened(self, look: Callable[[Any, Bounded], None] | None = None) -> Iterator[Any]:
        """Yield the file up to the last segment whose description is whole; it is looked at before."""
        with self.path.open("rb") as raw:
            stream = Bounded(raw, self._end)
            with self._nptdms.TdmsFile.open(stream) as file:
                if look is not None:
                    look(file, stream)
                stream.forget()
                yield file

    def _require_sound(self, file: Any, stream: Bounded) -> None:
        """Refuse a file whose segments cannot be as long as they say.

        Raises:
            ReadingsError: it is one.
        """
        fault = fault_of(file._reader._segments, stream)
        if fault:
            raise self._torn(ValueError(fault))

    def _describe(self, group: Any, channel: Any, file: Any) -> Channel:
        properties = channel.properties
        increment = properties.get("wf_increment")
        # A channel that is no waveform may state an increment of zero.
        stated = isinstance(increment, int | float) and np.isfinite(increment) and increment > 0.0
        unit = str(properties.get("unit_string") or properties.get("NI_UnitDescription") or "").strip()
        kind = np.dtype(channel.dtype).kind
        if kind == "M":
            unit = TIMESTAMP
        start = float(properties.get("wf_start_offset") or 0.0)
        begun = _datetime(properties.get("wf_start_time"))
        if begun is not None and self._origin is not None:
            start += float((begun - self._origin) / np.timedelta64(1, "ns")) * 1e-9
        fault = "" if kind in "fiuM" else "holds text"
        for holder in (channel, group, file):
            unknown = _unknown_scale(holder.properties)
            if unknown:
                fault = f"has a scale of type {unknown}, which is not known: its numbers would be raw counts"
        name = f"{group.name}/{channel.name}"
        return Channel(name, unit, group.name, float(increment) if stated else None, start, fault)

    def _torn(self, error: Exception) -> ReadingsError:
        text = " ".join(str(error).split())[:160]
        return ReadingsError(f"{self.path.name} is torn or damaged ({text})", "a complete TDMS file", "Copy it again")


def _datetime(value: Any) -> np.datetime64 | None:
    return value if isinstance(value, np.datetime64) and not np.isnat(value) else None


def _origin(file: Any) -> np.datetime64 | None:
    """Return the earliest start of a channel."""
    starts = (_datetime(c.properties.get("wf_start_time")) for g in file.groups() for c in g.channels())
    return min((s for s in starts if s is not None), default=None)


def _unknown_scale(properties: Any) -> str:
    """Return the first type of scale that npTDMS would leave away, saying nothing; nothing where it knows them all."""
    if properties.get("NI_Scaling_Status") == "scaled":
        return ""
    count = properties.get("NI_Number_Of_Scales")
    types = (properties.get(f"NI_Scale[{i}]_Scale_Type") for i in range(int(count or 0)))
    return next((str(t) for t in types if t is not None and t not in _SCALES), "")


__all__ = ["TDMS", "TdmsChannels"]
