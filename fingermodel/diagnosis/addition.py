"""Add chosen effects to a model: which of their forms, the refit, and what speaks for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from daq.errors import ModelError
from fingermodel.diagnosis.candidates import NOTHING_MISSING, Candidate, Explanation, candidates_of, joined, single
from fingermodel.diagnosis.evidence import weigh_one
from fingermodel.diagnosis.fitted import require_sane
from fingermodel.diagnosis.fitter import LAST, Fitter
from fingermodel.effects.formula_tree import near
from fingermodel.fit_report import Fit
from fingermodel.model import Model
from fingermodel.observations import Observations
from fingermodel.problems import map_problem
from fingermodel.refit import refit_map

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Addition:
    """A model with effects added.

    Attributes:
        fit: of everything together.
        names: of the candidates added.
        log_evidence_gain: over the same model without them, the budget's size and the effects' form left open as in a
            diagnosis.
    """

    fit: Fit
    names: tuple[str, ...]
    log_evidence_gain: float


def chosen_candidates(model: Model, names: Sequence[str], *, sagittal: bool) -> tuple[tuple[Candidate, ...], ...]:
    """Find what names stand for: each a candidate, or every candidate of an effect, of which the best is taken.

    Raises:
        ModelError: a name that is none, or an effect that this finger or session cannot have.
    """
    candidates = candidates_of(model, sagittal=sagittal)
    out = []
    for name in names:
        found = tuple(c for c in candidates if name in (c.name, c.effect))
        if not found:
            known = list(dict.fromkeys(c.effect for c in candidates))
            if any(e.name == name.split(".")[0] for e in model.effects):
                raise ModelError(f"effect {name} cannot act in this session", f"one of {', '.join(known)}")
            raise ModelError(
                f"no effect {name!r}",
                f"one of {', '.join(known)}, a file of an effect, or a formula in quotes",
                near(name, known),
            )
        out.append(found)
    return tuple(out)


def add_effects(
    model: Model,
    observations: Observations,
    names: Sequence[str],
    *,
    held: Sequence[str] = (),
    start: Floats | None = None,
    starts: int = 8,
) -> Addition:
    """Free the best form of each named effect and refit everything.

    Args:
        model: with those effects at their null.
        observations: of the session.
        names: of effects or candidates; none refits what is held.
        held: parameters of effects that the model has already.
        start: (parameters,) of an earlier fit.
        starts: of the final refit.
    """
    sagittal = model.finger.judged_in == "sagittal"
    choices = chosen_candidates(model, names, sagittal=sagittal)
    problem = map_problem(model, observations, None, held)
    fitter = Fitter(problem)
    base = fitter.base(start)
    best, best_value = NOTHING_MISSING, -np.inf
    options = [[single(c, k) for c in found for k in range(len(c.alternatives))] for found in choices]
    for combination in product(*options) if names else ():
        explanation = _together(combination)
        if explanation is None:
            continue
        fitted = fitter.fit(explanation, [fitter.expected(base, explanation), problem.centre], LAST, finely=True)
        if best is NOTHING_MISSING or fitted.log_evidence > best_value:
            best, best_value = explanation, fitted.log_evidence
    parameters = model.parameters.names
    free_names = (*held, *(parameters[i] for i in best.parameters))
    final = map_problem(model, observations, None, free_names)
    fit = refit_map(final, start=require_sane(fitter.best[best]).theta, starts=starts)
    every = tuple(c for found in choices for c in found)
    both = [weigh_one(problem, fitter.best[e], every).log_evidence for e in (NOTHING_MISSING, best)]
    return Addition(fit, best.names, both[1] - both[0])


def _together(combination: Sequence[Explanation]) -> Explanation | None:
    """All of them acting together; None where two are the same."""
    out = combination[0]
    for other in combination[1:]:
        if set(out.parameters) & set(other.parameters):
            return None
        out = joined(out, other)
    return out
