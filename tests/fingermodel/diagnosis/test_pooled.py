"""What several sessions share: sizes put together, and a verdict where only probabilities speak."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fingermodel.diagnosis.posterior.gaussian import Quadratic
from fingermodel.diagnosis.session_model.candidates import Candidate, Explanation, Member
from fingermodel.diagnosis.several_sessions.several_verdict import (
    InSession,
    PooledVerdict,
    SharedEffect,
    judge_together,
)
from fingermodel.parameters import two_sided
from tests.settings import load_profile

load_profile()

SESSIONS = ("A", "B", "C")


@given(
    information=st.floats(0.1, 50.0), at=st.floats(-3.0, 3.0), further=st.floats(0.1, 50.0), other=st.floats(-3.0, 3.0)
)
def test_one_size_for_two_sessions_is_worth_what_bayes_rule_says(
    information: float, at: float, further: float, other: float
) -> None:
    both = Quadratic(0.0, np.array([information * at + further * other]), np.array([[information + further]]), 0.0)
    # Bayes' rule: the evidence of both readings of one number, with its prior N(0, 1).
    grid = np.linspace(-12.0, 12.0, 40001)
    density = np.exp(-0.5 * grid**2) / np.sqrt(2.0 * np.pi)
    log_likelihood = sum(p * (v * grid - 0.5 * grid**2) for p, v in ((information, at), (further, other)))
    exact = np.log(np.sum(density * np.exp(log_likelihood)) * (grid[1] - grid[0]))
    assert both.freed(np.ones(1), np.zeros(1), 1).log_evidence == pytest.approx(exact, abs=1e-6)


def session(kind: str = "undecided", names: tuple[str, ...] = (), cases: int = 20) -> Any:
    """A session's own diagnosis, as far as a verdict on several asks for it."""
    observations = SimpleNamespace(roles=("identification",) * cases + ("validation",) * 5)
    return SimpleNamespace(
        verdict=SimpleNamespace(kind=kind, names=names), session=SimpleNamespace(observations=observations)
    )


def shared(
    names: tuple[str, ...],
    probability: float,
    owns: Sequence[tuple[str, ...] | None] = ((), (), ()),
    by_name: Sequence[float] = (1.0, 1.0, 1.0),
    one_size: bool = True,
) -> SharedEffect:
    members = tuple(Member(Candidate(n, n, ((k,),), 1.0)) for k, n in enumerate(names))
    each = tuple(
        InSession(20.0, np.array([0.5]), np.array([0.1]), own, right, cast("Any", None))
        for own, right in zip(owns, by_name, strict=True)
    )
    return SharedEffect(
        Explanation(members),
        (two_sided(f"{names[0]}.x", "mm", 1.0),),
        one_size,
        np.array([0.5]),
        np.array([0.1]),
        60.0,
        58.0,
        each,
        probability,
    )


def judged(
    ranking: Sequence[SharedEffect],
    diagnoses: Sequence[Any] | None = None,
    apart: tuple[float, float, float] = (0.0, 0.0, 0.0),
    rests_on: Sequence[str] = (),
) -> PooledVerdict:
    return judge_together(SESSIONS, diagnoses or [session()] * 3, ranking, apart, rests_on)


def test_what_is_shared_is_named_with_what_acts_beside_it() -> None:
    found = judged([shared(("rig",), 0.98, owns=((), ("own",), ()))], rests_on=("B",))
    assert (found.kind, found.names, found.rests_on) == ("found", ("rig",), ("B",))
    assert found.probability == pytest.approx(0.98)
    assert "rig.x = 0.5 ± 0.1 mm" in found.sentence
    assert found.sentence.endswith("Beside it acts own in B.")
    other = judged([shared(("rig",), 0.98, one_size=False)])
    assert "a size of its own in each" in other.sentence


def test_a_law_that_would_have_to_be_another_in_most_sessions_is_not_named() -> None:
    named = judged([shared(("a",), 0.99, by_name=(1.0, 1.0, 0.1))])
    assert named.names == ("a",)
    assert named.sentence.endswith("In C its law would have to be another.")
    found = judged([shared(("a",), 0.99, by_name=(1.0, 0.1, 0.1))])
    assert (found.kind, found.names) == ("undecided", ())
    assert any("another in most" in s for s in found.short)


def test_a_name_that_only_some_explanations_hold_is_sure_by_all_of_them_together() -> None:
    found = judged([shared(("a", "b"), 0.5), shared(("a",), 0.48)])
    assert (found.kind, found.names) == ("found", ("a",))
    assert found.probability == pytest.approx(0.98)
    undecided = judged([shared(("a",), 0.5)], apart=(0.5, 0.0, 0.0), rests_on=SESSIONS)
    assert (undecided.kind, undecided.rests_on) == ("undecided", ()), "nothing is found that could rest on any"


def test_few_cases_in_one_session_decide_nothing_together() -> None:
    found = judged([shared(("a",), 0.99)], [session(), session(cases=4), session()])
    assert (found.kind, found.names) == ("undecided", ())
    assert "B has fewer than" in found.sentence


@pytest.mark.parametrize(
    ("kinds", "kind"),
    [
        (("nothing_missing",) * 3, "nothing_missing"),
        (("none_of_catalogue",) * 3, "none_of_catalogue"),
        (("nothing_missing", "found", "none_of_catalogue"), "undecided"),
    ],
)
def test_where_nothing_is_shared_each_session_is_told_by_itself(kinds: tuple[str, ...], kind: str) -> None:
    diagnoses = [session(k, ("e",) if k == "found" else ()) for k in kinds]
    found = judged([shared(("a",), 0.01)], diagnoses, apart=(0.99, 0.8, 0.9))
    assert (found.kind, found.names) == (kind, ())
    if kind == "undecided":
        assert "in A nothing is missing; in B e acts; in C something acts" in found.sentence
