"""Add chosen effects to a model: which of their forms, the refit, and what speaks for it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from daq.errors import ModelError
from fingermodel.arrays import Floats
from fingermodel.comparison.observations import Observations
from fingermodel.diagnosis.posterior.fitting import Fitter
from fingermodel.diagnosis.posterior.hyper import FORMS, GRIDS, Hyperparameters, Node
from fingermodel.diagnosis.posterior.optimum import Optimum
from fingermodel.diagnosis.search.beginning import Beginner
from fingermodel.diagnosis.session_model.candidates import Candidates, Explanation, Member
from fingermodel.diagnosis.session_model.session import session_of
from fingermodel.effects.formula_tree import near
from fingermodel.fingers import Plane
from fingermodel.fitting.fit_report import Fit
from fingermodel.fitting.identification import refit_map
from fingermodel.fitting.problems import Problem
from fingermodel.fitting.reading_errors import ReadingErrors
from fingermodel.model import Model


@dataclass(frozen=True)
class Recipe:
    """What a fit minimises, in plain values: other readings of the session can be fitted alike."""

    members: tuple[tuple[str, int], ...]  # of the explanation: names of candidates, and which of its forms each has
    node: Node  # of the hyperparameters
    bad: tuple[int, ...]  # indices of the cases whose reading may be anything
    about: tuple[float, ...]  # (parameters,) about which scatter and errors of form are found
    grids: str = GRIDS  # of the hyperparameters, on which the node counts places

    @classmethod
    def of(cls, fit: Optimum, node: Node) -> Recipe:
        """Return that of a fit under the hyperparameters of a node."""
        members = tuple((m.candidate.name, m.form) for m in fit.explanation.members)
        return cls(members, node, tuple(sorted(fit.bad)), tuple(fit.theta.tolist()))

    def problem(
        self, model: Model, observations: Observations, plane: Plane | None = None, held: Sequence[str] = ()
    ) -> Problem:
        """Return the problem that these observations pose; arguments as of `add_effects`."""
        about, bad = np.array(self.about), frozenset(self.bad)
        session = session_of(model, observations, plane, held).seen_from(about)
        candidates = Candidates.of(model, sagittal=session.plane == "sagittal")
        fitter = Fitter(session, candidates, Hyperparameters.of(session))
        explanation = Explanation(tuple(Member(candidates.by_name[name], form) for name, form in self.members))
        begun = fitter.linearised(explanation, about, self.node, bad, 0.0)
        return fitter.problem(explanation, self.node, bad, begun)

    def drawn(self, model: Model, observations: Observations, rng: np.random.Generator) -> Observations:
        """Draw the readings that are fitted anew about these, with the errors that the fit counts with."""
        session = session_of(model, observations).seen_from(np.array(self.about))
        values, wrench = Hyperparameters.of(session).values(self.node), observations.wrench.copy()
        wrench.reshape(-1)[session.rows[session.fitted]] += session.drawn_noise(values.errors, rng)
        return replace(observations, wrench=wrench)


@dataclass(frozen=True, eq=False, repr=False)
class Addition:
    """A model with effects added."""

    fit: Fit  # of everything together
    alone: Fit | None  # of the same without what was added; None where nothing was
    names: tuple[str, ...]  # of the candidates added
    # Over the same model without them, the budget's size and the effects' form left open as in a diagnosis; None where
    # none was added.
    log_evidence_gain: float | None
    recipe: Recipe  # of what the fit minimises

    def __repr__(self) -> str:
        if self.log_evidence_gain is None:
            return "<Addition of nothing>"
        return f"<Addition of {', '.join(self.names)}: ln evidence {self.log_evidence_gain:+.1f}>"


def _explanations(model: Model, names: Sequence[str], candidates: Candidates, *, sagittal: bool) -> list[Explanation]:
    """List what names may stand for together: each a candidate, or every candidate of an effect, in each of its forms.

    Raises:
        ModelError: a name that is none, an effect that this finger or session cannot have or the model has already, or
            names that cannot act together.
    """
    every, options = Candidates.of(model, sagittal=sagittal), []
    for name in names:
        named = [c for c in every.all if name in (c.name, c.effect)]
        if not named:
            known = list(dict.fromkeys(c.effect for c in every.all))
            if any(e.name == name.split(".")[0] for e in model.effects):
                raise ModelError(f"effect {name} cannot act in this session", f"one of {', '.join(known)}")
            raise ModelError(
                f"no effect {name!r}",
                f"one of {', '.join(known)}, a file of an effect, or a formula in quotes",
                near(name, known),
            )
        left = [c for c in candidates.all if c in named]
        if not left:
            raise ModelError(f"the model has {name} already", "an effect that it lacks", "Take it out first")
        options.append([Member(c, k) for c in left for k in range(len(c.forms))])
    out = [e for members in product(*options) if (e := candidates.joined(members)) is not None]
    if not out:
        raise ModelError(f"{' and '.join(names)} share a parameter", "effects with none in common, each once")
    return out


def add_effects(
    model: Model,
    observations: Observations,
    names: Sequence[str],
    *,
    plane: Plane | None = None,
    held: Sequence[str] = (),
    start: Floats | None = None,
    starts: int = 8,
    progress: Callable[[float], None] | None = None,
) -> Addition:
    """Free the best form of each named effect and refit everything.

    Scatter from case to case, noise that plateau and tare do not show, and cases that stand apart are as the readings
    have them whatever acts: with all candidates free, so that what is missing does not count as scatter. An added
    effect has the error of form that a diagnosis finds. Budget, anatomy and an assumed noise are as stated.

    Args:
        model: with those effects at their null.
        observations: of the session.
        names: of effects or candidates; none refits what is held.
        plane: of the forces that count; by default what the finger's axes can predict.
        held: parameters of effects that the model has already.
        start: (parameters,) of an earlier fit, one more start of the final refit.
        starts: of the final refit besides.
        progress: called with the fraction that is done.

    Raises:
        ModelError: names that cannot be added, to this model or together.
    """
    session = session_of(model, observations, plane, held)
    sagittal = session.plane == "sagittal"
    candidates = Candidates.of(model, sagittal=sagittal, held=held)
    explanations = _explanations(model, names, candidates, sagittal=sagittal) if names else []
    # An earlier fit changes nothing of what is minimised: a refit of a refitted model stays where it is.
    beginner = Beginner(session, candidates, progress=progress)
    begun = beginner.all_out(beginner.grossly())
    fitter, base = begun.fitter, begun.nothing
    found = [
        fitter.fit(explanation, begin, base.best, base.bad, log_prior=0.0)
        for explanation in explanations
        for begin in (base.expected(explanation, base.best), session.problem.centre)
    ]
    best = max(found, key=lambda fit: fit.log_posterior, default=base)
    values, apart = fitter.hyper.values(begun.plain), tuple(observations.ids[case] for case in sorted(base.bad))
    sizes = values.errors._asdict() | values.groups._asdict()
    noise = sizes.pop("noise")
    errors = ReadingErrors(extra_noise_N=None if observations.noise_assumed else noise, not_counted=apart, **sizes)
    recipes = [Recipe.of(fit, (*begun.plain, *fit.best[FORMS:])) for fit in dict.fromkeys([best, base])]
    fits = list[Fit]()
    for recipe in recipes:
        fit = refit_map(
            recipe.problem(model, observations, plane, held),
            start=np.array(recipe.about),
            also=[] if start is None else [start],
            starts=starts,
            progress=None if progress is None else _from(beginner.share, len(fits), len(recipes), progress),
            errors=errors,
        )
        fits.append(fit)
    if best is base:
        return Addition(fits[0], None, (), None, recipes[0])
    gain = best.log_posterior - fitter.log_evidence_without_smooth(base)
    return Addition(fits[0], fits[1], best.explanation.names, gain, recipes[0])


def _from(begun: float, number: int, count: int, progress: Callable[[float], None]) -> Callable[[float], None]:
    """Return what is told the fraction done of one of some parts, where a share was done before them."""
    return lambda done: progress(begun + (1.0 - begun) * (number + done) / count)
