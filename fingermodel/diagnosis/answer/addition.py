"""Add chosen effects to a model: which of their forms, the refit, and what speaks for it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from daq.errors import ModelError
from fingermodel.comparison.observations import Observations
from fingermodel.diagnosis.posterior.fitting import Fitter
from fingermodel.diagnosis.posterior.hyper import Hyperparameters
from fingermodel.diagnosis.session_model.candidates import NOTHING, Candidate, Candidates, Member
from fingermodel.diagnosis.session_model.session import session_of
from fingermodel.effects.formula_tree import near
from fingermodel.fitting.fit_report import Fit
from fingermodel.fitting.identification import refit_map
from fingermodel.fitting.problems import map_problem
from fingermodel.model import Model

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
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

    def __repr__(self) -> str:
        return f"<Addition of {', '.join(self.names) or 'nothing'}: ln evidence {self.log_evidence_gain:+.1f}>"


def chosen_candidates(model: Model, names: Sequence[str], *, sagittal: bool) -> tuple[tuple[Candidate, ...], ...]:
    """Find what names stand for: each a candidate, or every candidate of an effect, of which the best is taken.

    Raises:
        ModelError: a name that is none, or an effect that this finger or session cannot have.
    """
    candidates = Candidates.of(model, sagittal=sagittal).all
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
    progress: Callable[[float], None] | None = None,
) -> Addition:
    """Free the best form of each named effect and refit everything.

    Args:
        model: with those effects at their null.
        observations: of the session.
        names: of effects or candidates; none refits what is held.
        held: parameters of effects that the model has already.
        start: (parameters,) of an earlier fit.
        starts: of the final refit.
        progress: called with the fraction of the final refit that is done.
    """
    session = session_of(model, observations, None, held)
    sagittal = session.plane == "sagittal"
    choices = chosen_candidates(model, names, sagittal=sagittal)
    candidates = Candidates.of(model, sagittal=sagittal)
    hyper = Hyperparameters.of(session)
    fitter = Fitter(session, candidates, hyper)
    centre = session.problem.centre
    begun = [
        fitter.fit(NOTHING, s, hyper.start(0), log_prior=0.0) for s in ([centre] if start is None else [start, centre])
    ]
    base = max(begun, key=lambda f: f.log_posterior)
    best = base
    options = [[Member(c, k) for c in found for k in range(len(c.forms))] for found in choices]
    for members in product(*options) if names else ():
        explanation = candidates.joined(members)
        if explanation is None:
            continue
        for begin in (base.expected(explanation, base.best), centre):
            found = fitter.fit(explanation, begin, base.best, log_prior=0.0)
            if best is base or found.log_posterior > best.log_posterior:
                best = found
    parameters = model.parameters.names
    free_names = (*held, *(parameters[i] for i in best.explanation.parameters))
    problem = map_problem(model, observations, None, free_names)
    fit = refit_map(problem, start=best.theta, starts=starts, progress=progress)
    return Addition(fit, best.explanation.names, best.log_posterior - base.log_posterior)
