"""The analog channels of a C3D file."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.errors import ReadingsError
from daq.lab.channels import BLOCK_ROWS, Channel, LabChannels

Floats = NDArray[np.float64]

# The second byte of every C3D file; the first one tells where its parameters begin, which is nearly always block 2.
C3D = b"\x02\x50"
_BLOCK = 512
# By the processor that wrote it: the byte of the head that has the sign of its scale, which is negative of floats.
_SIGN_AT = {84: 15, 85: 13}


class C3dChannels(LabChannels):
    """Analog channels; what cameras saw is not read."""

    def __init__(self, path: Path) -> None:
        import ezc3d

        self.path = path
        self._require_whole(path.stat().st_size)
        try:
            file = ezc3d.c3d(str(path))
            analog = file["parameters"]["ANALOG"]
            self._values: Floats = np.asarray(file["data"]["analogs"], dtype=np.float64)[0]
            labels, units = (_texts(analog, key) for key in ("LABELS", "UNITS"))
            rate_hz = float(np.ravel(analog["RATE"]["value"])[0])
            ends_at = _ends_at(file)
        except (OSError, RuntimeError, ValueError, KeyError, IndexError, TypeError, MemoryError) as error:
            raise self._torn(" ".join(str(error).split())[:160]) from error
        if ends_at > path.stat().st_size:  # the head counts 65,535 frames at most
            raise self._torn(f"{path.stat().st_size} bytes of {ends_at}")
        # A writer fills the last frame up.
        read = np.flatnonzero(~np.isnan(self._values).all(axis=0))
        self._values = self._values[:, : read[-1] + 1 if len(read) else 0]
        names = [labels[i].strip() if i < len(labels) else "" for i in range(len(self._values))]
        names = [name or f"analog {i + 1}" for i, name in enumerate(names)]
        often = Counter(names)
        self._names = [n if often[n] == 1 else f"{n} #{i + 1}" for i, n in enumerate(names)]
        step_s = 1.0 / rate_hz if rate_hz > 0.0 else None
        self.channels = tuple(
            Channel(name, units[i].strip() if i < len(units) else "", increment_s=step_s)
            for i, name in enumerate(self._names)
        )

    def blocks(self, names: Sequence[str]) -> Iterator[Floats]:
        """Yield the numbers (n, k) of some channels."""
        places = [self._names.index(self.readable(name).name) for name in names]
        for at in range(0, self._values.shape[1], BLOCK_ROWS):
            yield self._values[places, at : at + BLOCK_ROWS].T

    def _require_whole(self, size: int) -> None:
        """Refuse a file that ends before its values do, by its head: the library would crash or wait for ever."""
        with self.path.open("rb") as stream:
            head = stream.read(_BLOCK)
            stream.seek((head[0] - 1) * _BLOCK if head[0] else 0)
            told = stream.read(4)
        if len(head) < _BLOCK or len(told) < 4 or told[3] not in _SIGN_AT:
            raise self._torn("its head is not whole, or of a processor that is not known")
        points, analogs, first, last = struct.unpack_from("<4H", head, 2)
        (data_block,) = struct.unpack_from("<H", head, 16)
        width = 4 if head[_SIGN_AT[told[3]]] & 0x80 else 2
        frames = max(last - first + 1, 0)
        ends_at = (data_block - 1) * _BLOCK + frames * (4 * points + analogs) * width
        ends_at = max(ends_at, (head[0] - 1 + told[2]) * _BLOCK)
        if ends_at > size:
            raise self._torn(f"{size} bytes of {ends_at}")

    def _torn(self, said: str) -> ReadingsError:
        return ReadingsError(f"{self.path.name} is torn or damaged ({said})", "a complete C3D file", "Copy it again")


def _texts(analog: Any, key: str) -> list[str]:
    """Return a list of texts, which goes on under numbered names where it is long."""
    found = []
    for name in (key, *(f"{key}{k}" for k in range(2, 20))):
        if name in analog:
            found += [str(text) for text in analog[name]["value"]]
    return found


def _ends_at(file: Any) -> int:
    """Return the byte at which the last value should end: values beyond a file's end would be made up."""
    point = file["parameters"]["POINT"]
    start = int(np.ravel(point["DATA_START"]["value"])[0])
    size = 4 if float(np.ravel(point["SCALE"]["value"])[0]) < 0.0 else 2
    points, frames = file["data"]["points"], file["data"]["analogs"]
    return (start - 1) * _BLOCK + (4 * points.shape[1] * points.shape[2] + frames.shape[1] * frames.shape[2]) * size
