"""The commands of a bench run by name, as keys and lines of text give them."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from daq.bench.engine import Events
from daq.bench.run import BenchRun
from daq.errors import SessionError
from daq.vocabulary import did_you_mean


def perform(run: BenchRun, command: str, argument: str = "") -> Events:
    """Do what a key or a line of text asks for.

    Args:
        run: the bench.
        command: one of COMMANDS.
        argument: a reason, a text, a case or a known weight.

    Raises:
        InputError: there is no such command, or it cannot be done now; nothing has changed then.
    """
    found = _COMMANDS.get(command)
    if found is None:
        hint = did_you_mean(command, COMMANDS)
        raise SessionError(f"no command {command!r}", f"one of {' '.join(COMMANDS)}", hint)
    return found(run, argument.strip())


def _alone(do: Callable[[BenchRun], Events]) -> Callable[[BenchRun, str], Events]:
    """Refuse a word that would be passed over, such as a posture that is not the present step's."""

    def done(run: BenchRun, argument: str) -> Events:
        if argument:
            raise SessionError(f"{argument!r} behind {do.__name__}", f"{do.__name__} alone", "A note takes a text")
        return do(run)

    return done


def _exclude(run: BenchRun, argument: str) -> Events:
    case, _, reason = argument.partition(" ")
    return run.exclude(case, reason)


def _known_weight(run: BenchRun, argument: str) -> Events:
    words = argument.split()
    wanted = "mass in g, direction and, where another, mount, such as: 500 palmar tip"
    try:
        mass_g = float(words[0])
    except (IndexError, ValueError):
        raise SessionError(f"known weight {argument!r}", wanted) from None
    if len(words) not in (2, 3):
        raise SessionError(f"known weight {argument!r}", wanted)
    return run.known_weight(mass_g, words[1], words[2] if len(words) == 3 else None)


_COMMANDS: Mapping[str, Callable[[BenchRun, str], Events]] = {
    "tare": _alone(BenchRun.tare),
    "unloaded": _alone(BenchRun.unloaded),
    "loaded": _alone(BenchRun.loaded),
    "confirm": _alone(BenchRun.confirm),
    "next": _alone(BenchRun.next),
    "repeat": BenchRun.repeat,
    "exclude": _exclude,
    "include": BenchRun.include,
    "known_weight": _known_weight,
    "posture_set": _alone(BenchRun.posture_set),
    "cell_moved": _alone(BenchRun.cell_moved),
    "retied": BenchRun.retied,
    "slipped": BenchRun.slipped,
    "moistened": _alone(BenchRun.moistened),
    "note": BenchRun.note,
    "close": _alone(BenchRun.close),
}

COMMANDS = tuple(_COMMANDS)
