"""The steps of a bench run: a known weight, the protocol's cases in order, a known weight; repeats come in between."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from daq.sessions.protocols import PlannedCase
from daq.vocabulary import direction_words


@dataclass(frozen=True)
class Step:
    """A known weight (`case` is None), or a case.

    Attributes:
        id: of the case, or `weight_` and when.
        when: before, during or after the cases, of a known weight.
        repeat_of: the case that it repeats.
    """

    id: str
    case: PlannedCase | None = None
    when: str = ""
    repeat_of: str | None = None

    @property
    def name(self) -> str:
        """The case's id, or which known weight it is, as messages name it."""
        if self.case is not None:
            return self.id
        return "the known weight between cases" if self.when == "during" else f"the known weight {self.when} the cases"

    @property
    def text(self) -> str:
        """Load and place in words."""
        if self.case is None:
            return f"known weight on the cell ({self.when})"
        masses, note = worded(self.case.masses_g), self.case.told().get("note")
        again = f", repeat of {self.repeat_of}" if self.repeat_of else ""
        return f"{masses}, {self.case.posture}, {self.case.location}{f', {note}' if note else ''}{again}"


def worded(masses_g: Mapping[str, float], times: float = 1.0) -> str:
    """Return weights, or so many times them, as they are hung."""
    return " ".join(f"{tendon} {times * mass:g} g" for tendon, mass in masses_g.items()) or "no weight"


def weight_words(weight: Mapping[str, Any], where: str = "") -> str:
    """Return a known weight's mass, its direction, where it is hung and, where it is known, the cell's mount."""
    mount = f" at the {weight['mount']}" if weight.get("mount") else ""
    return f"{weight['mass_g']:g} g {direction_words(weight['direction'])}{where}{mount}"


@dataclass
class Steps:
    """All steps, and where the run is.

    Attributes:
        done: ids of the steps that were completed; skipped: that were passed over.
    """

    all: list[Step]
    at: int = 0
    done: set[str] = field(default_factory=set)
    skipped: set[str] = field(default_factory=set)

    @classmethod
    def of(cls, cases: tuple[PlannedCase, ...]) -> Steps:
        """Lay a protocol out."""
        before, after = Step("weight_before", when="before"), Step("weight_after", when="after")
        return cls([before, *(Step(c.id, c, repeat_of=c.repeat_of) for c in cases), after])

    @property
    def now(self) -> Step | None:
        """The present step, None after the last."""
        return self.all[self.at] if self.at < len(self.all) else None

    @property
    def following(self) -> Step | None:
        """The step after the present one, None where there is none."""
        return self.all[self.at + 1] if self.at + 1 < len(self.all) else None

    @property
    def just_skipped(self) -> str:
        """Id of the case right before the present step, where it was skipped; else nothing."""
        before = self.all[self.at - 1] if self.at else None
        return before.id if before is not None and before.id in self.skipped_cases else ""

    @property
    def skipped_cases(self) -> tuple[str, ...]:
        """Ids of the cases that were skipped, in order."""
        return tuple(s.id for s in self.all if s.case is not None and s.id in self.skipped)

    @property
    def now_done(self) -> bool:
        """True if the present step is completed."""
        return self.now is not None and self.now.id in self.done

    def insert(self, step: Step) -> None:
        """Make a step the present one: after one that is completed, before one that still waits."""
        self.at += self.now_done
        self.all.insert(self.at, step)

    def go_back(self, name: str) -> None:
        """Make a step that was skipped the present one, as itself."""
        i = next(i for i, step in enumerate(self.all) if step.id == name)
        step = self.all.pop(i)
        self.at -= i < self.at
        self.skipped.remove(name)
        self.insert(step)

    def undone(self) -> list[Step]:
        """Return the steps that were not completed."""
        return [s for s in self.all if s.id not in self.done]

    def repeat(self, name: str) -> Step:
        """Return a new step that repeats a case, or what that one repeats."""
        first = next(s for s in self.all if s.id == name)
        first = first if first.repeat_of is None else next(s for s in self.all if s.id == first.repeat_of)
        # Repeats of the protocol's own are cases with a number.
        count = sum(s.id.startswith(f"{first.id}r") for s in self.all)
        return Step(f"{first.id}r{count + 1}", first.case, repeat_of=first.id)

    def during(self) -> Step:
        """Return a new known weight between cases."""
        return Step(f"weight_during_{sum(s.when == 'during' for s in self.all) + 1}", when="during")

    def checklist(self) -> list[tuple[str, str, str]]:
        """Return (id, text, state) of each step: done, skipped, now or open."""
        states = []
        for i, step in enumerate(self.all):
            state = "done" if step.id in self.done else "skipped" if step.id in self.skipped else "open"
            states.append((step.id, step.text, "now" if i == self.at and state == "open" else state))
        return states
