"""The channels of a lab's recording: names, units, time increments, and numbers in blocks."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from daq.errors import ReadingsError

Floats = NDArray[np.float64]

BLOCK_ROWS = 1 << 14
TIMESTAMP = "timestamp"


@dataclass(frozen=True)
class Channel:
    """One channel of a file.

    Attributes:
        name: as in a mapping: `group/channel` in TDMS, the column's heading in LVM; unique in the file.
        unit: as the file states it, nothing where it does not; `timestamp` where it holds dates.
        group: of TDMS; nothing in LVM.
        increment_s: time from one value to the next, None where the file does not say.
        start_s: time of the first value by that account, against the file's first channel.
        fault: why its numbers cannot be read; nothing where they can.
        count: of values, where that can differ from the other channels'; None elsewhere.
    """

    name: str
    unit: str = ""
    group: str = ""
    increment_s: float | None = None
    start_s: float = 0.0
    fault: str = ""
    count: int | None = None


class LabChannels(ABC):
    """A file whose channels are known and whose numbers can be read.

    Attributes:
        path: of the file.
        channels: in its order.
        pauses_possible: it was written in parts, and what lay between them no increment tells.
        rounded_to_s: how finely increments are written [s].
        cut_off: its end is missing, as after a crash; of a compressed file known when it was read.
        notes: what else the reader should know.
    """

    path: Path
    channels: tuple[Channel, ...]
    pauses_possible: bool = False
    rounded_to_s: float = 0.0
    cut_off: bool = False
    notes: tuple[str, ...] = ()

    @abstractmethod
    def blocks(self, names: Sequence[str]) -> Iterator[Floats]:
        """Yield the numbers (n, k) of some channels, dates as seconds since the first.

        Raises:
            ReadingsError: a value is no number, a row is torn, channels are of different length.
        """

    def readable(self, name: str) -> Channel:
        """Return the channel of a name, whose numbers can be read.

        Raises:
            ReadingsError: there is none, or its numbers cannot be read.
        """
        channel = self.channel(name)
        if channel.fault:
            raise ReadingsError(f"{self.path.name}: {name} {channel.fault}", "numbers", "Map another channel")
        return channel

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
