"""What the name of a recording's channel says: an axis, a gauge, time, a unit."""

from __future__ import annotations

import re
from collections.abc import Sequence

from daq.lab.channels import Channel
from daq.lab.files import GAUGES
from daq.recordings.columns import KINDS
from daq.units import Kind, factor_of

_FORCE = "f|forces?|kraft|kraefte|kräfte|kracht|fuerza|forza|for[cç]a|siła|s[ií]la|voima|kuvvet|сила|力"
_TORQUE = (
    "t|m|torques?|moments?|momento|drehmoment|koppel|couple|coppia|vridmoment|momentti|tork|момент|トルク|力矩|扭矩"
)
_AXIS = re.compile(rf"^(?:.*[\s./:-])?(?P<kind>{_FORCE}|{_TORQUE})[\s._(-]*(?P<axis>[xyz])(?![a-z])", re.IGNORECASE)
TIME = re.compile(
    r"^(t|time|timestamps?|x_value|zeit(stempel)?|temps|tiempo|tempo|tijd|czas|время|elapsed|date|datum|clock|epoch)(?![a-z])",
    re.IGNORECASE,
)
COUNTED = re.compile(r"^(?P<stem>.*?)[\s_-]*(?P<number>\d+)\s*(?:[\[(].*)?$")
GAUGE_STEMS = {"gauge", "gage", "sg", "g", "straingauge", "straingage", "ai", "voltage", "volt", "v", "ch", "channel"}
# A letter for an axis behind a word of any language.
_LETTER = re.compile(r"^.*?(?:(?<![A-Za-z])[xyzXYZ]|(?<=[a-z])[XYZ])(?![A-Za-z])")
_BEHIND_SLASH = re.compile(r"/\s*\(?([^/()]+)\)?\s*$")
_IN_NAME = re.compile(r"[\[(]\s*([^\])]+?)\s*[\])]\s*$|[,_\s]([^\W\d_]+(?:[-*·.]?[^\W\d_]+)*)\s*$")
# Behind a name as in `Aika_ms`; `min` there may be a minimum.
_PLAIN_TIMES = ("s", "ms", "us")


def axis_of(channel: Channel) -> str:
    """Return which of the six axes a channel's name means; nothing where it means none."""
    match = _AXIS.match(leaf(channel))
    if match is None:
        return ""
    return ("F" if re.fullmatch(_FORCE, match["kind"], re.IGNORECASE) else "T") + match["axis"].lower()


def letter_of(channel: Channel) -> str:
    """Return the x, y or z in a channel's name; nothing where there is none."""
    match = _LETTER.match(leaf(channel))
    return match[0][-1].lower() if match else ""


def word_of(channel: Channel) -> str:
    """Return what stands before the x, y or z in a channel's name."""
    match = _LETTER.match(leaf(channel))
    return match[0][:-1].strip(" _.-([").lower() if match else ""


def kinds_said(three: Sequence[Channel]) -> str:
    """Return F or T as the units or else the words of three channels say, both where they differ; nothing of none."""
    letters = set(kinds_of_units(three)) - {"?"} or {axis_of(c)[:1] for c in three}
    return "".join(sorted(letters))


def is_xyz(three: Sequence[Channel]) -> bool:
    """Return whether channels are one x, one y and one z."""
    return sorted(letter_of(c) for c in three) == ["x", "y", "z"]


def kinds_of_units(channels: Sequence[Channel]) -> str:
    """Return f or T for each channel with a unit of that kind, ? for others."""
    return "".join(
        next((x for x in "FT" if factor_of(unit_of(c, KINDS[x]) or "", KINDS[x]) is not None), "?") for c in channels
    )


def is_gauge(channel: Channel) -> bool:
    """Return whether a name counts inputs, as those of gauges do."""
    match = COUNTED.match(leaf(channel))
    return match is not None and re.split(r"[\W\d_]+", match["stem"].lower())[-1] in GAUGE_STEMS


def counts_time(channel: Channel) -> bool:
    """Return whether a unit of time is stated beside a channel's name; a word behind a name may mean something else."""
    unit = unit_of(channel, "time") or ""
    told = bool(channel.unit) or not leaf(channel).endswith(unit) or unit in _PLAIN_TIMES
    return bool(unit) and told and factor_of(unit, "time") is not None


def leaf(channel: Channel) -> str:
    """Return a channel's name without its group."""
    return channel.name.removeprefix(channel.group + "/").strip()


def stated_unit(channel: Channel) -> str:
    """Return the unit of any kind that a channel or its name states; nothing where there is none."""
    if channel.unit:
        return channel.unit
    kinds: tuple[Kind, ...] = ("force", "torque", "voltage", "time")
    return next((found for kind in kinds if (found := unit_of(channel, kind))), "")


def unit_of(channel: Channel, kind: Kind) -> str | None:
    """Return the unit that the file states, or else the one in the channel's name."""
    if channel.unit:
        return channel.unit
    divided = _BEHIND_SLASH.search(leaf(channel))  # as DIN writes it: F_x/N
    if divided is not None and factor_of(divided[1], kind) is not None:
        return str(divided[1])
    match = _IN_NAME.search(leaf(channel))
    if match is None:
        return None
    # In brackets it is meant as one, known or not, unless it is an axis.
    if match[1] and match[1].lower() in ("x", "y", "z"):
        return None
    return str(match[1]) if match[1] else str(match[2]) if factor_of(match[2], kind) is not None else None


def kind_of(key: str) -> Kind:
    """Return the kind of unit of an axis or a gauge, or of time as `t`."""
    return "time" if key == "t" else "voltage" if key in GAUGES else KINDS[key[0]]
