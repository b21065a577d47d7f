"""What may act: every effect as a candidate, explanations of up to three of them, and their prior."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from math import factorial, prod

import numpy as np

from fingermodel.arrays import Mask
from fingermodel.diagnosis.settings import P_NOTHING, P_SIZES, P_UNUSUAL
from fingermodel.fitting.problems import out_of_plane
from fingermodel.model import Model


@dataclass(frozen=True)
class Candidate:
    """One thing that may act."""

    name: str  # such as `worn_pulley.FDP`; candidates of one effect share its prior
    effect: str  # name of its effect
    forms: tuple[tuple[int, ...], ...]  # each a set of indices of parameters; they share the candidate's prior
    share: float  # of its effect's prior
    outside: bool = False  # whether its effect is marked as outside the catalogue
    title: str = ""  # of its effect
    shown_by: str = ""  # what measurement would show its effect

    @property
    def has_form(self) -> bool:
        """Whether it is one effect, whose form may be in error; not all candidates at once."""
        return bool(self.effect)


@dataclass(frozen=True)
class Member:
    """A candidate in one of its forms."""

    candidate: Candidate
    form: int = 0

    @property
    def parameters(self) -> tuple[int, ...]:
        """Indices of what it frees."""
        return self.candidate.forms[self.form]


@dataclass(frozen=True)
class Explanation:
    """Candidates that act together; none: no effect acts."""

    members: tuple[Member, ...] = ()  # in the order in which they are searched

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Of the candidates."""
        return tuple(m.candidate.name for m in self.members)

    @property
    def effects(self) -> tuple[str, ...]:
        """Of their effects, each once."""
        return tuple(dict.fromkeys(m.candidate.effect for m in self.members))

    @cached_property
    def parameters(self) -> tuple[int, ...]:
        """Indices of what is free besides the base model's."""
        return tuple(i for m in self.members for i in m.parameters)

    @property
    def less_one(self) -> list[Explanation]:
        """The same without one of its members, for each of them."""
        return [Explanation(tuple(m for m in self.members if m != one)) for one in self.members]

    @property
    def size(self) -> int:
        """How many candidates act."""
        return len(self.members)


NOTHING = Explanation()


@dataclass(frozen=True)
class Candidates:
    """All candidates of a search."""

    all: tuple[Candidate, ...]  # in the order in which explanations name them

    @classmethod
    def of(cls, model: Model, *, sagittal: bool = False, held: Iterable[str] = ()) -> Candidates:
        """List the candidates of a model's effects.

        Args:
            model: with the effects at their null.
            sagittal: whether only the sagittal plane is looked at, so that parameters beyond it stay fixed.
            held: parameters of effects that the base model has already; what has any of them is no candidate.
        """
        topology, layout, table = model.finger.topology, model.layout, model.parameters
        hidden = set(np.flatnonzero(out_of_plane(model))) if sagittal else set()
        had, out = {table.index[name] for name in held}, list[Candidate]()
        for effect in model.effects:
            if not effect.parameters(topology, layout):
                continue
            found = {}
            for name, forms in effect.variants(topology, layout).items():
                seen = (tuple(table.index[p] for p in names if table.index[p] not in hidden) for names in forms)
                if kept := tuple(dict.fromkeys(s for s in seen if s)):
                    found[name] = kept
            share = 1.0 / max(len(found), 1)
            new = {name: forms for name, forms in found.items() if had.isdisjoint(i for form in forms for i in form)}
            of_effect = effect.outside, effect.title, effect.shown_by
            out += [Candidate(name, effect.name, forms, share, *of_effect) for name, forms in new.items()]
        return cls(tuple(out))

    @cached_property
    def by_name(self) -> dict[str, Candidate]:
        """Each by its name, in their order."""
        return {c.name: c for c in self.all}

    @cached_property
    def _order(self) -> dict[str, int]:
        return {name: k for k, name in enumerate(self.by_name)}

    @cached_property
    def _weights(self) -> dict[str, float]:
        """Share of the prior that each effect has among those of its size."""
        inside = {c.effect for c in self.all if not c.outside}
        outside = {c.effect for c in self.all if c.outside}
        weight = {e: (1.0 - P_UNUSUAL) / max(len(inside), 1) for e in inside}
        return weight | {e: P_UNUSUAL / len(outside) for e in outside}

    @cached_property
    def singles(self) -> list[Explanation]:
        """Every candidate alone, in each of its forms."""
        return [Explanation((Member(c, k),)) for c in self.all for k in range(len(c.forms))]

    def joined(self, members: Iterable[Member]) -> Explanation | None:
        """Members acting together, in the order of the candidates; None where two are one candidate or share one."""
        chosen = sorted(members, key=lambda m: self._order[m.candidate.name])
        parameters = [i for m in chosen for i in m.parameters]
        alone = len({m.candidate.name for m in chosen}) == len(chosen) and len(set(parameters)) == len(parameters)
        return Explanation(tuple(chosen)) if alone else None

    def neighbours(self, explanation: Explanation) -> list[Explanation]:
        """One member more, fewer or exchanged, or in another form."""
        singles = [e.members[0] for e in self.singles]
        offers = [explanation.members[:k] + explanation.members[k + 1 :] for k in range(explanation.size)]
        offers = [(*kept, m) for kept in (offers if explanation.size else []) for m in singles] + offers
        if explanation.size < len(P_SIZES):
            offers += [(*explanation.members, m) for m in singles]
        found = (self.joined(members) for members in offers)
        return [e for e in dict.fromkeys(found) if e is not None and e != explanation]

    def pairs(self, firsts: Iterable[Explanation]) -> list[Explanation]:
        """Some singles, each with every other candidate in every form."""
        found = (self.joined((*a.members, *b.members)) for a, b in product(firsts, self.singles))
        return [e for e in dict.fromkeys(found) if e is not None]

    def log_prior(self, explanation: Explanation) -> float:
        """Log prior: by size, then by effect of that size, then by candidate and form."""
        if not explanation.size:
            return float(np.log(P_NOTHING))
        weight = self._weights
        counts = Counter(m.candidate.effect for m in explanation.members)
        orders = factorial(explanation.size) / prod(factorial(n) for n in counts.values())
        each = [weight[m.candidate.effect] * m.candidate.share / len(m.candidate.forms) for m in explanation.members]
        mass = (1.0 - P_NOTHING) * P_SIZES[explanation.size - 1]
        return float(np.log(mass * orders * np.prod(each)))


def free_mask(model: Model, explanation: Explanation) -> Mask:
    """(parameters,) which of them an explanation frees."""
    out = np.zeros(len(model.parameters), dtype=bool)
    out[list(explanation.parameters)] = True
    return out
