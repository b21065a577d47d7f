"""What is searched: every effect by itself, as the parameters that it would free."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import reduce
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from fingermodel.model import Model
from fingermodel.problems import out_of_plane

NOTHING: tuple[str, ...] = ()
# Of an explanation's candidates; none are something else.
Names = tuple[str, ...] | None


@dataclass(frozen=True)
class Candidate:
    """One thing that may be missing.

    Attributes:
        name: of the candidate, such as `worn_pulley.FDP`; effects with several candidates share their prior.
        effect: name of its effect.
        alternatives: each a set of indices of parameters; they share the candidate's prior.
        share: of the effect's prior that this candidate has.
        rests_on_clamp_assumption: of its effect.
        constitutive: of its effect.
    """

    name: str
    effect: str
    alternatives: tuple[tuple[int, ...], ...]
    share: float
    rests_on_clamp_assumption: bool
    constitutive: bool = True


@dataclass(frozen=True)
class Explanation:
    """A set of candidates that act together, each in one of its alternatives; none: nothing is missing.

    Attributes:
        names: of the candidates, in the catalogue's order.
        effects: their effects' names.
        parameters: indices of the parameters that are free besides the base's.
        alternative: which alternative of each candidate.
    """

    names: tuple[str, ...]
    effects: tuple[str, ...]
    parameters: tuple[int, ...]
    alternative: tuple[int, ...] = ()

    @property
    def size(self) -> int:
        """How many effects it has."""
        return len(self.names)


NOTHING_MISSING = Explanation((), (), ())


def candidates_of(model: Model, *, sagittal: bool = False) -> tuple[Candidate, ...]:
    """List the candidates of a model's effects.

    Args:
        model: whose effects they are.
        sagittal: whether only the sagittal plane is looked at, so that parameters beyond it stay fixed.
    """
    topology, layout, table = model.finger.topology, model.layout, model.parameters
    hidden = set(np.flatnonzero(out_of_plane(model))) if sagittal else set()
    out: list[Candidate] = []
    for effect in model.effects:
        if not effect.parameters(topology, layout):
            continue
        found = {}
        for name, alternatives in effect.variants(topology, layout).items():
            seen = [tuple(table.index[p] for p in names if table.index[p] not in hidden) for names in alternatives]
            kept = tuple(dict.fromkeys(s for s in seen if s))
            if kept:
                found[name] = kept
        for name, kept in found.items():
            share = 1.0 / len(found)
            out.append(Candidate(name, effect.name, kept, share, effect.rests_on_clamp_assumption, effect.constitutive))
    return tuple(out)


def single(candidate: Candidate, alternative: int) -> Explanation:
    """One candidate in one of its alternatives."""
    return Explanation((candidate.name,), (candidate.effect,), candidate.alternatives[alternative], (alternative,))


def joined(a: Explanation, b: Explanation) -> Explanation:
    """Two explanations acting together."""
    return Explanation(
        (*a.names, *b.names),
        tuple(dict.fromkeys((*a.effects, *b.effects))),
        (*a.parameters, *b.parameters),
        (*a.alternative, *b.alternative),
    )


def together(singles: Iterable[Explanation], candidates: tuple[Candidate, ...]) -> Explanation:
    """Single candidates acting together, in the order in which they are searched; of none, nothing is missing."""
    order = [c.name for c in candidates]
    return reduce(joined, sorted(singles, key=lambda e: order.index(e.names[0])), NOTHING_MISSING)


def members(explanation: Explanation, candidates: tuple[Candidate, ...]) -> list[Explanation]:
    """Each candidate of an explanation by itself, in its alternative."""
    by_name = {c.name: c for c in candidates}
    return [single(by_name[name], k) for name, k in zip(explanation.names, explanation.alternative, strict=True)]


def log_prior(explanation: Explanation, candidates: tuple[Candidate, ...], nothing: float = 0.5) -> float:
    """Log prior of an explanation: `nothing` on nothing, the rest over sizes, then over effects of a size.

    A tenth of the rest is kept for something that is none of the catalogue's (`log_prior_else`).
    """
    if explanation.size == 0:
        return float(np.log(nothing))
    by_name = {c.name: c for c in candidates}
    effects = len({c.effect for c in candidates})
    pairs = max(effects * (effects - 1) // 2 + _several(candidates), 1)
    share = np.prod([by_name[n].share / len(by_name[n].alternatives) for n in explanation.names])
    mass = 0.55 / max(effects, 1) if explanation.size == 1 else 0.35 / pairs
    return float(np.log((1.0 - nothing) * mass * share))


def log_prior_else(nothing: float = 0.5) -> float:
    """Log prior of something that the catalogue does not hold."""
    return float(np.log((1.0 - nothing) * 0.1))


def _several(candidates: tuple[Candidate, ...]) -> int:
    """Effects of which two candidates may act together, such as two worn pulleys."""
    names = [c.effect for c in candidates]
    return len({n for n in names if names.count(n) > 1})


def pairs_of(candidates: tuple[Candidate, ...]) -> list[tuple[Candidate, Candidate]]:
    """Every two different candidates."""
    return list(combinations(candidates, 2))


def mask(model: Model, explanation: Explanation) -> NDArray[np.bool_]:
    """Which of the model's parameters an explanation frees."""
    out = np.zeros(len(model.parameters), dtype=bool)
    out[list(explanation.parameters)] = True
    return out
