"""The channels of an HDF5 file: its one-dimensional datasets, the columns of its tables, and fields of records."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.errors import ReadingsError
from daq.lab.channels import BLOCK_ROWS, Channel, LabChannels
from daq.lab.packed import require_held

Floats = NDArray[np.float64]

HDF5 = b"\x89HDF\r\n\x1a\n"
# MATLAB puts a text before it.
MATLAB_HDF5 = b"MATLAB 7.3 MAT-file"
_UNITS, _NAMES = ("unit", "units"), ("names", "columns", "labels", "channels")
# A table has no more columns than that; what has is an image.
_MOST_COLUMNS = 100
# Of a piece that is packed on its own, and unpacked whole for any value in it.
_MOST_PIECE = 1 << 25
# What the library says of damaged bytes.
_UNREADABLE = (OSError, RuntimeError, ValueError, KeyError, TypeError, OverflowError, MemoryError)


@dataclass(frozen=True)
class _Place:
    """Location of a channel's numbers: a dataset, and its column or field; None where it is all of it."""

    dataset: str
    column: int | str | None = None


class Hdf5Channels(LabChannels):
    """An HDF5 file, such as of h5py, MATLAB (-v7.3), pandas or an acquisition program."""

    def __init__(self, path: Path) -> None:
        import h5py

        self.path = path
        self._places: dict[str, _Place] = {}
        found: list[Channel] = []
        try:
            with h5py.File(path) as file:
                sets: list[tuple[str, Any]] = []

                def visit(name: str, item: Any) -> None:
                    if isinstance(item, h5py.Dataset):
                        sets.append((name, item))

                file.visititems(visit)  # which follows no link out of the file
                self._require_modest([item for _, item in sets])
                for name, item in sets:
                    found += self._describe(name, item, file)
        except _UNREADABLE as error:
            if isinstance(error, ReadingsError):
                raise
            raise self._torn(error) from error
        # Those with most values first: a table of settings beside the readings is not what is meant.
        self.channels = tuple(sorted(found, key=lambda c: -(c.count or 0)))

    def blocks(self, names: Sequence[str]) -> Iterator[Floats]:
        """Yield the numbers (n, k) of some channels."""
        import h5py

        wanted = [self.readable(name) for name in names]
        if len({c.count for c in wanted}) > 1:
            said = ", ".join(f"{c.name} {c.count}" for c in wanted)
            raise ReadingsError(f"{self.path.name} has channels of different length ({said})", "as many values in each")
        try:
            # Pieces stay unpacked until all their values were read.
            with h5py.File(self.path, rdcc_nbytes=max(self._piece, 1 << 20)) as file:
                for at in range(0, wanted[0].count or 0, BLOCK_ROWS):
                    yield np.stack([self._numbers(file, c, at) for c in wanted], axis=1)
        except _UNREADABLE as error:
            if isinstance(error, ReadingsError):
                raise
            raise self._torn(error) from error

    def _numbers(self, file: Any, channel: Channel, at: int) -> Floats:
        place = self._places[channel.name]
        item = file[place.dataset]
        end = min(at + BLOCK_ROWS, channel.count or 0)
        if place.column is None and item.ndim == 2:
            values = item[at:end, 0] if item.shape[1] == 1 else item[0, at:end]
        elif place.column is None:
            values = item[at:end]
        elif isinstance(place.column, str):
            values = item.fields(place.column)[at:end]
        else:
            values = item[at:end, place.column]
        return np.asarray(values, dtype=np.float64)

    def _require_modest(self, items: Sequence[Any]) -> None:
        """Refuse what tells far more values than the file can hold, and pieces that are unpacked to too much.

        Raises:
            ReadingsError: it does.
        """
        inside = [item for item in items if item.shape is not None and not item.is_virtual and not item.external]
        told = sum(int(item.size) * item.dtype.itemsize for item in inside)
        require_held(self.path, told)
        pieces = [math.prod(item.chunks) * item.dtype.itemsize for item in inside if item.chunks]
        self._piece = max(pieces, default=0)
        if self._piece > _MOST_PIECE:
            raise ReadingsError(
                f"{self.path.name} is packed in pieces of {self._piece} bytes",
                f"at most {_MOST_PIECE} in each",
                "Write it in smaller ones: h5repack -l CHUNK=16384",
            )

    def _describe(self, name: str, item: Any, file: Any) -> list[Channel]:
        """Return the channels of a dataset; none where it holds no values in a row."""
        if item.shape is None or not 1 <= item.ndim <= 2 or 0 in item.shape:
            return []
        group = name.rpartition("/")[0]
        fault = ""
        if item.is_virtual or item.external:
            fault = "holds numbers of other files"
        rows = int(item.shape[0])
        if item.ndim == 2 and 1 in item.shape and item.size > 1:  # as MATLAB has a column
            return [self._add(name, _Place(name), _unit(item, 0), group, fault or _kind(item.dtype), int(item.size))]
        if item.dtype.names and item.ndim == 1:
            return [
                self._add(f"{name}/{field}", _Place(name, field), "", name, fault or _kind(item.dtype[field]), rows)
                for field in item.dtype.names
            ]
        if item.ndim == 1:
            return [self._add(name, _Place(name), _unit(item, 0), group, fault or _kind(item.dtype), rows)]
        if item.shape[1] > _MOST_COLUMNS:
            return []
        labels = _labels(name, item, file)
        return [
            self._add(f"{name}/{label}", _Place(name, k), _unit(item, k), name, fault or _kind(item.dtype), rows)
            for k, label in enumerate(labels)
        ]

    def _add(self, name: str, place: _Place, unit: str, group: str, fault: str, count: int) -> Channel:
        self._places[name] = place
        return Channel(name, unit, group, fault=fault, count=count)

    def _torn(self, error: Exception) -> ReadingsError:
        said = " ".join(str(error).split())[:160]
        return ReadingsError(f"{self.path.name} is torn or damaged ({said})", "a complete HDF5 file", "Copy it again")


def _kind(dtype: Any) -> str:
    return "" if dtype.kind in "fiu" and dtype.shape == () else f"holds {dtype}"


def _texts(value: Any) -> list[str]:
    """Return an attribute or dataset as texts."""
    values = np.atleast_1d(value) if not isinstance(value, str | bytes) else [value]
    return [v.decode("utf-8", "replace") if isinstance(v, bytes) else str(v) for v in values]


def _unit(item: Any, column: int) -> str:
    """Return the unit that a dataset's attribute states, of a table for each column."""
    texts = next((_texts(item.attrs[key]) for key in item.attrs if key.lower() in _UNITS), [])
    if item.ndim == 1 or 1 in item.shape:
        return texts[0].strip() if len(texts) == 1 else ""
    return texts[column].strip() if len(texts) == item.shape[1] else ""


def _labels(name: str, item: Any, file: Any) -> list[str]:
    """Return names of a table's columns: of an attribute, of what pandas writes beside it, or by number."""
    count = int(item.shape[1])
    candidates = [_texts(item.attrs[key]) for key in item.attrs if key.lower() in _NAMES]
    beside = f"{name.removesuffix('_values')}_items"
    if name.endswith("_values") and beside in file and file[beside].shape == (count,):
        candidates.append(_texts(file[beside][:]))
    fits = [c for c in candidates if len(c) == count and len(set(c)) == count]
    return fits[0] if fits else [f"column {k + 1}" for k in range(count)]
