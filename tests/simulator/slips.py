"""What is done instead of what a session states: scatter of the tensions, and slips of the pen in single cases."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from tests.simulator.protocols import Protocol
from tests.simulator.situation import Case

KINDS = ("tendon", "mass", "digit", "posture", "exchanged", "kept", "amount", "tare")


# Of these the entry is as it was planned.
_DONE = ("kept", "tare")


@dataclass(frozen=True)
class Done:
    """A protocol as it was carried out, and as the session states it.

    Attributes:
        seed: of everything that is drawn.
        scatter: of each tendon's tension from case to case, relative.
        kind: of slip; none where None.
        everywhere: whether a validation case may be the one.
    """

    seed: int
    scatter: float = 0.0
    kind: str | None = None
    everywhere: bool = False

    def __call__(self, plan: Protocol) -> tuple[Protocol, Protocol]:
        """Draw what is done, and what is said to have been."""
        rng = np.random.default_rng([self.seed, 77])
        done = [
            replace(c, masses_g={m: g * float(np.exp(self.scatter * rng.normal())) for m, g in c.masses_g.items()})
            for c in plan.cases
        ]
        stated = list(plan.cases)
        for index, entry in self._slipped(plan).items():
            if self.kind in _DONE:
                done[index] = replace(done[index], masses_g=entry.masses_g)
            else:
                stated[index] = replace(stated[index], masses_g=entry.masses_g, posture=entry.posture)
        return replace(plan, cases=tuple(done)), replace(plan, cases=tuple(stated))

    def wrong(self, plan: Protocol) -> tuple[str, ...]:
        """Cases that the session states wrongly."""
        return tuple(plan.cases[i].id for i in self._slipped(plan))

    def _slipped(self, plan: Protocol) -> dict[int, Case]:
        """What is entered, or done where that is what goes wrong, in the cases that are stated wrongly, by index."""
        if self.kind is None:
            return {}
        rng = np.random.default_rng([self.seed, 78])
        while True:
            index = int(rng.integers(len(plan.cases)))
            case = plan.cases[index]
            if not self.everywhere and case.role != "identification":
                continue
            if self.kind == "exchanged":
                other = int(rng.integers(len(plan.cases)))
                with_it = plan.cases[other]
                if (
                    with_it.role == case.role
                    and with_it.location == case.location
                    and with_it.masses_g != case.masses_g
                ):
                    return {index: with_it, other: case}
                continue
            found = _SLIPS[self.kind](rng, plan, index)
            if found is not None:
                return {index: found}


def _tendon(rng: np.random.Generator, plan: Protocol, index: int) -> Case | None:
    case = plan.cases[index]
    others = sorted({m for c in plan.cases for m in c.masses_g} - set(case.masses_g))
    wrong = str(rng.choice(sorted(case.masses_g)))
    masses = {str(rng.choice(others)) if m == wrong else m: g for m, g in case.masses_g.items()}
    return replace(case, masses_g=masses)


def _mass(rng: np.random.Generator, plan: Protocol, index: int) -> Case | None:
    case = plan.cases[index]
    muscle = str(rng.choice(sorted(case.masses_g)))
    weights = sorted({g for c in plan.cases for g in c.masses_g.values()} - {case.masses_g[muscle]})
    return replace(case, masses_g={**case.masses_g, muscle: float(rng.choice(weights))})


def _digit(rng: np.random.Generator, plan: Protocol, index: int) -> Case | None:
    case = plan.cases[index]
    muscle = str(rng.choice(sorted(case.masses_g)))
    text = list(f"{case.masses_g[muscle]:.0f}")
    at = int(rng.integers(len(text)))
    digit = str(rng.integers(1, 10))
    if digit == text[at]:
        return None
    text[at] = digit
    return replace(case, masses_g={**case.masses_g, muscle: float("".join(text))})


def _posture(rng: np.random.Generator, plan: Protocol, index: int) -> Case | None:
    case = plan.cases[index]
    return replace(case, posture=str(rng.choice(sorted(set(plan.postures_deg) - {case.posture}))))


def _kept(rng: np.random.Generator, plan: Protocol, index: int) -> Case | None:
    """The weights of the case before still hung."""
    case, before = plan.cases[index], plan.cases[index - 1]
    more = {m: g for m, g in before.masses_g.items() if m not in case.masses_g}
    if index == 0 or before.block_start_s != case.block_start_s or not more:
        return None
    return replace(case, masses_g={**case.masses_g, **more})


def _amount(rng: np.random.Generator, plan: Protocol, index: int) -> Case | None:
    """The suture bore less than what hung from it."""
    case = plan.cases[index]
    muscle = str(rng.choice(sorted(case.masses_g)))
    return replace(case, masses_g={**case.masses_g, muscle: case.masses_g[muscle] / float(rng.uniform(0.3, 0.8))})


def _tare(rng: np.random.Generator, plan: Protocol, index: int) -> Case | None:
    """The tare was taken with the weight on: less that, nothing is left."""
    return replace(plan.cases[index], masses_g={})


_SLIPS: dict[str, Callable[[np.random.Generator, Protocol, int], Case | None]] = {
    "tendon": _tendon,
    "mass": _mass,
    "digit": _digit,
    "posture": _posture,
    "kept": _kept,
    "amount": _amount,
    "tare": _tare,
}
