"""Recordings that a lab already has, in resolved units or gauge volts, by a confirmed mapping.

The mapping says which channel is which, and in what unit. One can be proposed from the file's own words, but names are
no proof: a person confirms it before it is used.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import yaml
from numpy.typing import NDArray
from pydantic import Field, StrictBool, model_validator

from daq.documents import Document, read_document, validated
from daq.errors import ReadingsError
from daq.files import replacing
from daq.lab.channels import TIMESTAMP, Channel, LabChannels
from daq.lab.opened import open_channels
from daq.recordings.columns import HEADERS, KINDS, QUANTITIES, Columns
from daq.recordings.readings import ReadingBlock, write_readings
from daq.signals.gauges import GaugeCalibration, read_calibration, saturated
from daq.units import COMMON, Kind, factor_of
from daq.vocabulary import LARGEST, TELLABLE, did_you_mean

Floats = NDArray[np.float64]

FORMAT = "lab-file-map/1"
WANTED = f"a {FORMAT} file"
AXES = QUANTITIES[1:]
GAUGES = tuple(f"gauge{k}" for k in range(1, 7))
# Of an increment: closer than any two clocks.
SAME_INCREMENT = 1e-6
_SCALED = "A ratio becomes a force by the cell's calibration: export forces from the program that recorded it"
# Up to here a float tells every whole number.
_LARGEST_FLAG = 2.0**52
# From so many readings on it is told whether time goes on.
_STANDING = 20


class Taken(Document):
    """A channel by its name, and the unit that its numbers are in."""

    channel: str
    unit: str | None = None


class Increment(Document):
    """Time by counting: seconds from reading to reading, or what the file states."""

    increment_s: Annotated[float, Field(gt=0.0)] | Literal["file"]


class LabFileMap(Document):
    """Mapping of channels to time and axes.

    Attributes:
        confirmed: a person has looked at it; else it is refused.
        time: a channel, or counting.
        channels: Fx to Tz, or gauge1 to gauge6.
        calibration: path of the cell's .cal, by this file; required with gauges.
        zero_V: gauge voltages without load; without them the wrench keeps its offset, as before a tare.
        limit_V: a gauge at or beyond this is saturated; by default as the calibration says.
        status: channel of the cell's own status flags, whole numbers; not with gauges, whose status is saturation.
        doubts: what the proposal was not sure of.
    """

    format: Literal["lab-file-map/1"]
    confirmed: StrictBool = False
    time: Taken | Increment
    channels: dict[str, Taken]
    calibration: str | None = None
    zero_V: Annotated[tuple[float, ...], Field(min_length=6, max_length=6)] | None = None
    limit_V: Annotated[float, Field(gt=0.0)] | None = None
    status: str | None = None
    doubts: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _whole(self) -> LabFileMap:
        if set(self.channels) not in ({*AXES}, {*GAUGES}):
            raise ValueError(f"channels are {' '.join(self.channels)}, not {' '.join(AXES)} or {' '.join(GAUGES)}")
        names = [c.channel for c in self.channels.values()]
        if len(set(names)) < len(names):
            raise ValueError("one channel is taken twice")
        if self.status is not None and self.in_volts:
            raise ValueError("status beside gauges, whose status is saturation")
        return self

    @property
    def in_volts(self) -> bool:
        """True if the channels are gauges."""
        return GAUGES[0] in self.channels


@dataclass(frozen=True, eq=False)
class LabRecording:
    """A file with its mapping; `blocks` reads the numbers.

    Attributes:
        source: the file.
        mapping: which channel is which.
        factors: (6,) that bring the channels to N and N mm, or to V.
        time_factor: that brings the time's channel to s.
        increment: (start [s], step [s]) where time is counted.
        calibration: of the gauges.
        conversions: what is done to the numbers, for the reader.
        told: what else the reader should know of the mapping.
    """

    source: LabChannels
    mapping: LabFileMap
    factors: Floats
    time_factor: float
    increment: tuple[float, float] | None
    calibration: GaugeCalibration | None
    conversions: tuple[str, ...]
    told: tuple[str, ...] = field(default=())

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes for the reader; a missing end is known of some files only after they were read."""
        cut = f"{self.source.path.name} is cut off: the readings that all its channels have were read"
        return ((cut,) if self.source.cut_off else ()) + self.told + tuple(self.source.notes)

    @property
    def limit(self) -> float | None:
        """The voltage [V] from which on a gauge is saturated; None where it is not known, or there are no gauges."""
        return None if self.calibration is None else self.mapping.limit_V or self.calibration.limit_V

    @property
    def has_status(self) -> bool:
        """Whether its readings have a status."""
        return self.limit is not None or self.mapping.status is not None

    def blocks(self) -> Iterator[ReadingBlock]:
        """Yield the readings in order; the status of gauges has bit 0 where the first is saturated, and so on.

        Raises:
            ReadingsError: a number is none or not finite, time goes back, or there is no reading.
        """
        time, order = self.mapping.time, GAUGES if self.mapping.in_volts else AXES
        names = [self.mapping.channels[k].channel for k in order]
        if isinstance(time, Taken):
            names.append(time.channel)
        if self.mapping.status is not None:
            names.append(self.mapping.status)
        row, last_s = 0, -np.inf
        for block in self.source.blocks(names):
            if not np.isfinite(block).all():
                at, column = np.argwhere(~np.isfinite(block))[0]
                raise self._fault(row + int(at), f"{names[column]} is {block[at, column]}", "a finite number")
            if self.increment is None:
                t_s: Floats = block[:, 6] * self.time_factor
            else:
                t_s = self.increment[0] + self.increment[1] * np.arange(row, row + len(block), dtype=np.float64)
            if row == 0 and self.increment is None and len(t_s) > _STANDING and np.mean(np.diff(t_s) == 0.0) > 0.5:
                raise ReadingsError(
                    f"{self.source.path.name}: time stands still from most readings to the next",
                    "a time for each reading",
                    "Is it written in whole seconds? Take time by counting: increment_s in the mapping",
                )
            steps = np.diff(t_s, prepend=last_s)
            back = np.flatnonzero(steps <= 0.0)
            if len(back):
                goes_back, at_s = steps[back[0]] < 0.0, t_s[back[0]]
                raise self._fault(
                    row + int(back[0]),
                    f"time goes back from {at_s - steps[back[0]]:.9g} s to {at_s:.9g} s"
                    if goes_back
                    else f"time stands still at {at_s:.9g} s",
                    "time that goes on",
                    "Was a second recording appended? Split the file there, or take time from the increment"
                    if goes_back
                    else "Remove rows that were written twice, or take time from the increment",
                )
            values = block[:, :6] * self.factors
            if (np.abs(values) > LARGEST).any():
                at, column = np.argwhere(np.abs(values) > LARGEST)[0]
                raise self._fault(row + int(at), f"{names[column]} is {block[at, column]:g}", TELLABLE)
            yield ReadingBlock(t_s, *self._reading(values, block[:, -1], row))
            row, last_s = row + len(block), float(t_s[-1])
        if row == 0:
            raise ReadingsError(f"{self.source.path.name} has no readings", "at least one in each channel")

    def _reading(self, values: Floats, last: Floats, row: int) -> tuple[Floats, NDArray[np.int64] | None]:
        """Return wrench and status of channels in N and N mm, or in V; the last column is the status, if any."""
        if self.calibration is not None:
            zero = None if self.mapping.zero_V is None else np.array(self.mapping.zero_V)
            saturation = None if self.limit is None else saturated(values, self.limit)
            return self.calibration.wrench(values, zero), saturation
        if self.mapping.status is None:
            return values, None
        odd = np.flatnonzero((last != np.rint(last)) | (np.abs(last) > _LARGEST_FLAG))
        if len(odd):
            raise self._fault(
                row + int(odd[0]), f"{self.mapping.status} is {last[odd[0]]:g}", "a whole number of 52 bits"
            )
        return values, last.astype(np.int64)

    def _fault(
        self, row: int, found: str, expected: str, remedy: str = "Take it out, or export again"
    ) -> ReadingsError:
        return ReadingsError(f"{self.source.path.name}: reading {row + 1}: {found}", expected, remedy)


def read_mapping(path: str | Path) -> LabFileMap:
    """Read a mapping; its calibration's path comes back with the mapping's folder in front.

    Raises:
        ReadingsError: it is absent, or no mapping.
    """
    file = Path(path)
    try:
        raw = read_document(file, WANTED, ReadingsError)
    except OSError as error:
        raise ReadingsError(f"{file.name} cannot be read ({error.strerror})", WANTED) from error
    mapping = validated(LabFileMap, raw, file.name, WANTED, ReadingsError)
    if mapping.calibration is None:
        return mapping
    return mapping.model_copy(update={"calibration": str(file.parent / mapping.calibration)})


def write_mapping(path: str | Path, mapping: LabFileMap) -> Path:
    """Write a mapping as YAML, for a person to look at and confirm."""
    file = Path(path)
    head = "# Look at every line, settle the doubts, then set confirmed to true.\n" if not mapping.confirmed else ""
    plain = mapping.model_dump(mode="json", exclude_none=True)
    with replacing(file) as temporary:
        temporary.write_text(head + yaml.safe_dump(plain, sort_keys=False, allow_unicode=True, width=120), "utf-8")
    return file


def stated_mapping(columns: Columns) -> LabFileMap:
    """Return the mapping that a readings file's own header states; nothing of it is in doubt."""
    time, *axes = (Taken(channel=c.header.strip(), unit=c.unit) for c in columns.used)
    status = None if columns.status is None else columns.status.header.strip()
    channels = dict(zip(AXES, axes, strict=True))
    return LabFileMap(format="lab-file-map/1", confirmed=True, time=time, channels=channels, status=status)


def open_recording(path: str | Path, mapping: LabFileMap) -> LabRecording:
    """Hold a file against its mapping.

    Raises:
        ReadingsError: the mapping was not confirmed, or does not fit the file.
        DriverError: the calibration cannot be used.
    """
    source = open_channels(path)
    name = source.path.name
    if not mapping.confirmed:
        raise ReadingsError(
            f"the mapping for {name} was not confirmed",
            "confirmed: true",
            "Look at its channels, units and doubts, then set it",
        )
    used = {key: source.readable(taken.channel) for key, taken in mapping.channels.items()}
    if mapping.status is not None:
        source.readable(mapping.status)
    notes: list[str] = []
    conversions = []
    factors = np.ones(6)
    for place, (axis, gauge) in enumerate(zip(AXES, GAUGES, strict=True)):
        key = gauge if mapping.in_volts else axis
        kind: Kind = "voltage" if mapping.in_volts else KINDS[axis[0]]
        factors[place] = _factor(mapping.channels[key], used[key], kind, name)
        if factors[place] != 1.0:
            target = f"{gauge}_V" if mapping.in_volts else HEADERS[1 + place]
            taken = mapping.channels[key]
            conversions.append(f"{taken.channel} [{taken.unit}] × {factors[place]:.10g} = {target}")
    time_factor, increment = _time(source, mapping, used)
    if increment is not None and mapping.time == Increment(increment_s="file"):
        unsure = 0.5 * source.rounded_to_s / increment[1]
        if unsure > SAME_INCREMENT:
            notes.append(f"the increment {increment[1]:g} s is rounded: time may be off by {100.0 * unsure:.2g} %")
    calibration = None
    if mapping.in_volts:
        if mapping.calibration is None:
            raise ReadingsError(f"the mapping for {name} has gauges and no calibration", "the path of the cell's .cal")
        calibration = read_calibration(mapping.calibration)
        conversions.append(f"gauge volts by {calibration.name} ({calibration.model}, {calibration.serial}) to N, N mm")
        notes += calibration.notes
        if mapping.zero_V is None:
            notes.append("no voltages at zero load are given: a tare has to take the offset off")
        if mapping.limit_V is None and calibration.limit_V is None:
            notes.append("the range of the gauges is not known: saturation was not looked for")
    elif mapping.status is None:
        notes.append("no gauge volts are at hand: saturation was not looked for")
    return LabRecording(source, mapping, factors, time_factor, increment, calibration, tuple(conversions), tuple(notes))


def convert_recording(path: str | Path, mapping: str | Path, target: str | Path) -> LabRecording:
    """Write a recording as readings (CSV, gzipped CSV, Parquet); return what was done.

    Raises:
        ReadingsError: the file or the mapping cannot be used.
        DriverError: the calibration cannot be used.
    """
    recording = open_recording(path, read_mapping(mapping))
    write_readings(target, recording.blocks())
    return recording


def _factor(taken: Taken, channel: Channel, kind: Kind, file: str) -> float:
    if taken.unit is None:
        raise ReadingsError(
            f"the mapping for {file} gives {taken.channel} no unit",
            f"one of {' '.join(COMMON[kind])}",
            "A unit is never assumed: look into the program that wrote it",
        )
    factor = factor_of(taken.unit, kind)
    if factor is None:
        raise ReadingsError(
            f"the mapping for {file} has {taken.channel} in {taken.unit!r}, which is no unit of {kind}",
            f"one of {' '.join(COMMON[kind])}",
            _SCALED if "/" in taken.unit else did_you_mean(taken.unit, COMMON[kind]),
        )
    stated = factor_of(channel.unit, kind)
    if stated is not None and stated != factor:
        raise ReadingsError(
            f"{file} states {taken.channel} in {channel.unit!r}, its mapping in {taken.unit!r}",
            "the same",
            "Correct the one that is wrong",
        )
    return factor


def _time(
    source: LabChannels, mapping: LabFileMap, used: Mapping[str, Channel]
) -> tuple[float, tuple[float, float] | None]:
    """Return the time channel's factor, or (start, step) [s]."""
    name = source.path.name
    if isinstance(mapping.time, Taken):
        channel = source.readable(mapping.time.channel)
        _check_clocks([*used.values(), channel], name)
        if TIMESTAMP in (channel.unit, mapping.time.unit):
            if channel.unit != mapping.time.unit:
                raise ReadingsError(f"{name}: {channel.name} is in {channel.unit!r}", f"{mapping.time.unit!r}")
            return 1.0, None
        return _factor(mapping.time, channel, "time", name), None
    if source.pauses_possible:
        raise ReadingsError(
            f"{name} was written in segments, and pauses between them show in no increment",
            "time from a channel",
            "Map time to X_Value, or split the file",
        )
    _check_clocks(list(used.values()), name)
    first = next(iter(used.values()))
    start_s, step_s = first.start_s, first.increment_s
    wanted = mapping.time.increment_s
    if wanted == "file":
        if step_s is None:
            raise ReadingsError(f"{name} states no increment", "increment_s in the mapping, or time from a channel")
        return 1.0, (start_s, step_s)
    if step_s is not None and abs(step_s - wanted) > SAME_INCREMENT * wanted + 0.5 * source.rounded_to_s:
        raise ReadingsError(f"{name} states an increment of {step_s:g} s", f"{wanted:g} s, as its mapping says")
    return 1.0, (start_s, wanted)


def _check_clocks(channels: list[Channel], file: str) -> None:
    """Refuse channels that were not sampled together: rows of them are no readings."""
    first = channels[0]
    for other in channels[1:]:
        if (other.start_s, other.increment_s) != (first.start_s, first.increment_s) and other.increment_s is not None:
            raise ReadingsError(
                f"{file}: the channels differ in start or increment ({first.name} from {first.start_s:g} s every "
                f"{first.increment_s or 0.0:g} s, {other.name} from {other.start_s:g} s every {other.increment_s:g} s)",
                "the same in all",
                "Resample them to one clock in the program that recorded them",
            )
