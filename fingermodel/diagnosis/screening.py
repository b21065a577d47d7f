"""What the model, straightened out about one optimum, expects of others: in which form, and in which pairs."""

from __future__ import annotations

from collections.abc import Collection, Iterator

import numpy as np

from fingermodel.diagnosis.candidates import (
    NOTHING_MISSING,
    Candidate,
    Explanation,
    members,
    pairs_of,
    single,
    together,
)
from fingermodel.diagnosis.fitted import Fitted

# Forms are alike where what tells them apart has no slope, but for rounding.
EQUAL = 1e-6


def best_form(host: Fitted, candidate: Candidate, kept: Explanation = NOTHING_MISSING) -> Explanation:
    """The first alternative of a candidate that gains most beside what is kept, about a host's optimum."""
    gains = np.array([host.everything.gain((*kept.parameters, *p)) for p in candidate.alternatives])
    return single(candidate, int(np.flatnonzero(gains >= gains.max() - EQUAL)[0]))


def companions(host: Fitted, kept: Explanation, candidates: tuple[Candidate, ...]) -> Iterator[Explanation]:
    """Pairs of what is kept of a host and what the host has not, in the form that promises most beside it."""
    yield from beside(host, kept, candidates, without=host.explanation.names)


def beside(
    host: Fitted, kept: Explanation, candidates: tuple[Candidate, ...], without: Collection[str] = ()
) -> Iterator[Explanation]:
    """Pairs of what is kept and any other, in the form that promises most beside it about a host's optimum."""
    for candidate in candidates:
        if candidate.name not in (*kept.names, *without):
            yield from _together(kept, best_form(host, candidate, kept), candidates)


def pairs_about(host: Fitted, candidates: tuple[Candidate, ...]) -> Iterator[Explanation]:
    """All pairs, each member in the form that promises most by itself about a host's optimum."""
    forms = {c.name: best_form(host, c) for c in candidates}
    for first, second in pairs_of(candidates):
        yield from _together(forms[first.name], forms[second.name], candidates)


def other_forms(explanation: Explanation, candidates: tuple[Candidate, ...]) -> Iterator[Explanation]:
    """The same with one member in another form."""
    by_name = {c.name: c for c in candidates}
    own = members(explanation, candidates)
    for k, member in enumerate(own):
        candidate = by_name[member.names[0]]
        for alternative in range(len(candidate.alternatives)):
            other = single(candidate, alternative)
            if other == member:
                continue
            if len(own) == 1:
                yield other
            else:
                yield from _together(other, own[1 - k], candidates)


def _together(one: Explanation, other: Explanation, candidates: tuple[Candidate, ...]) -> Iterator[Explanation]:
    """The pair of two, unless both free the same parameter."""
    if not set(one.parameters) & set(other.parameters):
        yield together((one, other), candidates)
