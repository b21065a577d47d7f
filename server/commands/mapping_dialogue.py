"""Dialogue at a terminal that maps a recording's channels to time and axes."""

from __future__ import annotations

from pathlib import Path

from rich.prompt import Confirm, Prompt

from daq.errors import InputError, ReadingsError
from daq.lab.channels import TIMESTAMP, LabChannels
from daq.lab.files import AXES, GAUGES, Increment, LabFileMap, Taken
from daq.lab.names import kind_of, stated_unit
from daq.lab.opened import open_channels
from daq.lab.proposals import mapping_of, propose_channels, propose_time
from daq.units import COMMON, factor_of
from server.commands.console import say, table
from server.commands.questions import ask, number


def settled(recording: Path, calibration: str | None = None, rate_hz: float | None = None) -> LabFileMap | None:
    """Show what is proposed, ask for what is not known, and let lines be changed until they are right.

    Args:
        recording: a lab's file.
        calibration: path of the cell's .cal, where it is known.
        rate_hz: sampling rate [Hz], where it is known.

    Returns:
        The confirmed mapping; None where it was left.

    Raises:
        InputError: the recording cannot be read.
        EOFError: the input has ended.
    """
    source = open_channels(recording)
    doubts: list[str] = []
    channels = propose_channels(source, doubts)
    if channels is not None and GAUGES[0] in channels and not any(taken.unit for taken in channels.values()):
        say(f"Six channels are counted, {channels[GAUGES[0]].channel} and so on, and state no unit.")
        if not Confirm.ask("Are they the cell's gauges in volts, which a .cal file turns into forces?", default=False):
            channels, doubts = (
                dict(zip(AXES, channels.values(), strict=True)),
                [f"whether their order is {' '.join(AXES)}"],
            )
    if channels is None:
        say("The names of the channels do not tell which is which.")
        _show_channels(source)
        channels = {}
        for axis in AXES:
            channels[axis] = ask(f"{axis}: number of the channel", lambda text: _channel(source, text, channels))
    chosen = [taken.channel for taken in channels.values()]
    try:
        time: Taken | Increment = propose_time(source, source.channel(chosen[0]), chosen, doubts, rate_hz)
    except ReadingsError as error:
        say(f"  {error.found}")
        time = Increment(increment_s=1.0 / ask("Sampling rate [Hz]", _positive))
    if GAUGES[0] in channels and calibration is None:
        calibration = ask("Calibration of the cell, the path of its .cal", _file)
    proposal = mapping_of(source, channels, time, calibration, doubts)
    show_proposal(recording.name, proposal)
    proposal = _with_units(source, proposal)
    while not Confirm.ask("Is that right?", default=False):
        _show_channels(source)
        line = Prompt.ask(
            "Change one, such as 'Fx 3' or 'Fx 3 lbf', by the channel's number; Enter leaves",
            default="",
            show_default=False,
        )
        if not line:
            return None
        try:
            proposal = _with_units(source, _changed(source, proposal, line))
        except InputError as error:
            say(f"  {error}")
        show_proposal(recording.name, proposal.model_copy(update={"doubts": ()}))
    return proposal.model_copy(update={"confirmed": True, "doubts": ()})


def words(proposal: LabFileMap) -> tuple[str, dict[str, str]]:
    """Describe the source of time and each axis' channel with its unit."""
    time = proposal.time
    said = f"every {time.increment_s} s" if isinstance(time, Increment) else f"{time.channel} [{time.unit or '?'}]"
    return said, {name: f"{taken.channel} [{taken.unit or '?'}]" for name, taken in proposal.channels.items()}


def show_proposal(name: str, proposal: LabFileMap) -> None:
    """Print which channel of a recording is proposed for what, and what is in doubt."""
    said, channels = words(proposal)
    table(f"Proposed for {name}", ["is", "channel"], [["t", said], *channels.items()])
    for doubt in proposal.doubts:
        say(f"  not sure: {doubt}")


def _show_channels(source: LabChannels) -> None:
    rows = [[str(i), c.name, stated_unit(c) or "?", c.fault] for i, c in enumerate(source.channels, 1)]
    table(f"Channels of {source.path.name}", ["", "channel", "unit", ""], rows)


def _with_units(source: LabChannels, proposal: LabFileMap) -> LabFileMap:
    """Ask for the units that are not known, the last answer being proposed for the next of its kind."""
    last: dict[str, str] = {}

    def whole(key: str, taken: Taken) -> Taken:
        kind = kind_of(key)
        if (key == "t" and taken.unit == TIMESTAMP) or (taken.unit and factor_of(taken.unit, kind) is not None):
            return taken

        def read(text: str) -> str:
            if factor_of(text, kind) is None:
                raise InputError(f"{text!r} is no unit of {kind}", f"one of {' '.join(COMMON[kind])}")
            return text

        last[kind] = ask(f"Unit of {key} ({taken.channel})", read, last.get(kind))
        return taken.model_copy(update={"unit": last[kind]})

    channels = {key: whole(key, taken) for key, taken in proposal.channels.items()}
    time = proposal.time if isinstance(proposal.time, Increment) else whole("t", proposal.time)
    return proposal.model_copy(update={"channels": channels, "time": time})


def _changed(source: LabChannels, proposal: LabFileMap, line: str) -> LabFileMap:
    """Return a mapping with one line changed, as `Fx 3` or `Fx 3 lbf` says.

    Raises:
        InputError: the line is not understood.
    """
    key, _, rest = line.strip().partition(" ")
    place, _, unit = rest.strip().partition(" ")
    known = {"t", *proposal.channels}
    if key not in known:
        raise InputError(f"{key!r}", f"one of {' '.join(sorted(known))}, and the number of a channel")
    taken = _channel(source, place, {})
    taken = next((c for c in proposal.channels.values() if c.channel == taken.channel), taken)
    if unit:
        taken = taken.model_copy(update={"unit": unit.strip()})
    if key == "t":
        return proposal.model_copy(update={"time": taken})
    # What the other one had goes where this one came from: no channel is two axes.
    before = proposal.channels[key]
    others = {k: before if c.channel == taken.channel else c for k, c in proposal.channels.items()}
    return proposal.model_copy(update={"channels": others | {key: taken}})


def _channel(source: LabChannels, text: str, taken: dict[str, Taken]) -> Taken:
    """Return the channel of a number, with its unit as the file states it.

    Raises:
        InputError: there is none, its numbers cannot be read, or it is taken.
    """
    count = len(source.channels)
    if not text.isdecimal() or not 1 <= int(text) <= count:
        raise InputError(f"{text!r}", f"the number of a channel, from 1 to {count}")
    channel = source.readable(source.channels[int(text) - 1].name)
    if any(other.channel == channel.name for other in taken.values()):
        raise InputError(f"{channel.name} is taken already", "another channel")
    return Taken(channel=channel.name, unit=stated_unit(channel) or None)


def _positive(text: str) -> float:
    value = number(text)
    if not 0.0 < value < 1e7:
        raise InputError(f"{text}", "a rate above 0")
    return value


def _file(text: str) -> str:
    if not Path(text).is_file():
        raise InputError(f"there is no file {text}", "the path of a file")
    return text
