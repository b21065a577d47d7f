"""The posterior of one session: evidence against dense algebra, and statements read off marginals."""

from __future__ import annotations

import gc
import weakref
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import logsumexp

from fingermodel.diagnosis.posterior.fitting import Fitter
from fingermodel.diagnosis.posterior.hyper import (
    ACTING,
    ANATOMY,
    BUDGET,
    FORMS,
    GROUP,
    GROUPS,
    SCATTER,
    SMOOTH,
    Hyperparameters,
)
from fingermodel.diagnosis.posterior.marginals import Entry, Posterior, Promise
from fingermodel.diagnosis.posterior.optimum import Optimum
from fingermodel.diagnosis.session_model.candidates import NOTHING, Candidates, Explanation
from fingermodel.diagnosis.session_model.session import session_of
from fingermodel.diagnosis.settings import EVIDENCE_POWER, FORM_NAMED, OF_GROUP
from fingermodel.diagnosis.verdict.far_off import beyond_priors, far_off, remarkable
from fingermodel.diagnosis.verdict.predictive import predicted
from fingermodel.session import Session
from tests.fingermodel.diagnosis.dense import dense, dense_of_all

Floats = NDArray[np.float64]


@pytest.fixture(scope="module")
def fitter() -> Fitter:
    bench = Session.open("DEV-02")
    session = session_of(bench.model, bench.observations)
    return Fitter(session, Candidates.of(bench.model), Hyperparameters.of(session))


@pytest.fixture(scope="module")
def nothing(fitter: Fitter) -> Optimum:
    return fitter.fit(NOTHING, fitter.session.problem.centre, fitter.hyper.start(0))


def single(fitter: Fitter, name: str) -> Explanation:
    return next(e for e in fitter.candidates.singles if e.names == (name,))


@pytest.fixture(scope="module")
def hanger(fitter: Fitter, nothing: Optimum) -> Optimum:
    explanation = single(fitter, "hanger_mass")
    return fitter.fit(explanation, nothing.expected(explanation, nothing.best), nothing.best)


@pytest.fixture(scope="module")
def sheath(fitter: Fitter, nothing: Optimum) -> Optimum:
    explanation = single(fitter, "sheath_friction")
    return fitter.fit(explanation, nothing.expected(explanation, nothing.best), nothing.best)


@pytest.mark.parametrize(
    "axes",
    [
        (0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0),
        (4, 1, 0, 0, 0, 2, 3, 0, 0, 0, 0, 0, 0, 0, 3, 0, 0, 0, 0),
        (2, 0, 1, 2, 2, 0, 2, 2, 2, 2, 2, 2, 2, 2, 0, 4, 3, 2, 1),
        (2, 0, 0, 0, 0, 0, 2, 0, 0, 0, 0, 0, 0, 0, 4, 0, 3, 0, 9),
        (2, 0, 1, 2, 2, 0, 2, 2, 2, 2, 2, 2, 2, 2, 0, 5, 0, 0, 2),
        (2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 3, 4, 3, 2, 12),
    ],
)
def test_evidence_is_that_of_the_dense_gaussian(nothing: Optimum, axes: tuple[int, ...]) -> None:
    y, covariance = dense(nothing, axes)
    expected = -0.5 * y @ np.linalg.solve(covariance, y) - 0.5 * np.linalg.slogdet(covariance)[1]
    assert nothing.freed(axes).log_evidence == pytest.approx(expected, abs=1e-4)


# Under what it was fitted: as the readings have it, or more noise and scatter, beside which slopes are not so steep.
@pytest.mark.parametrize(("slope", "noisy"), [(1e5, False), (2e3, True)])
def test_the_steepest_slopes_leave_the_misfit_that_they_have(nothing: Optimum, slope: float, noisy: bool) -> None:
    # As about a pose in which a joint's Jacobian is nearly singular: readings move along one direction, and far.
    own = np.concatenate([nothing.parameters_of["budget"], nothing.parameters_of["anatomy"]])
    rng, slopes = np.random.default_rng(1), nothing.slopes.copy()
    slopes[:, own] += slope * np.outer(rng.normal(size=len(slopes)), rng.normal(size=len(own)))
    # The anatomy spreads as widely as it may.
    widest = len(nothing.hyper.axes[ANATOMY].values) - 1
    node = (0, 0, 0, 0, 0, 0, widest, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0)
    most = [len(axis.values) - 1 for axis in nothing.hyper.axes]
    steep = replace(nothing, slopes=slopes, node=(*most[:BUDGET], *node[BUDGET:]) if noisy else node)
    names = steep.acting(node)
    columns, residual = steep.whitened_at(names, node)
    widths, places = steep.widths(names, node), steep.places(names)
    right = np.concatenate([residual + columns @ places, np.zeros(len(widths))])
    stacked = np.concatenate([columns * widths, np.eye(len(widths))])
    best = np.linalg.lstsq(stacked, right, rcond=None)[0]
    assert steep.misfit(node) == pytest.approx(float(((right - stacked @ best) ** 2).sum()), rel=1e-5)


def test_the_misfit_is_that_of_the_dense_gaussian(nothing: Optimum) -> None:
    y, covariance = dense(nothing, nothing.node)
    assert nothing.misfit(nothing.node) == pytest.approx(float(y @ np.linalg.solve(covariance, y)), rel=1e-6)


def test_validation_readings_are_predicted_as_by_the_dense_gaussian(hanger: Optimum) -> None:
    session, node = hanger.session, (*hanger.best[:SMOOTH], 3, 0, 2, 0, 0, *hanger.best[FORMS:])
    fitted, (left, covariance) = session.fitted, dense_of_all(hanger, node)
    # Some tares are of fitted and of validation cases.
    assert np.any(session.changes.tares[fitted].any(axis=0) & session.changes.tares[~fitted].any(axis=0))
    weight = np.linalg.solve(covariance[np.ix_(fitted, fitted)], covariance[np.ix_(fitted, ~fitted)])
    found, of_form = predicted(hanger, node), FORM_NAMED * hanger.form_errors_unseen
    np.testing.assert_allclose(found.away, left[~fitted] - weight.T @ left[fitted], rtol=1e-5, atol=1e-6)
    expected = covariance[np.ix_(~fitted, ~fitted)] - covariance[np.ix_(~fitted, fitted)] @ weight
    np.testing.assert_allclose(found.covariance, expected + of_form @ of_form.T, rtol=1e-4, atol=1e-7)


def test_other_readings_have_the_likelihood_of_the_dense_gaussian(nothing: Optimum) -> None:
    other = np.random.default_rng(9).normal(size=len(nothing.residual))
    same, changed = nothing.log_joints_of(np.array([nothing.residual, nothing.residual + other]).T, nothing.node)
    y, covariance = dense(nothing, nothing.node)
    before, after = (away @ np.linalg.solve(covariance, away) for away in (y, y + other))
    assert same == pytest.approx(nothing.log_joint(nothing.node), abs=1e-6)
    assert changed - same == pytest.approx(0.5 * (before - after), rel=1e-6)


@pytest.mark.parametrize(
    "axes",
    [
        (0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0),
        (4, 1, 1, 2, 2, 2, 3, 2, 2, 2, 2, 2, 2, 2, 3, 2, 0, 0, 0),
    ],
)
def test_further_columns_are_informed_beside_all_that_acts(nothing: Optimum, axes: tuple[int, ...]) -> None:
    columns = np.random.default_rng(8).normal(size=(len(nothing.residual), 3))
    said = nothing.quadratic_of(columns, axes)
    information, score = said.hessian, said.gradient
    single, own = nothing.asked(columns, axes)
    np.testing.assert_allclose(np.diag(information), single, rtol=1e-6)
    np.testing.assert_allclose(score, own, rtol=1e-6, atol=1e-6 * np.abs(own).max())
    np.testing.assert_allclose(information, information.T, atol=1e-9 * information.max())


@pytest.mark.parametrize("spread", [1.0, 3.0])
def test_cases_are_left_out_as_the_dense_gaussian_leaves_them_out(nothing: Optimum, spread: float) -> None:
    node, cases = (4, 1, 0, 0, 0, 2, 3, 0, 0, 0, 0, 0, 0, 0, 3, 2, 0, 0, 0), nothing.session.fitted_noise.cases
    column = 0.01 * np.random.default_rng(5).normal(size=len(cases))

    def log_density(column: Floats) -> float:
        y, covariance = dense(nothing, node)
        covariance = spread**2 * covariance + np.outer(column, column)
        precision = np.linalg.inv(covariance)
        away, out = precision @ y, 0.0
        for case in np.unique(cases):
            own = np.flatnonzero(cases == case)
            block = precision[np.ix_(own, own)]
            out += 0.5 * np.linalg.slogdet(block)[1] - 0.5 * away[own] @ np.linalg.solve(block, away[own])
        return float(out)

    found = nothing.left_out_gains(column[:, None], node, spread)[0]
    assert found == pytest.approx(log_density(column) - log_density(0.0 * column), abs=1e-4)


def test_the_true_effect_is_far_more_probable(nothing: Optimum, hanger: Optimum, sheath: Optimum) -> None:
    assert hanger.log_posterior > nothing.log_posterior + 50.0
    assert hanger.log_posterior > sheath.log_posterior + 50.0


def test_a_promise_comes_near_what_a_fit_finds(fitter: Fitter, nothing: Optimum, hanger: Optimum) -> None:
    promised = nothing.promises([hanger.explanation], [nothing.best, fitter.hyper.without_smooth(nothing.best)])[0]
    assert promised + hanger.log_prior == pytest.approx(hanger.log_posterior, abs=0.25 * hanger.log_posterior)
    # About its own optimum the promise is what it has, but for the sum over hyperparameters.
    own = hanger.promises([hanger.explanation], [hanger.best])[0] + hanger.log_prior
    assert own <= hanger.log_posterior + 1e-6
    assert own > hanger.log_posterior - 3.0


def test_a_promise_counts_with_what_acts_unnamed_where_it_was_made(
    fitter: Fitter, nothing: Optimum, hanger: Optimum
) -> None:
    host = replace(nothing)
    host.__dict__["best"] = nothing.hyper.with_smooth(nothing.best)
    unnamed = host.hyper.smooth_newton(host.best)
    of_hanger = Promise.of(hanger.explanation, host, nothing.log_posterior, hanger.log_prior)
    assert (of_hanger.named, of_hanger.beyond_newton) == (frozenset({"hanger_mass"}), unnamed)
    assert unnamed > 0.0
    nodes = {NOTHING: {host.best: nothing.log_posterior}}
    assert Posterior.of({NOTHING: host}, {hanger.explanation: of_hanger}, nodes).p_beyond == pytest.approx(1.0)
    # Beside a hanger nothing is left to explain, so what is promised there acts by its name.
    both = fitter.candidates.joined((*hanger.explanation.members, *single(fitter, "sheath_friction").members))
    assert both is not None
    beside = Promise.of(both, hanger, hanger.log_posterior - 1.0, hanger.log_prior)
    assert (beside.named, beside.beyond_newton) == (frozenset({"hanger_mass", "sheath_friction"}), 0.0)


def test_a_sound_case_is_not_suspected_and_a_spoilt_one_is(fitter: Fitter, hanger: Optimum) -> None:
    odds = hanger.log_odds_bad(hanger.best)
    assert max(odds.values()) < 5.0
    case = next(iter(odds))
    rows = hanger.session.fitted_noise.cases == case
    spoilt = fitter.linearised(hanger.explanation, hanger.theta, hanger.best, frozenset(), hanger.log_prior)
    spoilt.residual[rows] += 0.5
    worst = spoilt.log_odds_bad(hanger.best)
    assert max(worst, key=lambda c: worst[c]) == case
    assert worst[case] > 20.0


def test_probabilities_sum_to_one(nothing: Optimum, hanger: Optimum, sheath: Optimum) -> None:
    fits = {f.explanation: f for f in (nothing, hanger, sheath)}
    posterior = Posterior.of(fits, {})
    assert sum(e.probability for e in posterior.entries) == pytest.approx(1.0)
    assert sum(posterior.of_explanations().values()) == pytest.approx(1.0)
    assert posterior.inclusion["hanger_mass"] > 0.99
    assert posterior.leader is hanger


def of_structures(fit: Optimum) -> dict[tuple[str, ...], tuple[float, float]]:
    """Log prior and log evidence of an explanation with what is smooth, and of whom."""
    nodes: dict[tuple[str, ...], list[tuple[int, ...]]] = {}
    for node in fit.nodes:
        nodes.setdefault(tuple(fit.hyper.smooth_blocks(node)), []).append(node)
    out = {}
    for blocks, some in nodes.items():
        prior = fit.log_prior + fit.hyper.log_prior_of_smooth(some[0])
        out[blocks] = prior, float(logsumexp([fit.nodes[n] for n in some])) - prior
    return out


def test_the_prior_counts_in_full_and_the_evidence_to_a_power(hanger: Optimum, nothing: Optimum) -> None:
    posterior = Posterior.of({f.explanation: f for f in (nothing, hanger)})
    found: dict[object, float] = {}
    for entry in posterior.entries:
        assert entry.fit is not None
        assert entry.node is not None
        key = entry.fit, tuple(entry.fit.hyper.smooth_blocks(entry.node))
        found[key] = found.get(key, 0.0) + entry.probability
    expected = {
        (fit, blocks): prior + EVIDENCE_POWER * evidence
        for fit in (nothing, hanger)
        for blocks, (prior, evidence) in of_structures(fit).items()
    }
    assert len(expected) > 2
    least = max(expected, key=lambda k: expected[k])
    for key, value in expected.items():
        assert np.log(found[key] / found[least]) == pytest.approx(value - expected[least], rel=1e-9)


def test_a_law_that_is_off_by_more_than_a_tenth_is_not_named(hanger: Optimum, nothing: Optimum) -> None:
    index = int(np.argmax(hanger.hyper.form.values > FORM_NAMED))
    off = (*hanger.best[:-1], index)
    fits = {hanger.explanation: hanger, NOTHING: nothing}
    other = Posterior.of(fits, nodes={hanger.explanation: {off: 0.0}, NOTHING: nothing.nodes})
    entry = next(e for e in other.entries if e.node == off)
    assert not entry.named
    assert entry.beyond_newton > 0.0


def test_of_a_change_counts_what_neither_anatomy_nor_budget_could_do(nothing: Optimum) -> None:
    fitted = nothing.session.fitted
    names = [n for n in nothing.acting(nothing.best) if n in (*ACTING, *GROUPS)]
    blocks = np.concatenate([nothing.block(n, fitted, nothing.slopes) for n in names], axis=1)
    columns = np.concatenate(
        [nothing.session.changes.tares[fitted], blocks * nothing.widths(names, nothing.best)], axis=1
    )
    of_case = nothing.whitening(nothing.best).of_case
    for one in columns.T[[0, len(columns.T) // 2, -1]]:
        information = float((of_case(one) ** 2).sum())
        assert nothing.own_shares([one[:, None]])[0] ** 2 <= 1.0 / (1.0 + information) + 1e-9
    # What their readings could not be at all is wholly its own.
    whitened = of_case(np.column_stack([columns, np.eye(len(columns))]))
    apart = np.linalg.svd(whitened[:, : len(columns.T)])[0][:, -1]
    other = np.linalg.solve(whitened[:, len(columns.T) :], apart)
    assert nothing.own_shares([other[:, None]]) == pytest.approx([1.0], abs=1e-6)
    assert nothing.own_shares([0.0 * other[:, None]]) == [0.0]


def test_an_effect_that_anatomy_undoes_is_not_named_beside_something_smooth(hanger: Optimum, nothing: Optimum) -> None:
    (name,) = hanger.explanation.names
    smooth = (*hanger.best[:SMOOTH], 0, 0, 2, 0, 0, *hanger.best[FORMS:])
    fits = {hanger.explanation: hanger, NOTHING: nothing}

    def named(fit: Optimum) -> frozenset[str]:
        told = Posterior.of(
            {**fits, hanger.explanation: fit}, nodes={hanger.explanation: {smooth: 0.0}, NOTHING: nothing.nodes}
        )
        return next(e.named for e in told.entries if e.node == smooth)

    assert named(hanger) == {name}
    assert hanger.sizes_newton[name] > hanger.hyper.smooth_newton(smooth) > 0.0
    undone = replace(hanger)
    undone.__dict__["own_newton"] = {name: 0.5 * hanger.own_smooth_newton(smooth)}
    assert named(undone) == frozenset()
    # Nor one of which less is left than its form may be wrong by; where nothing unknown acts, that is enough.
    nearly, least = replace(hanger), FORM_NAMED * hanger.sizes_newton[name]
    assert hanger.own_smooth_newton(smooth) < 0.9 * least
    nearly.__dict__["own_newton"] = {name: 0.9 * least}
    assert named(nearly) == frozenset()
    assert nearly.named(hanger.hyper.without_smooth(smooth))[0] == {name}


def test_a_fit_is_let_go_as_soon_as_nobody_asks_for_it(fitter: Fitter) -> None:
    # Its columns are many megabytes; the garbage collector might come late.
    fit = fitter.fit(NOTHING, fitter.session.problem.centre, fitter.hyper.usual)
    assert fit.nodes
    assert fit.named(fit.best)
    known = weakref.ref(fit)
    gc.disable()
    try:
        del fit
        assert known() is None
    finally:
        gc.enable()


@pytest.mark.parametrize(
    ("times", "said"), [(0.0, ""), (4.0, ""), (-20.0, "zero.tip.y would have to be off by 20 times")]
)
def test_one_error_far_beyond_what_the_rig_states_is_no_small_error(hanger: Optimum, times: float, said: str) -> None:
    """The misfit of all readings hides it among hundreds of others."""
    problem = hanger.session.problem
    at, theta = problem.model.parameters.index["zero.tip.y"], problem.centre.copy()
    theta[at] += times * problem.scale[at]
    assert far_off(hanger.but(theta=theta)).startswith(said)
    assert bool(far_off(hanger.but(theta=theta))) is bool(said)


def test_an_error_of_the_rig_that_one_in_many_has_is_remarked_though_the_verdict_stands(hanger: Optimum) -> None:
    problem = hanger.session.problem
    at, theta = problem.model.parameters.index["zero.tip.y"], problem.centre.copy()
    assert [s for s in remarkable(hanger.but(theta=theta)) if "would have to be off" in s] == []
    theta[at] += 4.0 * problem.scale[at]
    assert "zero.tip.y would have to be off by 4 times what is stated, or usual" in remarkable(hanger.but(theta=theta))
    assert far_off(hanger.but(theta=theta)) == ""


@pytest.mark.parametrize(("off", "said"), [(0.01, ""), (0.15, "one error (error of each weight) would have to be")])
def test_one_weight_far_beyond_a_usual_one_is_no_small_error(hanger: Optimum, off: float, said: str) -> None:
    session, node = hanger.session, list(hanger.hyper.start(len(hanger.best) - FORMS))
    node[GROUP] = int(np.searchsorted(OF_GROUP.values, OF_GROUP.scale))
    weights = session.columns("weight")[session.fitted]
    moved = hanger.residual + off * weights[:, int(np.argmax((weights**2).sum(axis=0)))]
    assert far_off(replace(hanger.but(residual=moved), node=tuple(node))).startswith(said)
    assert bool(far_off(replace(hanger.but(residual=moved), node=tuple(node)))) is bool(said)


def test_one_part_of_the_specimen_far_beyond_all_others_is_no_small_difference(hanger: Optimum) -> None:
    """A finger that differs throughout, by three times what is stated, is one; a single tendon far off is none."""
    table = hanger.session.model.parameters
    anatomy = np.flatnonzero(table.of_kind("anatomy") & (table.sd > 0.0))
    throughout = 3.0 * np.random.default_rng(3).standard_normal(len(anatomy))
    assert far_off(hanger.but(residual=hanger.residual + hanger.slopes[:, anatomy] @ throughout)) == ""
    one = table.index["point.PIP.FDS.proximal.y"]
    said = far_off(hanger.but(residual=hanger.residual + 12.0 * hanger.slopes[:, one]))
    assert said.startswith("FDS at the PIP (a moment arm of ")
    share = far_off(hanger.but(residual=hanger.residual + 12.0 * hanger.slopes[:, table.index["fraction.EDC_ES"]]))
    assert share.startswith("fraction.EDC_ES would have to differ")


@pytest.mark.parametrize(
    ("axis", "said"),
    [(ANATOMY, "the largest spread of anatomy"), (BUDGET, "the largest budget"), (SCATTER, "the largest scatter of")],
)
def test_readings_that_want_all_that_is_thought_possible_say_that_something_else_acts(
    hanger: Optimum, axis: int, said: str
) -> None:
    most = list(hanger.best)
    assert beyond_priors(hanger) == ""
    most[axis] = len(hanger.hyper.axes[axis].values) - 1
    assert said in beyond_priors(cast("Optimum", SimpleNamespace(hyper=hanger.hyper, best=tuple(most))))


def test_what_is_off_in_its_form_is_not_the_known_thing(fitter: Fitter, nothing: Optimum) -> None:
    outside = next(e for e in fitter.candidates.singles if e.members[0].candidate.outside)
    right, off = (replace(nothing, explanation=outside).off_in_form((*nothing.best, k)) for k in (0, 5))
    assert list(right) == list(off) == list(outside.members)
    node = (*nothing.best[:FORMS], 0)
    known = Entry(outside, replace(nothing, explanation=outside), node, frozenset(), 0.1, 1.0)
    assert [c.name for c in known.known] == list(outside.names)
    assert replace(known, node=(*node[:FORMS], 4)).known == known.known
    assert replace(known, node=(*node[:FORMS], 5)).known == ()


def test_errors_that_no_fitted_case_shows_are_not_told(nothing: Optimum) -> None:
    """The published sessions read the bone in validation cases alone, so what is told of it would be the prior's."""
    bench = Session.open("synek2019_HMEAN")
    session = session_of(bench.model, bench.observations)
    fitter = Fitter(session, Candidates.of(bench.model, sagittal=True), Hyperparameters.of(session))
    fit = fitter.fit(NOTHING, session.problem.centre, fitter.hyper.start(0))
    of_bone = {"line_rad", "apart_rad"}
    assert of_bone <= Posterior.of({NOTHING: nothing}).other_scatter.keys(), "DEV-02 has fitted cases at the bone"
    told = Posterior.of({NOTHING: fit}).other_scatter.keys()
    assert told >= {"component", "angle_rad", "weight", "turn_rad"}
    assert not told & of_bone
