"""What several sessions share: sizes put together, and a verdict where only probabilities speak."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from fingermodel.diagnosis.candidates import Explanation
from fingermodel.diagnosis.linear import Size
from fingermodel.diagnosis.pooled_verdict import PooledVerdict, judge_together
from fingermodel.diagnosis.shared import SharedEffect
from hypothesis import given
from hypothesis import strategies as st

from fingermodel.diagnosis.diagnose import UNTESTED
from fingermodel.parameters import two_sided

Names = tuple[str, ...] | None
SESSIONS = ("A", "B", "C")


@given(
    information=st.floats(0.1, 50.0), at=st.floats(-3.0, 3.0), further=st.floats(0.1, 50.0), other=st.floats(-3.0, 3.0)
)
def test_one_size_for_two_sessions_is_worth_what_bayes_rule_says(
    information: float, at: float, further: float, other: float
) -> None:
    def said(precision: float, value: float) -> Size:
        return Size(np.array([[precision]]), np.array([precision * value]))

    free = np.array([False])
    first, second = said(information, at), said(further, other)
    both = first + second
    # Bayes' rule: the evidence of both readings of one number, with its prior N(0, 1).
    grid = np.linspace(-12.0, 12.0, 40001)
    density = np.exp(-0.5 * grid**2) / np.sqrt(2.0 * np.pi)
    likelihood = np.exp(sum(s.score[0] * grid - 0.5 * s.information[0, 0] * grid**2 for s in (first, second)))
    exact = np.log(np.sum(density * likelihood) * (grid[1] - grid[0]))
    assert both.log_evidence(free) == pytest.approx(exact, abs=1e-6)


def session(kind: str = "undecided", names: tuple[str, ...] = (), roles: Sequence[str] | None = None) -> Any:
    """A session's own diagnosis, as far as a verdict on several asks for it."""
    held = SimpleNamespace(
        roles=roles or ("identification",) * 20 + ("validation",) * 5,
        case_covariance=np.tile(1e-4 * np.eye(6), (25, 1, 1)),
    )
    return SimpleNamespace(
        verdict=SimpleNamespace(kind=kind, names=names),
        problem=SimpleNamespace(observations=held, model=None),
        evidence=SimpleNamespace(nothing=None),
        validation_rmse=lambda _: None,
    )


def shared(
    names: tuple[str, ...],
    probability: float,
    owns: Sequence[Names] = ((), (), ()),
    gains: Sequence[float] = (20.0, 20.0, 20.0),
    value: float = 0.5,
    same: bool = True,
    another_law: Sequence[bool] = (False, False, False),
) -> SharedEffect:
    each = tuple(
        SimpleNamespace(
            gain=gain,
            values=np.array([value]),
            sd=np.array([0.1]),
            beside=SimpleNamespace(
                own=own, weighed=SimpleNamespace(fitted=SimpleNamespace(theta=None), may_be_another_law=off)
            ),
        )
        for own, gain, off in zip(owns, gains, another_law, strict=True)
    )
    return SharedEffect(
        Explanation(names, names, (0,)),
        (two_sided(f"{names[0]}.x", "mm", 1.0),),
        names if same else (),
        np.array([value]),
        np.array([0.1]),
        float(sum(gains)),
        float(sum(gains)),
        cast("Any", each),
        0.0,
        probability,
    )


def judged(
    ranking: Sequence[SharedEffect],
    diagnoses: Sequence[Any] | None = None,
    apart: tuple[float, float, float] = (0.0, 0.0, 0.0),
    without: Sequence[tuple[tuple[str, ...], float]] = (),
) -> PooledVerdict:
    return judge_together(SESSIONS, diagnoses or [session()] * 3, ranking, apart, without)


@pytest.fixture(autouse=True)
def _without_predictions(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fingermodel.diagnosis.pooled_verdict._held_out", lambda *_: None)


def test_what_is_shared_is_named_with_what_acts_beside_it() -> None:
    ranking = [shared(("rig",), 0.98, owns=(("vague",), ("own",), None))]
    found = judged(ranking, [session(), session("found", ("rig", "own")), session()])
    assert (found.kind, found.names) == ("found", ("rig",))
    assert "of one size in all sessions" in found.sentence
    assert "acts perhaps vague in A; own in B;" in found.sentence
    assert "something that no effect here describes in C" in found.sentence


def test_what_stands_in_few_sessions_only_beside_something_unknown_is_not_named() -> None:
    found = judged([shared(("rig",), 0.98, owns=((), None, None))])
    assert (found.kind, found.names) == ("none_of_catalogue", ())
    assert "in B and C" in found.sentence


@pytest.mark.parametrize(
    ("named", "kept"),
    [((("a", "b"), ("a", "b"), ("a",)), ("a", "b")), ((("a", "b"), ("a",), ("a",)), ("a",))],
)
def test_a_second_shared_effect_needs_sessions_that_name_it_by_themselves(
    named: tuple[tuple[str, ...], ...], kept: tuple[str, ...]
) -> None:
    ranking = [shared(("a", "b"), 0.97), shared(("a",), 0.03)]
    found = judged(ranking, [session("found", names) for names in named])
    assert (found.kind, found.names) == ("found", kept)


def test_an_effect_with_sizes_of_its_own_must_show_in_every_session() -> None:
    effect = shared(("a",), 0.99, gains=(200.0, 20.0, 0.5), same=False)
    found = judged([effect])
    assert found.kind == "undecided"
    assert any("does not show in C" in s for s in found.short)
    assert judged([shared(("a",), 0.99, gains=(200.0, 20.0, 0.5))]).kind == "found"


def test_a_finding_needs_a_believable_size_and_cases_to_test_it() -> None:
    assert any("outside what is plausible" in s for s in judged([shared(("a",), 0.99, value=2.0)]).short)
    assert judged([shared(("a",), 0.99, another_law=(True, False, False))]).kind == "found"
    off = judged([shared(("a",), 0.99, another_law=(True, True, False))])
    assert off.kind == "undecided"
    assert any("in A and B its law would have to be another" in s for s in off.short)
    untested = [session(roles=("identification",) * 20)] * 3
    found = judged([shared(("a",), 0.99)], untested)
    assert found.kind == "undecided"
    assert UNTESTED in found.short


def test_without_one_session_another_name_would_win_or_the_finding_rests_on_it() -> None:
    ranking = [shared(("a",), 0.99)]
    flipped = judged(ranking, without=((("a",), 0.0), (("b",), 5.0), (("a",), 0.0)))
    assert flipped.kind == "undecided"
    assert any("without B it would be b" in s for s in flipped.short)
    resting = judged(ranking, without=((("a",), 0.0), ((), 5.0), (("a", "b"), 9.0)))
    assert (resting.kind, resting.rests_on) == ("found", ("B",))


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


def test_two_that_are_alike_are_both_named() -> None:
    found = judged([shared(("a",), 0.5), shared(("b",), 0.48)], apart=(0.02, 0.0, 0.0))
    assert (found.kind, found.names) == ("one_of", ("a", "b"))
    assert judged([shared(("a",), 0.5)], apart=(0.5, 0.0, 0.0)).kind == "undecided"
