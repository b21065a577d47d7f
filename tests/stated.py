"""Problems with the errors of the readings as they are stated, for tests of the solver and of programs."""

from __future__ import annotations

from collections.abc import Collection

from fingermodel.comparison.observations import Observations
from fingermodel.diagnosis.posterior.fitting import Fitter
from fingermodel.diagnosis.posterior.hyper import Hyperparameters
from fingermodel.diagnosis.session_model.candidates import NOTHING, Candidates
from fingermodel.diagnosis.session_model.session import session_of
from fingermodel.fingers import Plane
from fingermodel.fitting.problems import Problem
from fingermodel.model import Model


def stated_problem(
    model: Model, observations: Observations, plane: Plane | None = None, effects: Collection[str] = ()
) -> Problem:
    """All parameters at once with the budget's priors, the measured noise and the scatter most probable beforehand."""
    session = session_of(model, observations, plane, effects)
    hyper = Hyperparameters.of(session)
    return Fitter(session, Candidates(()), hyper).problem(NOTHING, hyper.start(0))
