"""Standing of a bench: steps, place and known weight, folded from its events, live or from a journal."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Any

from daq.bench.record import BenchSetup
from daq.bench.steps import Step, Steps, weight_words
from daq.journal.rows import Event


@dataclass
class Standing:
    """The fold of a bench's events that says what comes next.

    Attributes:
        steps: of the protocol, with what was put in between.
        place: posture and location that the bench is in, with setting and mounting.
        weight: what hangs on the cell as a known weight, None where it is not known.
        last_taken: id of the case that was taken last.
    """

    steps: Steps
    place: dict[str, Any]
    weight: dict[str, Any] | None = None
    last_taken: str | None = None
    _times_set: Counter[str] = field(default_factory=Counter)
    _times_moved: Counter[str] = field(default_factory=Counter)

    @classmethod
    def of(cls, setup: BenchSetup) -> Standing:
        """Return the standing before the first event: at the place of the first case, since moves are recorded."""
        cases = setup.cases()
        place = {"posture": cases[0].posture, "location": cases[0].location, "setting": 0, "mounting": 0}
        weight = None if setup.known_weight is None else dict(setup.known_weight)
        return cls(
            Steps.of(cases), place, weight, None, Counter([cases[0].posture]), Counter([cases[0].location])
        )  # fmt: skip

    def settings(self, posture: str) -> int:
        """Count how often a posture was set so far."""
        return self._times_set[posture]

    def mountings(self, location: str) -> int:
        """Count how often the cell was put at a location so far."""
        return self._times_moved[location]

    def wanted(self) -> dict[str, Any]:
        """Return the present step's posture and location; a known weight's direction is in one mount's axes."""
        step = self.steps.now
        if step is not None and step.case is not None:
            return {"posture": step.case.posture, "location": step.case.location}
        mount = None if step is None or self.weight is None else self.weight.get("mount")
        return {"posture": self.place["posture"], "location": mount or self.place["location"]}

    def told(self, step: Step) -> str:
        """Return what hangs where in a step; of a known weight which one, while it is the present step."""
        weight = self.weight if step.case is None and step is self.steps.now else None
        return step.text if weight is None else f"{step.text}: {weight_words(weight)}"

    def apply(self, event: Event) -> None:
        """Take one more event; kinds that change nothing here are passed over."""
        value, steps = event.value, self.steps
        if event.kind == "case_taken":
            steps.done.add(value["id"])
            self.last_taken = value["id"]
        elif event.kind == "weighed":
            steps.done.add(value["step"])
        elif event.kind == "case_skipped":
            steps.skipped.add(value["id"])
        elif event.kind == "known_weight_skipped":
            steps.skipped.add(value["step"])
        elif event.kind == "step":
            if "repeat_of" in value:
                steps.insert(steps.repeat(value["repeat_of"]))
            elif value.get("back"):
                steps.go_back(value["id"])
            else:
                steps.at += 1
        elif event.kind == "known_weight_set":
            self.weight = dict(value)
            if steps.now is None or steps.now.case is not None or steps.now_done:
                steps.insert(steps.during())
        elif event.kind == "set_posture":
            self.place |= {"posture": value["posture"], "setting": value["setting"]}
            self._times_set[value["posture"]] += 1
        elif event.kind == "move_cell":
            self.place |= {"location": value["location"], "mounting": value["mounting"]}
            self._times_moved[value["location"]] += 1
