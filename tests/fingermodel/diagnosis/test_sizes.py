"""How much an explanation changes the readings, in newtons or in newton millimetres."""

from __future__ import annotations

from fingermodel.diagnosis.posterior.fitting import Fitter
from fingermodel.diagnosis.posterior.hyper import Hyperparameters
from fingermodel.diagnosis.posterior.optimum import Optimum
from fingermodel.diagnosis.session_model.candidates import NOTHING, Candidates
from fingermodel.diagnosis.session_model.session import session_of
from fingermodel.session import Session


def test_what_mostly_changes_moments_has_a_size_in_newton_millimetres() -> None:
    bench = Session.open("DEV-02")
    session = session_of(bench.model, bench.observations)
    fitter = Fitter(session, Candidates.of(bench.model), Hyperparameters.of(session))
    problem, node = session.problem, fitter.hyper.start(0)

    def acting(name: str) -> Optimum:
        explanation = next(e for e in fitter.candidates.singles if e.names == (name,))
        theta = problem.centre.copy()
        theta[list(explanation.parameters)] += 0.5 * problem.scale[list(explanation.parameters)]
        return fitter.linearised(explanation, theta, node, frozenset(), 0.0)

    elsewhere, hanger = acting("tip_location"), acting("hanger_mass")
    assert elsewhere.newton_mm > 10.0 * elsewhere.newton > 0.0
    assert (hanger.newton_mm, hanger.newton > 0.0) == (0.0, True)
    assert fitter.linearised(NOTHING, problem.centre, node, frozenset(), 0.0).newton_mm == 0.0
