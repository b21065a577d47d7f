"""Propose which channel of a lab's file is which, from names and units, and say what that leaves in doubt."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from daq.columns import FORCE_N, QUANTITIES, TIME_S, TORQUE_NMM
from daq.errors import ReadingsError
from daq.lab.channels import TIMESTAMP, Channel, LabChannels, open_channels
from daq.lab.files import AXES, GAUGES, VOLTS, Increment, LabFileMap, Taken, plain_unit

_AXIS = re.compile(r"^(?P<kind>f|force|t|torque|m|moment)[\s_-]*(?P<axis>[xyz])(?![a-z])", re.IGNORECASE)
_TIME = re.compile(r"^(t|time|x_value|timestamps?|zeit|temps)(?![a-z])", re.IGNORECASE)
_COUNTED = re.compile(r"^(?P<stem>.*?)[\s_-]*(?P<number>\d+)\s*(?:[\[(].*)?$")
_GAUGE_STEMS = {"gauge", "gage", "sg", "g", "straingauge", "straingage", "ai", "voltage", "volt", "v", "ch", "channel"}
_IN_NAME = re.compile(r"[\[(]\s*([^\])]+?)\s*[\])]\s*$|[_\s]([^\W\d_]+(?:[-*·.]?[^\W\d_]+)*)\s*$")


def propose_mapping(path: str | Path, calibration: str | None = None) -> LabFileMap:
    """Propose a mapping, not confirmed, with its doubts.

    Args:
        path: a TDMS or LVM file.
        calibration: path of the cell's .cal from the mapping's folder, where its channels are gauges.

    Raises:
        ReadingsError: the file cannot be read, or its names tell nothing.
    """
    source = open_channels(path)
    doubts: list[str] = []
    channels = _resolved(source, doubts) or _gauges(source, doubts)
    if channels is None:
        said = ", ".join(f"{c.name} [{c.unit or '?'}]" for c in source.channels[:24])
        raise ReadingsError(
            f"the channels of {source.path.name} ({said}) do not tell which is which",
            f"names such as {' '.join(AXES)}, or six in volts",
            "Write the mapping by hand",
        )
    if GAUGES[0] in channels:
        if calibration is None:
            doubts.append("which calibration file belongs to the gauges: give its path as calibration")
        doubts.append("what the gauges read without load: give zero_V, or have a tare in the recording")
    time = _time(source, channels, doubts)
    for key, taken in channels.items():
        if taken.unit is None:
            doubts.append(f"the unit of {key} ({taken.channel}): the file states none")
    return LabFileMap(
        format="lab-file-map/1",
        confirmed=False,
        time=time,
        channels=channels,
        calibration=calibration if GAUGES[0] in channels else None,
        doubts=tuple(doubts),
    )


def _resolved(source: LabChannels, doubts: list[str]) -> dict[str, Taken] | None:
    """The first group with all six axes."""
    sets: dict[str, dict[str, list[Channel]]] = {}
    for channel in source.channels:
        match = _AXIS.match(_leaf(channel))
        if match:
            letter = "F" if match["kind"][0].lower() == "f" else "T"
            sets.setdefault(channel.group, {}).setdefault(letter + match["axis"].lower(), []).append(channel)
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
        out[axis] = Taken(
            channel=candidates[0].name, unit=_unit(candidates[0], FORCE_N if axis[0] == "F" else TORQUE_NMM)
        )
    doubts.append("whether these are the cell's own axes, or were turned or shifted by a tool transformation")
    doubts.append("whether a tare was taken off already")
    return out


def _gauges(source: LabChannels, doubts: list[str]) -> dict[str, Taken] | None:
    """Six channels of one stem that are counted; else the only six in volts."""
    sets: dict[tuple[str, str], dict[int, Channel]] = {}
    for channel in source.channels:
        match = _COUNTED.match(_leaf(channel))
        if match and re.sub(r"[\s_-]", "", match["stem"]).lower() in _GAUGE_STEMS:
            sets.setdefault((channel.group, match["stem"]), {})[int(match["number"])] = channel
    six = [found for found in sets.values() if len(found) == 6 and max(found) - min(found) == 5]
    if len(six) == 1:
        taken: Sequence[Channel] = [six[0][k] for k in sorted(six[0])]
        doubts.append(f"the order of the gauges: it is that of the numbers, {taken[0].name} for gauge 1")
    else:
        taken = [c for c in source.channels if plain_unit(c.unit) in VOLTS]
        if len(taken) != 6:
            return None
        doubts.append(f"which channel is which gauge: six are in volts, taken in the file's order from {taken[0].name}")
    return {g: Taken(channel=c.name, unit=_unit(c, VOLTS)) for g, c in zip(GAUGES, taken, strict=True)}


def _time(source: LabChannels, channels: Mapping[str, Taken], doubts: list[str]) -> Taken | Increment:
    used = source.channel(next(iter(channels.values())).channel)
    named = [c for c in source.channels if _TIME.match(_leaf(c)) and not _AXIS.match(_leaf(c))]
    named.sort(key=lambda c: c.group != used.group)
    if named:
        channel = named[0]
        if len(named) > 1:
            doubts.append(f"which time is meant: {' or '.join(c.name for c in named)}; the first was taken")
        unit = TIMESTAMP if channel.unit == TIMESTAMP else _unit(channel, TIME_S)
        if unit is None and channel.name.startswith("X_Value"):
            unit = "s"
            doubts.append(f"{channel.name} is taken as seconds, as LabVIEW writes it")
        elif unit is None:
            doubts.append(f"the unit of time ({channel.name}): the file states none")
        return Taken(channel=channel.name, unit=unit)
    if used.increment_s is not None:
        doubts.append(f"the increment of {used.increment_s:g} s tells the time only if the recording never paused")
        return Increment(increment_s="file")
    raise ReadingsError(
        f"{source.path.name} has no channel of time and states no increment",
        f"one named {QUANTITIES[0]} or time, or an increment",
        "Write the mapping by hand, with increment_s",
    )


def _leaf(channel: Channel) -> str:
    return channel.name.removeprefix(channel.group + "/").strip()


def _unit(channel: Channel, known: Mapping[str, float]) -> str | None:
    """The unit that the file states, or else the one in the channel's name."""
    if channel.unit:
        return channel.unit
    match = _IN_NAME.search(_leaf(channel))
    found = match and (match[1] or match[2])
    return found if found and plain_unit(found) in known else None
