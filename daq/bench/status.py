"""State of a bench run for a view, and the next action of the user."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from daq.bench.forces import Result
from daq.bench.standing import Standing
from daq.bench.steps import weight_words, worded
from daq.recordings.windows import Span
from daq.sessions.protocols import PlannedCase


@dataclass(frozen=True, eq=False)
class BenchStatus:
    """State for a view.

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
        answers_begin: by command, the case that the answer to its question begins with, unless another is typed.
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
    answers_begin: Mapping[str, str]


class Next(NamedTuple):
    """Next action of the user.

    Attributes:
        text: what to do.
        command: that ends it.
    """

    text: str
    command: str


def next_of(standing: Standing, has_tare: bool, hanging_now: PlannedCase | None) -> Next:
    """Say what comes next while no plateau is looked for.

    Args:
        standing: where the bench is in its protocol.
        has_tare: whether a tare is in force.
        hanging_now: the case whose weights hang as they were read, so that they were moved no further.
    """
    step, place, wanted = standing.steps.now, standing.place, standing.wanted()
    if step is None:
        return Next("unload and tare once more, then close", "tare")
    if standing.steps.now_done:
        return Next("next, or repeat; or unload and tare", "next")
    if step.case is None and standing.weight is None:
        return Next("give the known weight's mass and direction, or go on without it", "known_weight")
    if wanted["posture"] != place["posture"]:
        return Next(f"set posture {wanted['posture']}, then mark it", "posture_set")
    if wanted["location"] != place["location"]:
        return Next(f"move the cell to the {wanted['location']}, then mark it", "cell_moved")
    if not has_tare:
        return Next("take all weights off, then tare", "tare")
    if step.case is None and standing.weight is not None:
        return Next(f"hang {weight_words(standing.weight, ' on the cell')}, then mark loaded", "loaded")
    return Next(f"{hanging(step.case, _alike(hanging_now, step.case))}, then mark loaded", "loaded")


def _alike(before: PlannedCase | None, case: PlannedCase | None) -> bool:
    """Return whether the weights of a case hang since the one before it."""
    if before is None or case is None:
        return False
    loads = [(c.masses_g, c.posture, c.location, c.reading.direction) for c in (before, case)]
    return loads[0] == loads[1]


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
