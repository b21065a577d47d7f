"""The channels of TDMS and LVM files, as LabVIEW writes them: names, units, time increments, and numbers in blocks."""

from __future__ import annotations

import struct
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.errors import ReadingsError

Floats = NDArray[np.float64]

BLOCK_ROWS = 1 << 14
# What the reader of TDMS raises on damaged bytes.
_UNREADABLE = (
    ValueError, KeyError, TypeError, IndexError, AttributeError, ArithmeticError, MemoryError, OSError, EOFError,
    NotImplementedError, struct.error,
)  # fmt: skip
TIMESTAMP = "timestamp"
_LVM, _TDMS = b"LabVIEW Measurement", (b"TDSm", b"TDSh")


@dataclass(frozen=True)
class Channel:
    """One channel of a file.

    Attributes:
        name: as in a mapping: `group/channel` in TDMS, the column's heading in LVM; unique in the file.
        unit: as the file states it, nothing where it does not; `timestamp` where it holds dates.
        group: of TDMS; nothing in LVM.
        increment_s: time from one value to the next, None where the file does not say.
        start_s: time of the first value by that account.
    """

    name: str
    unit: str = ""
    group: str = ""
    increment_s: float | None = None
    start_s: float = 0.0


class LabChannels(ABC):
    """A file whose channels are known and whose numbers can be read.

    Attributes:
        path: of the file.
        channels: in its order.
        pauses_possible: it was written in parts, and what lay between them no increment tells.
        rounded_to_s: how finely increments are written [s].
        cut_off: its end is missing, as after a crash.
    """

    path: Path
    channels: tuple[Channel, ...]
    pauses_possible: bool = False
    rounded_to_s: float = 0.0
    cut_off: bool = False

    @abstractmethod
    def blocks(self, names: Sequence[str]) -> Iterator[Floats]:
        """Yield the numbers (n, k) of some channels, dates as seconds since the first.

        Raises:
            ReadingsError: a value is no number, a row is torn, channels are of different length.
        """

    def channel(self, name: str) -> Channel:
        """Return the channel of a name.

        Raises:
            ReadingsError: there is none.
        """
        found = [c for c in self.channels if c.name == name]
        if len(found) != 1:
            names = ", ".join(c.name for c in self.channels[:16])
            raise ReadingsError(
                f"{self.path.name} has {len(found)} channels {name!r}", f"one of {names}", "Correct the mapping"
            )
        return found[0]


def open_channels(path: str | Path) -> LabChannels:
    """Read what channels a TDMS or LVM file has; which of them it is is told by its first bytes.

    Raises:
        ReadingsError: it is neither, or torn.
    """
    file = Path(path)
    try:
        with file.open("rb") as stream:
            start = stream.read(32)
    except OSError as error:
        raise ReadingsError(
            f"{file.name} cannot be read ({error.strerror})", "a TDMS or LVM file", "Check the path"
        ) from error
    if start[:4] in _TDMS:
        return TdmsChannels(file)
    if start.removeprefix(b"\xef\xbb\xbf").startswith(_LVM):
        from daq.lab.lvm import LvmChannels

        return LvmChannels(file)
    raise ReadingsError(
        f"{file.name} is neither",
        "a TDMS file, or an LVM file with its header",
        "Without a header it is plain text: convert it to CSV with a header line",
    )


class TdmsChannels(LabChannels):
    """A TDMS file."""

    def __init__(self, path: Path) -> None:
        self.path = path
        # It brings no types; and it is needed only here.
        self._nptdms: Any = import_module("nptdms")
        out = []
        # Opened here, since the reader leaves open what it fails on.
        try:
            with path.open("rb") as stream, self._nptdms.TdmsFile.open(stream) as file:
                self.cut_off = bool(file.file_status.incomplete_final_segment)
                for group in file.groups():
                    out += [self._describe(group.name, c) for c in group.channels() if len(c)]
        except _UNREADABLE as error:
            raise self._torn(error) from error
        self.channels = tuple(out)

    def blocks(self, names: Sequence[str]) -> Iterator[Floats]:
        """Yield the numbers (n, k) of some channels."""
        wanted = [self.channel(name) for name in names]
        try:
            with self.path.open("rb") as stream, self._nptdms.TdmsFile.open(stream) as file:
                sources = [file[c.group][c.name.removeprefix(c.group + "/")] for c in wanted]
                lengths = {len(s) for s in sources}
                if len(lengths) > 1:
                    said = ", ".join(f"{c.name} {len(s)}" for c, s in zip(wanted, sources, strict=True))
                    raise ReadingsError(
                        f"{self.path.name} has channels of different length ({said})", "as many values in each"
                    )
                origins: list[Any] = [None] * len(sources)
                for at in range(0, lengths.pop(), BLOCK_ROWS):
                    columns = [self._numbers(s, at, i, origins) for i, s in enumerate(sources)]
                    yield np.stack(columns, axis=1)
        except _UNREADABLE as error:
            if isinstance(error, ReadingsError):
                raise
            raise self._torn(error) from error

    def _numbers(self, source: Any, at: int, which: int, origins: list[Any]) -> Floats:
        values = np.asarray(source.read_data(at, min(BLOCK_ROWS, len(source) - at)))
        if values.dtype.kind == "M":
            if origins[which] is None:
                origins[which] = values[0]
            return np.asarray((values - origins[which]) / np.timedelta64(1, "ns") * 1e-9, dtype=np.float64)
        if values.dtype.kind not in "fiu":
            raise ReadingsError(f"{self.path.name}: {source.name} holds {values.dtype}", "numbers")
        return values.astype(np.float64)

    @staticmethod
    def _describe(group: str, channel: Any) -> Channel:
        properties = channel.properties
        increment = properties.get("wf_increment")
        # A channel that is no waveform may state an increment of zero.
        stated = isinstance(increment, int | float) and np.isfinite(increment) and increment > 0.0
        unit = str(properties.get("unit_string") or properties.get("NI_UnitDescription") or "").strip()
        if np.dtype(channel.dtype).kind == "M":
            unit = TIMESTAMP
        start = float(properties.get("wf_start_offset") or 0.0)
        return Channel(f"{group}/{channel.name}", unit, group, float(increment) if stated else None, start)

    def _torn(self, error: Exception) -> ReadingsError:
        text = " ".join(str(error).split())[:160]
        return ReadingsError(f"{self.path.name} is torn or damaged ({text})", "a complete TDMS file", "Copy it again")
