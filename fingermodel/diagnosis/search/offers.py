"""What a session linearised somewhere promises explanations that are not fitted yet."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from fingermodel.diagnosis.posterior.optimum import Optimum
from fingermodel.diagnosis.session_model.candidates import Explanation


class Offer(NamedTuple):
    """Log posterior that an explanation is promised, and where the session was linearised."""

    value: float
    host: Optimum


def better(some: Mapping[Explanation, Offer], others: Mapping[Explanation, Offer]) -> dict[Explanation, Offer]:
    """Of each explanation what promises more."""
    new = {e: offer for e, offer in others.items() if e not in some or offer.value > some[e].value}
    return {**some, **new}


def best_forms(promised: Mapping[Explanation, Offer]) -> list[Explanation]:
    """Of each set of names the form that promises most; the most promising first."""
    best: dict[tuple[str, ...], Explanation] = {}
    for explanation in sorted(promised, key=lambda e: -promised[e].value):
        best.setdefault(explanation.names, explanation)
    return list(best.values())
