"""What a view of a bench run shows, and what the user is to do now."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from daq.bench.forces import Result
from daq.bench.steps import Step, worded
from daq.protocols import PlannedCase
from daq.windows import Span


@dataclass(frozen=True, eq=False)
class BenchStatus:
    """What a view shows.

    Attributes:
        now_s: of the stream.
        step: what is hung where.
        todo: what to do now.
        phase: idle, unloaded or loaded.
        offer: window that waits to be confirmed; reason: why there is none.
        live: force of the offer; last: of the case that was taken last.
        warnings: the latest.
        checklist: (id, text, done, skipped, now or open) of each step.
        tare_age_s: None without a valid tare.
        closed: whether the session is closed.
        suggests: the command that comes next, empty while something is waited for.
    """

    now_s: float
    step: str
    todo: str
    phase: str
    offer: Span | None
    reason: str
    live: Result | None
    last: Result | None
    warnings: tuple[str, ...]
    checklist: list[tuple[str, str, str]]
    tare_age_s: float | None
    closed: bool
    suggests: str


def todo(
    step: Step | None,
    done: bool,
    place: Mapping[str, Any],
    wanted: Mapping[str, Any],
    has_tare: bool,
    has_weight: bool,
    hangs: bool,
) -> str:
    """Say what comes next while no plateau is looked for.

    Args:
        step: the present one; None after the last.
        done: whether it is completed.
        place: posture and location that the bench is in.
        wanted: those that the step needs.
        has_tare: whether a tare is in force.
        has_weight: whether the known weight is known.
        hangs: whether the step's weights hang since the case before it was taken.
    """
    if step is None:
        return "unload and tare once more, then close"
    if done:
        return "next, or repeat; or unload and tare"
    if step.case is None and not has_weight:
        return "give the known weight's mass and direction, or go on without it"
    if wanted["posture"] != place["posture"]:
        return f"set posture {wanted['posture']}, then mark it"
    if wanted["location"] != place["location"]:
        return f"move the cell to the {wanted['location']}, then mark it"
    if not has_tare:
        return "take all weights off, then tare"
    return f"{hanging(step.case, hangs)}, then mark loaded"


def suggested(
    step: Step | None, done: bool, place: Mapping[str, Any], wanted: Mapping[str, Any], has_tare: bool, has_weight: bool
) -> str:
    """Return the command that ends what `todo` says, for the same arguments."""
    if step is None:
        return "tare"
    if done:
        return "next"
    if step.case is None and not has_weight:
        return "known_weight"
    if wanted["posture"] != place["posture"]:
        return "posture_set"
    if wanted["location"] != place["location"]:
        return "cell_moved"
    return "loaded" if has_tare else "tare"


def hanging(case: PlannedCase | None, hangs: bool) -> str:
    """Say how the weights come to rest; nothing more is done to those that hang but what the case itself asks for."""
    if case is None:
        return "hang the weights"
    reading, words = case.reading, ["hang the weights"]
    if reading.overload is not None and (reading.overloading or not hangs):
        over = worded(case.masses_g, reading.overload)
        words = [f"hang {reading.overload:g} times the weights ({over})", f"take them down to {worded(case.masses_g)}"]
    elif reading.tapped and hangs:
        words = ["leave the weights hanging"]
    return ", ".join([*words, *["tap the rig"] * reading.tapped])
