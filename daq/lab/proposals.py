"""Propose which channel of a lab's file is which, from names and units, and say what that leaves in doubt."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

from daq.errors import ReadingsError
from daq.lab.channels import TIMESTAMP, Channel, LabChannels
from daq.lab.files import AXES, GAUGES, Increment, LabFileMap, Taken
from daq.lab.opened import open_channels
from daq.recordings.columns import KINDS, QUANTITIES
from daq.units import COMMON, Kind, factor_of

# How a doubt begins that is a note of the file.
OF_THE_FILE = "whether it is right that "
_FORCE = "f|forces?|kraft|kraefte|kräfte|kracht|fuerza|forza|for[cç]a|siła|сила"
_TORQUE = "t|m|torques?|moments?|momento|drehmoment|koppel|couple|coppia|vridmoment|момент"
_AXIS = re.compile(rf"^(?:.*[\s./:-])?(?P<kind>{_FORCE}|{_TORQUE})[\s._(-]*(?P<axis>[xyz])(?![a-z])", re.IGNORECASE)
_TIME = re.compile(
    r"^(t|time|timestamps?|x_value|zeit(stempel)?|temps|tiempo|tempo|tijd|czas|время|elapsed|date|datum|clock|epoch)(?![a-z])",
    re.IGNORECASE,
)
# Seconds since 1970 between 2000 and 2100, by the unit that would make them so.
_EPOCH = {"s": (9.4e8, 4.2e9), "ms": (9.4e11, 4.2e12), "us": (9.4e14, 4.2e15), "ns": (9.4e17, 4.2e18)}
_COUNTED = re.compile(r"^(?P<stem>.*?)[\s_-]*(?P<number>\d+)\s*(?:[\[(].*)?$")
_GAUGE_STEMS = {"gauge", "gage", "sg", "g", "straingauge", "straingage", "ai", "voltage", "volt", "v", "ch", "channel"}
# A letter for an axis behind a word of any language.
_LETTER = re.compile(r"^.*?(?:(?<![A-Za-z])[xyzXYZ]|(?<=[a-z])[XYZ])(?![A-Za-z])")
_BEHIND_SLASH = re.compile(r"/\s*\(?([^/()]+)\)?\s*$")
_IN_NAME = re.compile(r"[\[(]\s*([^\])]+?)\s*[\])]\s*$|[_\s]([^\W\d_]+(?:[-*·.]?[^\W\d_]+)*)\s*$")


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
        raise ReadingsError(
            f"the channels of {source.path.name} ({said}) do not tell which is which",
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


def kind_of(key: str) -> Kind:
    """Return the kind of unit of an axis or a gauge, or of time as `t`."""
    return "time" if key == "t" else "voltage" if key in GAUGES else KINDS[key[0]]


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
    if not _TIME.match(_leaf(channel)):
        return Ground(0.5, "it is the first column and no axis")
    return (
        Ground(0.95, "its name says so") if stated_unit(channel) else Ground(0.5, "its unit is a guess by its numbers")
    )


def _ground(source: LabChannels, key: str, channel: Channel) -> Ground:
    if key in GAUGES:
        counted = _COUNTED.match(_leaf(channel))
        return Ground(0.7, "by the number in its name") if counted else Ground(0.4, "by its place among six in volts")
    own = _axis_of(channel)
    if own != key:
        fits = factor_of(_unit(channel, kind_of(key)) or "", kind_of(key)) is not None
        lettered = _letter_of(channel) == key[1]
        if lettered and fits:
            return Ground(0.8, f"its name says {key[1]}, its unit which kind")
        if lettered:
            return Ground(0.3, f"its name says {key[1]}; which three are forces, their order only", by_place=True)
        return Ground(0.5, "by its place; its unit fits") if fits else Ground(0.3, "by its place only", by_place=True)
    alike = sum(_axis_of(c) == key for c in _sound(source))
    return Ground(0.95, "its name says so") if alike == 1 else Ground(0.5, f"{alike} channels are called so")


def _axis_of(channel: Channel) -> str:
    """Return which of the six axes a channel's name means; nothing where it means none."""
    match = _AXIS.match(_leaf(channel))
    if match is None:
        return ""
    return ("F" if re.fullmatch(_FORCE, match["kind"], re.IGNORECASE) else "T") + match["axis"].lower()


def _resolved(source: LabChannels, doubts: list[str]) -> dict[str, Taken] | None:
    """Return the first group with all six axes."""
    sets: dict[str, dict[str, list[Channel]]] = {}
    for channel in _sound(source):
        if axis := _axis_of(channel):
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
        out[axis] = Taken(channel=candidates[0].name, unit=_unit(candidates[0], KINDS[axis[0]]))
    doubts.append("whether these are the cell's own axes, or were turned or shifted by a tool transformation")
    doubts.append("whether a tare was taken off already")
    return out


def _letter_of(channel: Channel) -> str:
    """Return the x, y or z in a channel's name; nothing where there is none."""
    match = _LETTER.match(_leaf(channel))
    return match[0][-1].lower() if match else ""


def _unnamed(source: LabChannels) -> list[Channel]:
    """Return channels that could be axes, where no name says which."""
    return [c for c in _sound(source) if not _TIME.match(_leaf(c)) and c.unit != TIMESTAMP]


def _letters(channels: Sequence[Channel]) -> str:
    """Return f or T for each channel with a unit of that kind, ? for others."""
    return "".join(
        next((x for x in "FT" if factor_of(_unit(c, KINDS[x]) or "", KINDS[x]) is not None), "?") for c in channels
    )


def _by_letters(source: LabChannels, doubts: list[str]) -> dict[str, Taken] | None:
    """Find channels whose names say x, y and z behind words of another language; units or order tell the kinds."""
    found = [c for c in _unnamed(source) if _letter_of(c)]
    threes = [found[i : i + 3] for i in range(0, len(found), 3)]
    if any(sorted(_letter_of(c) for c in three) != ["x", "y", "z"] for three in threes):
        return None
    kinds = [_letters(three) for three in threes]
    forces = [three for three, kind in zip(threes, kinds, strict=True) if kind == "FFF"]
    torques = [three for three, kind in zip(threes, kinds, strict=True) if kind == "TTT"]
    if len(forces) == len(torques) == 1:
        taken = [*forces, *torques]
        told = "their units"
    elif len(threes) == 2 and (kinds[0] != "TTT" and kinds[1] != "FFF"):
        taken, told = threes, "their order"
    else:
        return None
    out: dict[str, Channel] = {}
    for kind, three in zip("FT", taken, strict=True):
        out |= {f"{kind}{_letter_of(c)}": c for c in three}
    names = ", ".join(out[axis].name for axis in AXES)
    doubts.append(f"which channel is which: {names} were taken as {' '.join(AXES)}, by x y z and {told}")
    return {axis: Taken(channel=out[axis].name, unit=_unit(out[axis], KINDS[axis[0]])) for axis in AXES}


def _by_position(source: LabChannels, doubts: list[str]) -> dict[str, Taken] | None:
    """Find six channels whose names tell nothing: by three units of each kind, or as the only ones there are."""
    rest = _unnamed(source)
    if any(_axis_of(c) or _is_gauge(c) for c in rest):
        return None
    at = _letters(rest).find("FFFTTT")
    if at < 0 and len(rest) == 7 and rest[0].increment_s is None and not any(c not in rest for c in _sound(source)):
        rest = rest[1:]  # time comes first
    if at < 0 and len(rest) == 6:
        at = 0
    if at < 0:
        return None
    taken = rest[at : at + 6]
    doubts.append(
        f"which channel is which: their names tell nothing, so {', '.join(c.name for c in taken)} were taken as "
        f"{' '.join(AXES)} in the file's order"
    )
    return {a: Taken(channel=c.name, unit=_unit(c, KINDS[a[0]])) for a, c in zip(AXES, taken, strict=True)}


def _is_gauge(channel: Channel) -> bool:
    """Return whether a name counts inputs, as those of gauges do."""
    match = _COUNTED.match(_leaf(channel))
    return match is not None and re.split(r"[\W\d_]+", match["stem"].lower())[-1] in _GAUGE_STEMS


def _sound(source: LabChannels) -> list[Channel]:
    """Return channels whose numbers can be read; of an unknown scale too, so that it is refused by its name."""
    return [c for c in source.channels if not c.fault.startswith("holds")]


def _gauges(source: LabChannels, doubts: list[str]) -> dict[str, Taken] | None:
    """Return six channels of one stem that are counted; else the only six in volts."""
    sets: dict[tuple[str, str], dict[int, Channel]] = {}
    for channel in _sound(source):
        match = _COUNTED.match(_leaf(channel))
        if match and re.sub(r"[\s_-]", "", match["stem"]).lower() in _GAUGE_STEMS:
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
    return {g: Taken(channel=c.name, unit=_unit(c, "voltage")) for g, c in zip(GAUGES, taken, strict=True)}


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
    named = [c for c in _sound(source) if c.name not in chosen and (_TIME.match(_leaf(c)) or c.unit == TIMESTAMP)]
    named.sort(key=lambda c: c.group != used.group)
    spare = [c for c in _sound(source) if c.name not in chosen]
    if not named and used.increment_s is None and len(spare) == 1 and spare[0] is source.channels[0]:
        named = spare
        doubts.append(f"whether {spare[0].name} is the time: it is the first column and no axis")
    if named:
        channel = named[0]
        if len(named) > 1:
            doubts.append(f"which time is meant: {' or '.join(c.name for c in named)}; the first was taken")
        unit = TIMESTAMP if channel.unit == TIMESTAMP else _unit(channel, "time")
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


def _leaf(channel: Channel) -> str:
    return channel.name.removeprefix(channel.group + "/").strip()


def _epoch(source: LabChannels, channel: Channel) -> str:
    """Return the unit in which a channel's first number is a time of this century; nothing where there is none."""
    if channel.unit == TIMESTAMP:
        return ""
    block = next(iter(source.blocks([channel.name])), None)
    first = 0.0 if block is None else float(block[0, 0])
    return next((unit for unit, (low, high) in _EPOCH.items() if low < first < high), "")


def stated_unit(channel: Channel) -> str:
    """Return the unit of any kind that a channel or its name states; nothing where there is none."""
    if channel.unit:
        return channel.unit
    kinds: tuple[Kind, ...] = ("force", "torque", "voltage", "time")
    return next((found for kind in kinds if (found := _unit(channel, kind))), "")


def _unit(channel: Channel, kind: Kind) -> str | None:
    """Return the unit that the file states, or else the one in the channel's name."""
    if channel.unit:
        return channel.unit
    divided = _BEHIND_SLASH.search(_leaf(channel))  # as DIN writes it: F_x/N
    if divided is not None and factor_of(divided[1], kind) is not None:
        return str(divided[1])
    match = _IN_NAME.search(_leaf(channel))
    if match is None:
        return None
    # In brackets it is meant as one, known or not.
    return str(match[1]) if match[1] else str(match[2]) if factor_of(match[2], kind) is not None else None
