"""Propose which channel of a lab's file is which, from names and units, and say what that leaves in doubt."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

from daq.errors import ReadingsError
from daq.lab.channels import TIMESTAMP, Channel, LabChannels
from daq.lab.files import AXES, GAUGES, Increment, LabFileMap, Taken
from daq.lab.names import (
    COUNTED,
    GAUGE_STEMS,
    TIME,
    axis_of,
    counts_time,
    is_gauge,
    is_xyz,
    kind_of,
    kinds_of_units,
    kinds_said,
    leaf,
    letter_of,
    stated_unit,
    unit_of,
    word_of,
)
from daq.lab.opened import open_channels
from daq.recordings.columns import KINDS, QUANTITIES
from daq.units import COMMON, factor_of

# How a doubt begins that is a note of the file.
OF_THE_FILE = "whether it is right that "
# Seconds since 1970 between 2000 and 2100, by the unit that would make them so.
_EPOCH = {"s": (9.4e8, 4.2e9), "ms": (9.4e11, 4.2e12), "us": (9.4e14, 4.2e15), "ns": (9.4e17, 4.2e18)}


def propose_mapping(path: str | Path, calibration: str | None = None, rate_hz: float | None = None) -> LabFileMap:
    """Propose a mapping, not confirmed, with its doubts.

    Args:
        path: of a recording.
        calibration: path of the cell's .cal from the mapping's folder, where its channels are gauges.
        rate_hz: by which readings are counted where the file tells no time [Hz].

    Raises:
        ReadingsError: the file cannot be read, or its names tell nothing.
    """
    source = open_channels(path)
    doubts: list[str] = []
    channels = propose_channels(source, doubts)
    if channels is None:
        said = ", ".join(f"{c.name} [{c.fault or c.unit or '?'}]" for c in source.channels[:24])
        named = {axis_of(c) for c in _sound(source)} - {""}
        lacks = [axis for axis in AXES if named and axis not in named]
        none_is = f": none that can be read is {' or '.join(lacks)}" if lacks else ""
        raise ReadingsError(
            f"the channels of {source.path.name} ({said}) do not tell which is which{none_is}",
            f"names such as {' '.join(AXES)}, six in volts, or three units of force and three of torque",
            f"Write {source.path.name}.map.yaml by hand (docs/how-to/read-a-lab-file.md)",
        )
    for taken in channels.values():
        source.readable(taken.channel)
    chosen = [taken.channel for taken in channels.values()]
    time = propose_time(source, source.channel(chosen[0]), chosen, doubts, rate_hz)
    return mapping_of(source, channels, time, calibration, doubts)


def propose_channels(source: LabChannels, doubts: list[str]) -> dict[str, Taken] | None:
    """Propose which channel is which, and add what that leaves in doubt; None where nothing tells it."""
    return (
        _resolved(source, doubts)
        or _gauges(source, doubts)
        or _by_letters(source, doubts)
        or _by_position(source, doubts)
    )


def mapping_of(
    source: LabChannels,
    channels: dict[str, Taken],
    time: Taken | Increment,
    calibration: str | None,
    doubts: Sequence[str],
) -> LabFileMap:
    """Return the mapping of some channels, not confirmed, with doubts of their units and of the file itself too."""
    said = list(doubts)
    if GAUGES[0] in channels:
        if calibration is None:
            said.append("which calibration file belongs to the gauges: give its path as calibration")
        said.append("what the gauges read without load: give zero_V, or have a tare in the recording")
    for key, taken in channels.items():
        kind = kind_of(key)
        if taken.unit is None:
            said.append(f"the unit of {key} ({taken.channel}): the file states none")
        elif factor_of(taken.unit, kind) is None:
            known = f"write one of {' '.join(COMMON[kind])}"
            said.append(f"the unit of {key} ({taken.channel}): {taken.unit!r} is no unit of {kind}; {known}")
    said += [f"{OF_THE_FILE}{note}" for note in source.notes]
    return LabFileMap(
        format="lab-file-map/1",
        confirmed=False,
        time=time,
        channels=channels,
        calibration=calibration if GAUGES[0] in channels else None,
        doubts=tuple(said),
    )


@dataclass(frozen=True)
class Ground:
    """Certainty (0 to 1) that a channel is the proposed one, the reason, and whether it rests on its place alone."""

    sure: float
    why: str
    by_place: bool = False


def grounds(path: str | Path, mapping: LabFileMap) -> dict[str, Ground]:
    """Say on what each line of a proposal rests: time as `t`, then the channels.

    Raises:
        ReadingsError: the file cannot be read, or has no such channel.
    """
    source = open_channels(path)
    out = {"t": _ground_of_time(source, mapping.time)}
    return out | {key: ground_of(source, key, taken) for key, taken in mapping.channels.items()}


def ground_of(source: LabChannels, key: str, taken: Taken) -> Ground:
    """Say on what it rests that a channel is an axis or a gauge.

    Raises:
        ReadingsError: there is no such channel.
    """
    ground = _ground(source, key, source.channel(taken.channel))
    return ground if taken.unit else Ground(0.0, f"{ground.why}; the file states no unit", ground.by_place)


def _ground_of_time(source: LabChannels, time: Taken | Increment) -> Ground:
    if isinstance(time, Increment):
        return Ground(0.8, "counted in the steps that the file states")
    channel = source.channel(time.channel)
    if not time.unit:
        return Ground(0.0, "the file states no unit")
    if channel.unit == TIMESTAMP:
        return Ground(0.95, "it holds dates or times of day")
    if not TIME.match(leaf(channel)):
        return Ground(0.5, "its unit is one of time" if counts_time(channel) else "it is the first column and no axis")
    return (
        Ground(0.95, "its name says so") if stated_unit(channel) else Ground(0.5, "its unit is a guess by its numbers")
    )


def _ground(source: LabChannels, key: str, channel: Channel) -> Ground:
    if key in GAUGES:
        counted = COUNTED.match(leaf(channel))
        return Ground(0.7, "by the number in its name") if counted else Ground(0.4, "by its place among six in volts")
    own = axis_of(channel)
    if own != key:
        fits = factor_of(unit_of(channel, kind_of(key)) or "", kind_of(key)) is not None
        lettered = letter_of(channel) == key[1]
        if lettered and fits:
            return Ground(0.8, f"its name says {key[1]}, its unit which kind")
        if lettered:
            return Ground(0.3, f"its name says {key[1]}; which three are forces, their order only", by_place=True)
        return Ground(0.5, "by its place; its unit fits") if fits else Ground(0.3, "by its place only", by_place=True)
    alike = sum(axis_of(c) == key for c in _sound(source))
    return Ground(0.95, "its name says so") if alike == 1 else Ground(0.5, f"{alike} channels are called so")


def _resolved(source: LabChannels, doubts: list[str]) -> dict[str, Taken] | None:
    """Return the first group with all six axes."""
    sets: dict[str, dict[str, list[Channel]]] = {}
    for channel in _sound(source):
        if axis := axis_of(channel):
            sets.setdefault(channel.group, {}).setdefault(axis, []).append(channel)
    whole = [group for group, found in sets.items() if set(found) == set(AXES)]
    if not whole:
        return None
    if len(whole) > 1:
        doubts.append(f"which load cell is meant: {' and '.join(whole)} each have six axes, {whole[0]} was taken")
    out = {}
    for axis in AXES:
        candidates = sets[whole[0]][axis]
        if len(candidates) > 1:
            doubts.append(f"{axis} is {' or '.join(c.name for c in candidates)}: the first was taken")
        out[axis] = Taken(channel=candidates[0].name, unit=unit_of(candidates[0], KINDS[axis[0]]))
    doubts.append("whether these are the cell's own axes, or were turned or shifted by a tool transformation")
    doubts.append("whether a tare was taken off already")
    return out


def _unnamed(source: LabChannels) -> list[Channel]:
    """Return channels that could be axes, where no name says which."""
    return [c for c in _sound(source) if not TIME.match(leaf(c)) and c.unit != TIMESTAMP]


def _by_letters(source: LabChannels, doubts: list[str]) -> dict[str, Taken] | None:
    """Find channels that say x, y and z behind words of another language; units, words or order tell the kinds."""
    found = [c for c in _unnamed(source) if letter_of(c)]
    by_unit = [[c for c in found if kinds_of_units([c]) == kind] for kind in "FT"]
    words = list(dict.fromkeys(word_of(c) for c in found))
    by_word = [[c for c in found if word_of(c) == word] for word in words]
    if all(is_xyz(three) for three in by_unit):
        taken, told = by_unit, "their units"
    elif len(by_word) == 2 and all(is_xyz(three) for three in by_word):
        kinds = [kinds_said(three) for three in by_word]
        if "T" in kinds[0] or "F" in kinds[1]:
            kinds.reverse()
            by_word.reverse()
        if kinds[0] not in ("", "F") or kinds[1] not in ("", "T"):
            return None
        taken, told = by_word, "what one of them is" if any(kinds) else "their order"
    elif len(words) == 1 and len(found) == 6 and all(is_xyz(three) for three in (found[:3], found[3:])):
        if kinds_said(found[:3]) not in ("", "F") or kinds_said(found[3:]) not in ("", "T"):
            return None
        taken, told = [found[:3], found[3:]], "their order"
    else:
        return None
    out: dict[str, Channel] = {}
    for kind, three in zip("FT", taken, strict=True):
        out |= {f"{kind}{letter_of(c)}": c for c in three}
    names = ", ".join(out[axis].name for axis in AXES)
    doubts.append(f"which channel is which: {names} were taken as {' '.join(AXES)}, by x y z and {told}")
    return {axis: Taken(channel=out[axis].name, unit=unit_of(out[axis], KINDS[axis[0]])) for axis in AXES}


def _by_position(source: LabChannels, doubts: list[str]) -> dict[str, Taken] | None:
    """Find six channels whose names tell nothing: by three units of each kind, or as the only ones there are."""
    rest = _unnamed(source)
    if any(axis_of(c) or is_gauge(c) for c in rest):
        return None
    at = kinds_of_units(rest).find("FFFTTT")
    if at < 0 and len(rest) == 7 and rest[0].increment_s is None and not any(c not in rest for c in _sound(source)):
        rest = rest[1:]  # time comes first
    # A unit of torque is none of a force.
    if at < 0 and len(rest) == 6 and "T" not in kinds_of_units(rest[:3]) and "F" not in kinds_of_units(rest[3:]):
        at = 0
    if at < 0:
        return None
    taken = rest[at : at + 6]
    if any(letter_of(c) not in ("", letter) for c, letter in zip(taken, "xyzxyz", strict=True)):
        return None  # their names tell another order
    doubts.append(
        f"which channel is which: their names tell nothing, so {', '.join(c.name for c in taken)} were taken as "
        f"{' '.join(AXES)} in the file's order"
    )
    return {a: Taken(channel=c.name, unit=unit_of(c, KINDS[a[0]])) for a, c in zip(AXES, taken, strict=True)}


def _sound(source: LabChannels) -> list[Channel]:
    """Return channels whose numbers can be read; of an unknown scale too, so that it is refused by its name."""
    return [c for c in source.channels if not c.fault.startswith("holds")]


def _gauges(source: LabChannels, doubts: list[str]) -> dict[str, Taken] | None:
    """Return six channels of one stem that are counted; else the only six in volts."""
    sets: dict[tuple[str, str], dict[int, Channel]] = {}
    for channel in _sound(source):
        match = COUNTED.match(leaf(channel))
        if match and re.sub(r"[\s_-]", "", match["stem"]).lower() in GAUGE_STEMS:
            sets.setdefault((channel.group, match["stem"]), {})[int(match["number"])] = channel
    six = [found for found in sets.values() if len(found) == 6 and max(found) - min(found) == 5]
    if len(six) == 1:
        taken: Sequence[Channel] = [six[0][k] for k in sorted(six[0])]
        doubts.append(f"the order of the gauges: it is that of the numbers, {taken[0].name} for gauge 1")
    else:
        taken = [c for c in _sound(source) if factor_of(c.unit, "voltage") is not None]
        if len(taken) != 6:
            return None
        doubts.append(f"which channel is which gauge: six are in volts, taken in the file's order from {taken[0].name}")
    return {g: Taken(channel=c.name, unit=unit_of(c, "voltage")) for g, c in zip(GAUGES, taken, strict=True)}


def propose_time(
    source: LabChannels, used: Channel, chosen: Collection[str], doubts: list[str], rate_hz: float | None = None
) -> Taken | Increment:
    """Propose where time comes from, and add what that leaves in doubt.

    Args:
        source: the recording.
        used: one of the channels that are read.
        chosen: names of the channels that are read.
        doubts: to add to.
        rate_hz: by which readings are counted where nothing else tells the time [Hz].

    Raises:
        ReadingsError: no channel of time and no increment.
    """
    named = [c for c in _sound(source) if c.name not in chosen and (TIME.match(leaf(c)) or c.unit == TIMESTAMP)]
    named.sort(key=lambda c: c.group != used.group)
    spare = [c for c in _sound(source) if c.name not in chosen]
    timed = [c for c in spare if counts_time(c)]
    if not named and used.increment_s is None and len(timed) == 1:
        named = timed
        doubts.append(f"whether {timed[0].name} is the time: its unit is one, its name tells nothing")
    elif not named and used.increment_s is None and rate_hz is None and spare == [source.channels[0]]:
        named = spare
        doubts.append(f"whether {spare[0].name} is the time: it is the first column and no axis")
    if named:
        channel = named[0]
        if len(named) > 1:
            doubts.append(f"which time is meant: {' or '.join(c.name for c in named)}; the first was taken")
        unit = TIMESTAMP if channel.unit == TIMESTAMP else unit_of(channel, "time")
        epoch = _epoch(source, channel)
        if unit is None and channel.name.startswith("X_Value"):
            unit = "s"
            doubts.append(f"{channel.name} is taken as seconds, as LabVIEW writes it")
        elif unit is None and epoch:
            unit = epoch
            doubts.append(
                f"whether {channel.name} counts {epoch} since 1970: its numbers would then be of this century"
            )
        elif unit is None:
            doubts.append(f"the unit of time ({channel.name}): the file states none")
        elif unit != TIMESTAMP and factor_of(unit, "time") is None:
            doubts.append(
                f"the unit of time ({channel.name}): {unit!r} is none; write one of {' '.join(COMMON['time'])}"
            )
        return Taken(channel=channel.name, unit=unit)
    if used.increment_s is not None:
        doubts.append(f"the increment of {used.increment_s:g} s tells the time only if the recording never paused")
        return Increment(increment_s="file")
    if rate_hz is not None:
        doubts.append(f"the time: the file tells none, so readings are counted at the {rate_hz:g} Hz that were stated")
        return Increment(increment_s=1.0 / rate_hz)
    raise ReadingsError(
        f"{source.path.name} has no channel of time and states no increment",
        f"one named {QUANTITIES[0]} or time, or an increment",
        "Write the mapping by hand, with increment_s, or state load_cell: rate_hz in the rig's setup",
    )


def _epoch(source: LabChannels, channel: Channel) -> str:
    """Return the unit in which a channel's first number is a time of this century; nothing where there is none."""
    if channel.unit == TIMESTAMP:
        return ""
    block = next(iter(source.blocks([channel.name])), None)
    first = 0.0 if block is None else float(block[0, 0])
    return next((unit for unit, (low, high) in _EPOCH.items() if low < first < high), "")
