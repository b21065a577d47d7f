"""What a verdict needs: probability, a fit, a form and values that can be believed, cases that were never fitted."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from fingermodel.diagnosis.candidates import Candidate, Explanation
from fingermodel.diagnosis.evidence import Other, Weighed
from fingermodel.diagnosis.wildcard import FORM_ERRORS, Wildcard
from numpy.typing import NDArray

from fingermodel.diagnosis.confounding import confounding
from fingermodel.diagnosis.diagnose import enough
from fingermodel.diagnosis.verdict import LEAST_CASES, Verdict, inclusion, judge, strained
from fingermodel.parameters import one_sided
from tests.fingermodel.explained import candidates, straight
from tests.settings import load_profile

load_profile()
Floats = NDArray[np.float64]
Probability = dict[tuple[str, ...] | None, float]


def verdict_of(
    probability: Probability,
    each: float = 20.0,
    objective: float = 45.0,
    searched: tuple[Candidate, ...] = (),
    form_error: float = 0.1,
    held_out: dict[int, float] | None = None,
    left: tuple[tuple[str, ...], ...] = (),
    another_law: tuple[tuple[str, ...], ...] = (),
    impossible: tuple[tuple[str, ...], ...] = (),
    implausible: tuple[tuple[str, ...], ...] = (),
    together: float | None = None,
    counted: Probability | None = None,
) -> Any:
    """The verdict where only probabilities speak: everything fits, nothing is strained.

    `each` is the log evidence of each effect, `held_out` the error [N] of cases never fitted by the number of effects,
    `left` are explanations that leave too much, `another_law` those whose form is too far off, `impossible` those with
    a value far beyond its range, `implausible` those that leave more than noise would, `together` is what all at once
    leave, and `counted` is how probable all would be if the cases never fitted counted too.
    """
    model = SimpleNamespace(parameters=SimpleNamespace(parameters=(one_sided("e.size", "mm", 1.0),), names=("e.size",)))
    blocks = SimpleNamespace(case_covariance=np.tile(0.005**2 * np.eye(6), (10, 1, 1)))
    problem = SimpleNamespace(rows=np.arange(50), model=model, observations=blocks)
    fitted = SimpleNamespace(
        objective=objective, problem=problem, explanation=Explanation((), (), ()), theta=np.full(1, 9.0), x=np.zeros(0)
    )
    rows = []
    for names in probability:
        if names is not None:
            freed = (0,) if names in impossible else ()
            own = SimpleNamespace(**{**fitted.__dict__, "explanation": Explanation(names, names, freed)})
            rows.append(
                SimpleNamespace(
                    explanation=own.explanation,
                    fitted=own,
                    misfit=45.0,
                    plain_misfit=45.0,
                    implausible=names in implausible,
                    log_evidence=each * len(names),
                    form_error=form_error,
                    size_N=0.1,
                    budget_factor=1.0,
                    x_allowing=np.zeros(0),
                    leaves_too_much=lambda _, too_much=names in left: too_much,
                    may_be_another_law=names in another_law,
                    sd=lambda _: 0.1,
                )
            )
    nothing = next(r for r in rows if r.explanation.size == 0)
    evidence = SimpleNamespace(
        probability=probability,
        weighed=tuple(rows),
        nothing=nothing,
        other=Other(log_evidence=0.0, amplitude_N=0.1),
        together=together,
    )
    linear = straight(1, effects=4)
    return judge(
        cast("Any", problem),
        cast("Any", evidence),
        searched or candidates(4),
        confounding(linear, candidates(4)),
        lambda w: None if held_out is None else held_out[w.explanation.size],
        lambda: probability if counted is None else counted,
    )


@pytest.mark.parametrize(
    ("cases", "postures", "kept", "short"),
    [
        (LEAST_CASES - 1, 3, 40, "too few"),
        (LEAST_CASES, 1, 40, "one posture"),
        (LEAST_CASES, 2, 0, "kept from the fit"),
        (LEAST_CASES, 2, 1, None),
    ],
)
def test_a_few_cases_one_posture_or_none_kept_name_nothing(
    cases: int, postures: int, kept: int, short: str | None
) -> None:
    held = SimpleNamespace(
        roles=("identification",) * cases + ("validation",) * kept,
        postures=tuple(f"p{i % postures}" for i in range(cases)) + ("q",) * kept,
    )
    problem = cast("Any", SimpleNamespace(rows=np.arange(6 * cases), observations=held))
    found = enough(problem, Verdict("found", ("e0",), ("e0",), 0.97))
    assert found.kind == ("found" if short is None else "undecided")
    assert found.effects == (("e0",) if short is None else ())
    assert bool(found.short) == (short is not None)
    assert all(short in s for s in found.short if short)


@pytest.mark.parametrize(
    ("probability", "kind", "effects"),
    [
        ({("e0",): 0.97, (): 0.01, None: 0.02}, "found", ("e0",)),
        ({("e0", "e1"): 0.95, ("e0",): 0.03, (): 0.01, None: 0.01}, "found", ("e0", "e1")),
        ({("e0",): 0.5, ("e1",): 0.46, (): 0.02, None: 0.02}, "one_of", ("e0", "e1")),
        ({("e0",): 0.5, (): 0.48, None: 0.02}, "undecided", ()),
        ({("e0",): 0.02, (): 0.95, None: 0.03}, "nothing_missing", ()),
        ({("e0",): 0.15, (): 0.83, None: 0.02}, "undecided", ()),
        ({("e0",): 0.02, (): 0.01, None: 0.97}, "none_of_catalogue", ()),
        ({("e0",): 0.3, (): 0.05, None: 0.65}, "undecided", ()),
    ],
)
def test_a_verdict_needs_its_probability(probability: Probability, kind: str, effects: tuple[str, ...]) -> None:
    verdict = verdict_of(probability)
    assert (verdict.kind, verdict.effects) == (kind, effects)


@pytest.mark.parametrize(
    ("counted", "kind", "effects", "said"),
    [
        ({("e0", "e1"): 0.95, ("e0",): 0.05}, "found", ("e0", "e1"), None),
        # What the cases never fitted do not bear out is not named beside what they do.
        (
            {("e0", "e1"): 0.85, ("e0",): 0.15},
            "found",
            ("e0",),
            "e1 beside it is not certain: X 0.85 (and of e0 alone 0.15).",
        ),
        (
            {("e0", "e1"): 0.01, ("e0", "e2"): 0.99},
            "found",
            ("e0",),
            "e1 beside it is not certain: X 0.01 (and of e0 and e2 0.99).",
        ),
        # Where they bear none of it out, nothing is found.
        ({("e0", "e1"): 0.2, ("e2",): 0.8}, "undecided", (), "X 0.20 (and of e2 alone 0.80)"),
        ({("e0", "e1"): 0.1, (): 0.9}, "undecided", (), "X 0.10 (and of no effect 0.90)"),
        ({("e0", "e1"): 0.1, None: 0.9}, "undecided", (), "X 0.10 (and of something else 0.90)"),
    ],
)
def test_what_cases_never_fitted_speak_against_is_not_found(
    counted: Probability, kind: str, effects: tuple[str, ...], said: str | None
) -> None:
    probability: Probability = {("e0", "e1"): 0.95, ("e0",): 0.03, (): 0.01, None: 0.01}
    verdict = verdict_of(probability, counted=counted)
    assert (verdict.kind, verdict.effects) == (kind, effects)
    told = [s for s in (*verdict.reasons, *verdict.short) if "never fitted counted" in s]
    whole = (said or "").replace("X", "if the cases never fitted counted too, its probability would be")
    assert told == ([whole] if said else [])


def test_of_a_single_effect_what_else_would_be_likely_is_told() -> None:
    verdict = verdict_of({("e0",): 0.97, (): 0.02, None: 0.01}, counted={("e0",): 0.7, ("e0", "e1"): 0.1, (): 0.2})
    assert (verdict.kind, verdict.names) == ("undecided", ("e0",))
    assert verdict.short[0].endswith("its probability would be 0.80 (and of no effect 0.20)")


def test_what_is_left_without_a_doubted_companion_is_no_more_than_undecided() -> None:
    probability: Probability = {("e0", "e1"): 0.95, ("e0",): 0.03, (): 0.01, None: 0.01}
    counted: Probability = {("e0", "e1"): 0.5, ("e0", "e2"): 0.5}
    # Something acts beside it.
    verdict = verdict_of(probability, counted=counted, implausible=(("e0",),))
    assert (verdict.kind, verdict.names) == ("undecided", ("e0",))
    assert "e0 acts, but not alone: perhaps with e1" in verdict.short
    # By itself it foretells worse, or needs what is not plausible: that says nothing of the catalogue.
    for left in ({"held_out": {0: 0.1, 1: 0.3, 2: 0.05}}, {"impossible": (("e0",),)}, {"another_law": (("e0",),)}):
        verdict = verdict_of(probability, counted=counted, **cast("Any", left))
        assert (verdict.kind, verdict.names) == ("undecided", ("e0",)), left
        assert verdict.reasons[1].startswith("e1 beside it is not certain")
    # Where it was not weighed by itself, why the other was left out is told all the same.
    verdict = verdict_of({("e0", "e1"): 0.97, (): 0.02, None: 0.01}, counted=counted)
    assert (verdict.kind, verdict.names) == ("undecided", ("e0",))
    assert verdict.reasons[0].startswith("e1 beside it is not certain")


def test_cases_never_fitted_name_nothing_by_themselves() -> None:
    verdict = verdict_of({("e0",): 0.3, ("e1",): 0.05, (): 0.6, None: 0.05}, counted={("e0",): 1.0})
    assert (verdict.kind, verdict.effects) == ("undecided", ())


def test_a_companion_that_may_only_mend_the_form_is_not_named() -> None:
    probability: Probability = {("e0", "e1"): 0.95, ("e0",): 0.03, (): 0.01, None: 0.01}
    verdict = verdict_of(probability, each=6.0, objective=10_000.0)
    assert (verdict.kind, verdict.effects) == ("found", ("e0",))
    assert any(reason.startswith("e1 beside it") for reason in verdict.reasons)
    # A mass or an angle has no form to mend; nor is there one to mend where the whole misfit is small.
    exact = tuple(replace(c, constitutive=False) for c in candidates(4))
    assert verdict_of(probability, each=6.0, objective=10_000.0, searched=exact).effects == ("e0", "e1")
    assert verdict_of(probability, each=6.0, objective=1_000.0).effects == ("e0", "e1")
    # What noise alone would hardly leave needs its companion, little as that adds.
    assert verdict_of(probability, each=6.0, objective=10_000.0, implausible=(("e0",),)).effects == ("e0", "e1")
    # Nor does what only mends a form foretell the cases never fitted far better.
    for left, effects in ((0.06, ("e0",)), (0.12, ("e0", "e1"))):
        foretold = {0: 0.15, 1: left, 2: 0.05}
        assert verdict_of(probability, each=6.0, objective=10_000.0, held_out=foretold).effects == effects
    # A form that the readings show to be right within 2 % has little to mend.
    assert verdict_of(probability, each=6.0, objective=10_000.0, form_error=0.02).effects == ("e0", "e1")


def test_a_companion_that_foretells_worse_than_one_effect_alone_is_not_named() -> None:
    probability: Probability = {("e0", "e1"): 0.95, ("e0",): 0.03, (): 0.01, None: 0.01}
    worse, hardly = {0: 0.15, 1: 0.05, 2: 0.09}, {0: 0.15, 1: 0.05, 2: 0.06}
    verdict = verdict_of(probability, held_out=worse)
    assert (verdict.kind, verdict.effects) == ("found", ("e0",))
    assert any("would rise from 0.050 to 0.090 N" in reason for reason in verdict.reasons)
    # Nor where noise alone would hardly leave so much as the single does, if an error of its form would.
    assert verdict_of(probability, held_out=worse, implausible=(("e0",),)).effects == ("e0",)
    # Not within the uncertainty of these errors, and not where the single does not explain the readings.
    assert verdict_of(probability, held_out=hardly).effects == ("e0", "e1")
    assert verdict_of(probability, held_out=worse, left=(("e0",),)).effects == ("e0", "e1")
    # What is left is no more believable where it foretells worse than nothing does.
    lost = verdict_of(probability, held_out={0: 0.03, 1: 0.06, 2: 0.09})
    assert (lost.kind, lost.effects) == ("none_of_catalogue", ())


def test_what_was_fitted_half_is_not_held_up_as_the_best_of_the_catalogue() -> None:
    probability: Probability = {("e0",): 0.0, (): 0.0, None: 1.0}
    usual, given_up = verdict_of(probability), verdict_of(probability, together=2_000.0)
    assert (usual.kind, given_up.kind) == ("none_of_catalogue", "none_of_catalogue")
    assert "the best of the catalogue (e0) leaves a misfit of 45" in usual.reasons[0]
    assert given_up.reasons[0].startswith("All 4 candidates at once leave a misfit of 2000 of the 45 ")
    assert "best of the catalogue" not in given_up.reasons[0]


@pytest.mark.parametrize(("alone", "said"), [(0.03, True), (0.2, False)])
def test_a_companion_whose_name_is_open_is_spoken_of(alone: float, said: bool) -> None:
    rest = 0.98 - alone
    probability: Probability = {
        ("e0", "e1"): 0.6 * rest, ("e0", "e2"): 0.4 * rest, ("e0",): alone, (): 0.01, None: 0.01
    }  # fmt: skip
    verdict = verdict_of(probability)
    assert (verdict.kind, verdict.effects) == ("found", ("e0",))
    beside = [reason for reason in verdict.reasons if reason.startswith("Something acts beside it")]
    assert bool(beside) is said
    assert all("e1 (0.57) or e2 (0.38)" in reason for reason in beside)


def test_what_would_need_an_impossible_value_is_none_of_the_catalogue() -> None:
    probability: Probability = {("e0",): 0.97, (): 0.02, None: 0.01}
    verdict = verdict_of(probability, impossible=(("e0",),))
    assert (verdict.kind, verdict.names) == ("none_of_catalogue", ())
    assert "e0, is not believable: e.size lies outside what is plausible" in verdict.reasons[0]
    # Only if that is what the readings say: a pair that can be believed stands for itself.
    open_pair: Probability = {("e0",): 0.04, ("e0", "e1"): 0.5, ("e0", "e2"): 0.44, (): 0.02, None: 0.0}
    verdict = verdict_of(open_pair, impossible=(("e0",),))
    assert (verdict.kind, verdict.names) == ("undecided", ("e0",))
    # What is left when a companion is left out stands for both.
    mended: Probability = {("e0", "e1"): 0.95, ("e0",): 0.03, (): 0.01, None: 0.01}
    verdict = verdict_of(mended, each=6.0, objective=10_000.0, impossible=(("e0",),))
    assert verdict.kind == "none_of_catalogue"
    verdict = verdict_of(mended, each=6.0, objective=10_000.0, another_law=(("e0", "e1"),))
    assert (verdict.kind, verdict.effects) == ("found", ("e0",))


def test_a_law_that_would_have_to_be_another_is_none_of_the_catalogue() -> None:
    probability: Probability = {("e0",): 0.97, (): 0.02, None: 0.01}
    assert verdict_of(probability).kind == "found"
    verdict = verdict_of(probability, another_law=(("e0",),))
    assert verdict.kind == "none_of_catalogue"
    assert verdict.names == ()
    assert "e0, is not believable" in verdict.reasons[0]
    assert "another law" in verdict.reasons[0]
    # With a companion that the readings do not name the form of both is in question no more.
    open_pair: Probability = {("e0",): 0.3, ("e0", "e1"): 0.4, ("e0", "e2"): 0.28, (): 0.02, None: 0.0}
    verdict = verdict_of(open_pair, another_law=(("e0",),))
    assert (verdict.kind, verdict.names) == ("undecided", ("e0",))
    assert any("another law" in short for short in verdict.short)
    # What owes most of its probability to laws that would be others does not stand by itself.
    verdict = verdict_of(open_pair, another_law=(("e0", "e1"),))
    assert (verdict.kind, verdict.effects) == ("found", ("e0",))
    verdict = verdict_of(open_pair, another_law=(("e0", "e1"), ("e0", "e2")))
    assert (verdict.kind, verdict.names) == ("undecided", ("e0",))
    assert any("most of its probability (0.68)" in short for short in verdict.short)


@pytest.mark.parametrize(
    ("left", "error", "defined", "too_much"),
    [
        # A third of the misfit: an error of a law's form, unless it is as large as any that is tried.
        (3500.0, 0.1, False, False),
        (3500.0, float(FORM_ERRORS[-1]), False, True),
        # Then a law leaves what such an error does, its square, and what has no law a little more.
        (500.0, float(FORM_ERRORS[-1]), False, False),
        (900.0, float(FORM_ERRORS[-1]), False, True),
        (900.0, float(FORM_ERRORS[-1]), True, False),
        # Two thirds: only by what has no law to be off, and is little off.
        (7000.0, 0.1, False, True),
        (7000.0, 0.1, True, False),
        (7000.0, float(FORM_ERRORS[-2]), True, True),
        (9000.0, 0.1, True, True),
    ],
)
def test_how_much_may_be_left_hangs_on_what_the_form_is_and_how_far_it_is_off(
    left: float, error: float, defined: bool, too_much: bool
) -> None:
    nothing = SimpleNamespace(fitted=SimpleNamespace(objective=10_000.0))
    weighed = Weighed(
        fitted=cast("Any", SimpleNamespace(problem=SimpleNamespace(rows=np.arange(200)))),
        form=Wildcard(np.zeros((200, 1)), FORM_ERRORS),
        size_N=0.1,
        log_evidence=0.0,
        form_error=error,
        budget_factor=1.0,
        misfit=200.0,
        plain_misfit=left,
        log_prior=0.0,
        defined=defined,
        x_allowing=np.zeros(0),
        sd_allowing=np.zeros(0),
    )
    assert weighed.leaves_too_much(cast("Any", nothing)) is too_much


@pytest.mark.parametrize(
    ("x", "allowing", "factor", "names"),
    [
        (6.0, 6.0, 1.0, ("point",)),
        # Bent only to make up for the effect's form; within a budget that is larger; what the effect itself changes.
        (6.0, 3.0, 1.0, ()),
        (6.0, 6.0, 1.41, ()),
        (0.0, 0.0, 1.0, ()),
    ],
)
def test_an_explanation_that_needs_another_anatomy_is_not_believed(
    x: float, allowing: float, factor: float, names: tuple[str, ...]
) -> None:
    table = SimpleNamespace(names=("point", "effect"))
    weighed = SimpleNamespace(
        fitted=SimpleNamespace(x=np.array([x, 9.0]), problem=SimpleNamespace(model=SimpleNamespace(parameters=table))),
        explanation=Explanation(("e",), ("e",), (1,)),
        x_allowing=np.array([allowing, 9.0]),
        budget_factor=factor,
    )
    assert strained(cast("Any", weighed)) == names


def test_inclusion_adds_up_over_explanations() -> None:
    included = inclusion({("e0", "e1"): 0.3, ("e0",): 0.6, (): 0.05, None: 0.05})
    assert included == {"e0": pytest.approx(0.9), "e1": pytest.approx(0.3)}
