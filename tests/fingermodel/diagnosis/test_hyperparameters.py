"""Hyperparameters: priors are priors, and the nodes that matter are found."""

from __future__ import annotations

import numpy as np
import pytest

from fingermodel.diagnosis import settings
from fingermodel.diagnosis.posterior.hyper import (
    BUDGET,
    FAMILIES,
    GROUP,
    MOST_NODES,
    SCATTER,
    SMOOTH,
    STATED_FACTOR,
    Hyperparameters,
    Node,
    Steps,
    log_share,
)
from fingermodel.diagnosis.session_model.session import Session as SessionModel
from fingermodel.diagnosis.session_model.session import session_of
from fingermodel.session import Session


@pytest.fixture(scope="module")
def recorded() -> SessionModel:
    bench = Session.open("DEV-01")
    return session_of(bench.model, bench.observations)


@pytest.fixture(scope="module")
def published() -> SessionModel:
    bench = Session.open("synek2019_H01")
    return session_of(bench.model, bench.observations)


def test_every_axis_is_a_probability(recorded: SessionModel, published: SessionModel) -> None:
    for session in (recorded, published):
        hyper = Hyperparameters.of(session)
        for axis in (*hyper.axes, hyper.form):
            assert np.exp(axis.log_weight).sum() == pytest.approx(1.0)
            assert (np.diff(axis.values) > 0.0).all()


def test_priors_say_what_the_explanation_says(recorded: SessionModel) -> None:
    hyper = Hyperparameters.of(recorded)
    budget, form = hyper.axes[BUDGET], hyper.form
    assert np.exp(hyper.axes[SMOOTH].log_weight[0]) == pytest.approx(1.0 - settings.P_UNUSUAL / len(FAMILIES))
    assert np.exp(budget.log_weight[budget.values >= 2.8]).sum() == pytest.approx(0.1, abs=0.05)
    assert np.exp(form.log_weight[form.values > settings.FORM_NAMED]).sum() == pytest.approx(0.2, abs=0.06)


def test_all_that_a_bad_case_may_have_raised_is_asked_about_at_every_smaller_value(recorded: SessionModel) -> None:
    """Scatter that one bad case made hides it: only at some smaller value does it stand out."""
    hyper = Hyperparameters.of(recorded)
    raised = list(hyper.usual)
    raised[SCATTER], raised[GROUP] = 7, 3
    nodes = hyper.narrowed(tuple(raised))
    for axis in (SCATTER, GROUP):
        rest = (*raised[:axis], *raised[axis + 1 :])
        assert {n[axis] for n in nodes if (*n[:axis], *n[axis + 1 :]) == rest} == set(range(raised[axis] + 1))
    assert all(value <= most for node in nodes for value, most in zip(node, raised, strict=True))


def test_a_stated_scatter_is_believed_within_a_factor(published: SessionModel) -> None:
    axis = Hyperparameters.of(published).axes[SCATTER]
    stated = published.stated_scatter
    assert stated == pytest.approx(0.025)
    near = (axis.values > stated / STATED_FACTOR**2) & (axis.values < stated * STATED_FACTOR**2)
    assert np.exp(axis.log_weight[near]).sum() > 0.9


def test_where_nothing_is_smooth_nobody_carries_it(recorded: SessionModel) -> None:
    hyper = Hyperparameters.of(recorded)
    plain = hyper.usual
    smooth = hyper.with_smooth(plain)
    carried = hyper.with_carriers(smooth)
    assert {hyper.carrier(node) for node in carried} == set(hyper.carriers[1:])
    assert hyper.carrier(smooth) == ""
    # Carriers of what is smooth share one probability; of nothing there is none to share.
    each = [np.exp(hyper.log_prior(node) - hyper.log_prior(smooth)) for node in carried]
    assert sum(each) == pytest.approx(settings.P_UNUSUAL / (1.0 - settings.P_UNUSUAL))
    for node in carried:
        none = hyper.without_smooth(node)
        assert hyper.log_prior(none) == pytest.approx(hyper.log_prior(hyper.without_smooth(smooth)))
        assert not hyper.smooth_blocks(none)
        assert all(hyper.plainly(near) == near for near in [*hyper.neighbours(node), *hyper.returned(node)])
        # Tendons are in no order: none is a step from another, and each may give way to all.
        assert {hyper.carrier(near) for near in hyper.neighbours(node)} <= {"", hyper.carrier(node)}
        assert hyper.of_all(node) in hyper.returned(node)


def quadratic_hill(node: Node) -> float:
    return -0.7 * ((node[0] - 5) ** 2 + (node[1] - 2) ** 2)


def steps(node: Node) -> list[Node]:
    moves = [(1, 0), (-1, 0), (0, 1), (0, -1)]
    return [(node[0] + a, node[1] + b) for a, b in moves if 0 <= node[0] + a < 9 and 0 <= node[1] + b < 9]


def hill() -> Steps:
    return Steps(quadratic_hill)


def test_climbing_ends_on_top() -> None:
    assert hill().climbed((0, 8), (9, 9)) == (5, 2)


def test_what_is_left_out_is_improbable() -> None:
    every = np.array([quadratic_hill((i, j)) for i in range(9) for j in range(9)])
    found = np.array(list(hill().explored([(5, 2)], steps).values()))
    assert len(found) < len(every)
    assert np.exp(found).sum() == pytest.approx(np.exp(every).sum(), rel=0.01)


def test_of_many_nodes_that_are_hardly_less_probable_some_stand_for_the_rest() -> None:
    slopes = np.linspace(0.1, 1.2, 14)

    def flipped(node: Node) -> list[Node]:
        return [(*node[:k], 1 - node[k], *node[k + 1 :]) for k in range(len(node))]

    found = Steps(lambda node: -float(slopes @ np.array(node))).explored([(0,) * len(slopes)], flipped)
    assert len(found) < MOST_NODES + len(slopes)
    every = np.log1p(np.exp(-slopes)).sum()
    known = np.log(np.exp(list(found.values())).sum())
    assert known < every - 1.0
    assert known - log_share(found) == pytest.approx(every)
