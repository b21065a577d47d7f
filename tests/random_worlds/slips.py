"""Slips of the pen: a case whose line in the session's file is not what was done."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from tests.random_worlds.protocols import Case, Plan, Rng
from tests.random_worlds.visibility import Visibility
from tests.simulator.finger import MUSCLES, Floats

KINDS = ("mass", "tendon", "exchanged", "posture", "kg")


@dataclass(frozen=True)
class Slip:
    """One mistake.

    Attributes:
        kind: wrong mass, wrong tendon, two cases exchanged, wrong posture, or grams written as kilograms.
        cases: whose lines are wrong: one, or two that were exchanged.
        stated: of each such case what the file says instead.
        change_N: RMS of the forces of these cases between what was done and what is said.
        sds: how many standard uncertainties that is.
    """

    kind: str
    cases: tuple[str, ...]
    stated: Mapping[str, Case]
    change_N: float = 0.0
    sds: float = 0.0


def draw_slips(rng: Rng, plan: Plan, visibility: Visibility, count: int, everywhere: bool) -> tuple[Slip, ...]:
    """Draw slips in different cases; in cases that are fitted only, unless `everywhere`."""
    free = [c for c in plan.cases if everywhere or c.role == "identification"]
    out: list[Slip] = []
    while len(out) < count:
        kind = str(rng.choice(KINDS))
        used = {name for slip in out for name in slip.cases}
        case = free[int(rng.integers(len(free)))]
        stated = None if case.id in used else _DRAWS[kind](rng, case, plan, used, everywhere)
        if stated:
            out.append(_measured(Slip(kind, tuple(stated), stated), plan, visibility))
    return tuple(out)


def as_stated(plan: Plan, slips: tuple[Slip, ...]) -> tuple[Case, ...]:
    """The cases as the file has them."""
    wrong = {name: case for slip in slips for name, case in slip.stated.items()}
    return tuple(wrong.get(c.id, c) for c in plan.cases)


def _measured(slip: Slip, plan: Plan, visibility: Visibility) -> Slip:
    change: Floats = np.zeros((len(plan.cases), 6))
    for i, case in enumerate(plan.cases):
        if case.id in slip.stated:
            said = slip.stated[case.id]
            change[i] = visibility.expected(case.posture, case.location, dict(case.masses_g))
            change[i] -= visibility.expected(said.posture, said.location, dict(said.masses_g))
    touched = change[[c.id in slip.stated for c in plan.cases], :3]
    sds = visibility.sds(change, everywhere=True)
    return replace(slip, change_N=float(np.sqrt(np.mean(touched**2))), sds=sds)


def _heaviest(case: Case) -> str:
    return max(case.masses_g, key=lambda m: case.masses_g[m])


def _mass(rng: Rng, case: Case, plan: Plan, used: set[str], everywhere: bool) -> dict[str, Case]:
    """Another mass of that tendon in the protocol, or a third to three times as much."""
    tendon = _heaviest(case)
    right = case.masses_g[tendon]
    others = sorted({c.masses_g[tendon] for c in plan.cases if tendon in c.masses_g} - {right})
    others += [float(round(right * 3.0 ** rng.uniform(-1.0, 1.0)))]
    wrong = float(rng.choice(others))
    if abs(np.log(wrong / right)) < 0.2:
        return {}
    return {case.id: replace(case, masses_g={**case.masses_g, tendon: wrong})}


def _tendon(rng: Rng, case: Case, plan: Plan, used: set[str], everywhere: bool) -> dict[str, Case]:
    right = _heaviest(case)
    wrong = str(rng.choice([m for m in MUSCLES if m not in case.masses_g]))
    said = {wrong if m == right else m: g for m, g in case.masses_g.items()}
    return {case.id: replace(case, masses_g={m: said[m] for m in MUSCLES if m in said})}


def _exchanged(rng: Rng, case: Case, plan: Plan, used: set[str], everywhere: bool) -> dict[str, Case]:
    """The weights of two cases of one block."""
    others = [
        c
        for c in plan.cases
        if c.block == case.block
        and dict(c.masses_g) != dict(case.masses_g)
        and c.id not in used
        and (everywhere or c.role == "identification")
    ]
    if not others:
        return {}
    other = others[int(rng.integers(len(others)))]
    return {
        case.id: replace(case, masses_g=other.masses_g),
        other.id: replace(other, masses_g=case.masses_g),
    }


def _posture(rng: Rng, case: Case, plan: Plan, used: set[str], everywhere: bool) -> dict[str, Case]:
    others = sorted({c.posture for c in plan.cases if c.role == "identification"} - {case.posture})
    return {case.id: replace(case, posture=str(rng.choice(others)))} if others else {}


def _kg(rng: Rng, case: Case, plan: Plan, used: set[str], everywhere: bool) -> dict[str, Case]:
    tendon = _heaviest(case)
    return {case.id: replace(case, masses_g={**case.masses_g, tendon: round(case.masses_g[tendon] / 1000.0, 4)})}


_DRAWS: dict[str, Callable[[Rng, Case, Plan, set[str], bool], dict[str, Case]]] = {
    "mass": _mass,
    "tendon": _tendon,
    "exchanged": _exchanged,
    "posture": _posture,
    "kg": _kg,
}
