"""Slips as explanations: what they predict, and each case against all others."""

from __future__ import annotations

import numpy as np
import pytest

from fingermodel.diagnosis.posterior.fitting import Fitter
from fingermodel.diagnosis.posterior.hyper import Hyperparameters
from fingermodel.diagnosis.posterior.optimum import Optimum
from fingermodel.diagnosis.search.beginning import unlike_sound
from fingermodel.diagnosis.session_model.bad_cases import Apart, Explained, SlipsAbout
from fingermodel.diagnosis.session_model.candidates import NOTHING, Candidates
from fingermodel.diagnosis.session_model.session import session_of
from fingermodel.diagnosis.settings import SLIP_SHARES
from fingermodel.session import Session
from tests.fingermodel.diagnosis.dense import dense


@pytest.fixture(scope="module")
def nothing() -> Optimum:
    bench = Session.open("DEV-01")
    session = session_of(bench.model, bench.observations)
    fitter = Fitter(session, Candidates.of(bench.model), Hyperparameters.of(session))
    return fitter.fit(NOTHING, session.problem.centre, fitter.hyper.start(0))


def test_a_case_against_all_others_is_the_dense_gaussian(nothing: Optimum) -> None:
    node, session = nothing.best, nothing.session
    y, covariance = dense(nothing, node)
    case = int(session.fitted_noise.cases[40])
    own = np.flatnonzero(session.fitted_noise.cases == case)
    rest = np.flatnonzero(session.fitted_noise.cases != case)
    weights = np.linalg.solve(covariance[np.ix_(rest, rest)], covariance[np.ix_(rest, own)]).T
    found = nothing.left_out(node)[case]
    assert found.away == pytest.approx(y[own] - weights @ y[rest], abs=1e-5)
    expected = covariance[np.ix_(own, own)] - weights @ covariance[np.ix_(rest, own)]
    assert found.covariance == pytest.approx(expected, rel=1e-4, abs=1e-8)


def test_every_slip_says_something_else_than_the_entry(nothing: Optimum) -> None:
    slips = nothing.session.changes.slips
    observations = nothing.session.observations
    for case in range(0, len(observations.ids), 7):
        found = slips.of(case)
        tension = np.asarray(observations.inputs.tension)[case]
        for slip in found:
            same = np.allclose(slip.tension, tension) and slip.posture == observations.postures[case]
            moved = slip.location not in (None, observations.locations[case])
            assert not same or slip.sign != 1.0 or moved
        assert sum(s.share for s in found) <= 1.0 - SLIP_SHARES["anything"] - SLIP_SHARES["amount"] + 1e-9
        assert len({s.words for s in found}) == len(found)


def test_a_reading_of_another_entry_is_told_by_it(nothing: Optimum) -> None:
    session = nothing.session
    slips = session.changes.slips
    case = session.observations.ids.index("c056")
    apart = nothing.left_out(nothing.best)[case]
    asked = slips.of(case)
    changes = slips.changes([(case, s) for s in asked], nothing.theta)
    for slip, change in zip(asked, changes, strict=True):
        size = np.linalg.norm(change[apart.rows][:3])
        if slip.partner is not None or size < 0.3:
            continue
        moved = Apart(case, apart.rows, change[apart.rows], apart.covariance, apart.anything, apart.tail)
        found = SlipsAbout(session.changes, nothing.theta).explain({case: moved}, 0.0)[case].slips
        own = next(chi_square for one, _, chi_square in found if one.words == slip.words)
        assert own == pytest.approx(0.0, abs=1e-9)
        assert all(chi_square < 25.0 for _, probability, chi_square in found if probability > 0.05)
        assert sum(probability for _, probability, _ in found) > 0.5


def test_cases_that_no_sound_one_is_like_are_no_slips_unless_a_slip_explains_them(nothing: Optimum) -> None:
    session = nothing.session
    fitted = np.unique(session.rows[session.fitted] // 6)
    of_set = [fitted[session.load_sets[fitted] == number].tolist() for number in np.unique(session.load_sets[fitted])]
    alike = min((cases for cases in of_set if len(cases) > 1), key=len)
    unknown, known = Explained(0.0, 1.0, ()), Explained(20.0, 1.0, ())
    assert unlike_sound(session, dict.fromkeys(alike, unknown)) == tuple(alike)
    assert unlike_sound(session, dict.fromkeys(alike, known)) == ()
    assert unlike_sound(session, dict.fromkeys(alike[1:], unknown)) == ()
    assert unlike_sound(session, {}) == ()


def test_cases_heavier_than_any_sound_one_of_their_tendons_are_no_slips_either(nothing: Optimum) -> None:
    session = nothing.session
    total, of_fitted = np.asarray(session.observations.inputs.tension).sum(axis=1), session.load_sets
    by_load = [session.fitted_cases[of_fitted[session.fitted_cases] == number] for number in np.unique(of_fitted)]
    cases = next(of_set for of_set in by_load if np.ptp(total[of_set]) > 0.2 * total[of_set].max())
    heaviest = cases[total[cases] > 0.99 * total[cases].max()].tolist()
    unknown = Explained(0.0, 1.0, ())
    assert unlike_sound(session, dict.fromkeys(heaviest, unknown)) == tuple(heaviest)
    lightest = cases[total[cases] < 1.01 * total[cases].min()].tolist()
    assert unlike_sound(session, dict.fromkeys(lightest, unknown)) == ()
