"""The channels of a TDMS file."""

from __future__ import annotations

import io
import logging
import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from daq.errors import ReadingsError
from daq.lab.channels import BLOCK_ROWS, TIMESTAMP, Channel, LabChannels

Floats = NDArray[np.float64]

# What the reader of TDMS raises on damaged bytes.
_UNREADABLE = (
    ValueError, KeyError, TypeError, IndexError, AttributeError, ArithmeticError, MemoryError, OSError, EOFError,
    NotImplementedError, struct.error,
)  # fmt: skip
# Of a TDMS segment: its head, and the bit of it that turns the order of bytes round.
_LEAD_IN, _BIG_ENDIAN = 28, 1 << 6
# The scales that npTDMS applies.
_SCALES = (
    "Linear", "Polynomial", "RTD", "Strain", "Table", "Thermistor", "Thermocouple", "Add", "Subtract", "AdvancedAPI",
)  # fmt: skip
TDMS = (b"TDSm", b"TDSh")


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
                self._end = _last_segment(stream)
            with self._opened() as file:
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
    def _opened(self) -> Iterator[Any]:
        """Yield the file up to the last segment whose description is whole."""
        with self.path.open("rb") as stream, self._nptdms.TdmsFile.open(_Bounded(stream, self._end)) as file:
            yield file

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


def _last_segment(stream: BinaryIO) -> int:
    """Return the bytes up to the last segment with a whole description; later ones were cut off in writing."""
    size = stream.seek(0, 2)
    at = 0
    while size - at >= _LEAD_IN:
        stream.seek(at)
        lead = stream.read(_LEAD_IN)
        if lead[:4] not in TDMS:
            return size
        order = ">" if int.from_bytes(lead[4:8], "little") & _BIG_ENDIAN else "<"
        following, raw = struct.unpack(f"{order}QQ", lead[12:])
        if at + _LEAD_IN + raw > size:
            return at
        if at + _LEAD_IN + following >= size:
            return size
        at += _LEAD_IN + following
    return at


class _Bounded(io.RawIOBase):
    """A stream that ends earlier than its file."""

    def __init__(self, stream: BinaryIO, end: int) -> None:
        self._stream, self._end = stream, end
        stream.seek(0)

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = 0) -> int:
        return self._stream.seek(self._end + offset) if whence == 2 else self._stream.seek(offset, whence)

    def tell(self) -> int:
        return self._stream.tell()

    def read(self, size: int = -1) -> bytes:
        left = max(self._end - self._stream.tell(), 0)
        return self._stream.read(left if size < 0 else min(size, left))

    def readinto(self, buffer: Any) -> int:
        room = memoryview(buffer).cast("B")
        data = self.read(len(room))
        room[: len(data)] = data
        return len(data)
