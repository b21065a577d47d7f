"""The closed forms under a diagnosis: evidence, one-sided priors, wildcard, confounding, what a verdict needs."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import trapezoid
from scipy.stats import multivariate_normal, norm

from fingermodel.diagnosis.calibration import calibrate
from fingermodel.diagnosis.candidates import Candidate, Explanation, log_prior, log_prior_else, pairs_of, single
from fingermodel.diagnosis.confounding import confounding
from fingermodel.diagnosis.diagnose import enough
from fingermodel.diagnosis.evidence import Other, Weighed, estimates_at, estimates_of
from fingermodel.diagnosis.linear import Linear, log_mass
from fingermodel.diagnosis.robustness import left_out
from fingermodel.diagnosis.verdict import LEAST_CASES, Verdict, inclusion, judge, strained
from fingermodel.diagnosis.wildcard import FORM_ERRORS, Wildcard
from fingermodel.parameters import one_sided
from tests.settings import load_profile

load_profile()
Floats = NDArray[np.float64]


def straight(seed: int, readings: int = 30, base: int = 6, effects: int = 5, one_sided: tuple[int, ...] = ()) -> Linear:
    """A random linear model: `base` parameters, then `effects`."""
    rng = np.random.default_rng(seed)
    h = rng.normal(size=(readings, base + effects)) * rng.uniform(0.2, 3.0, base + effects)
    sided = np.zeros(base + effects, dtype=bool)
    sided[list(one_sided)] = True
    return Linear(rng.normal(size=readings) * 2.0, h, np.arange(base), sided, np.zeros(base + effects))


def about(linear: Linear, x: Floats) -> Linear:
    """The same, straightened out about another point (parameters,)."""
    return replace(linear, residual=linear.residual - linear.h @ x, x=x)


def log_density(linear: Linear, columns: list[int]) -> float:
    """ln N(y; 0, 1 + HHᵀ) over some columns, without the constant."""
    h, n = linear.h[:, columns], len(linear.residual)
    value = multivariate_normal(np.zeros(n), np.eye(n) + h @ h.T).logpdf(linear.residual)
    return float(value + 0.5 * n * np.log(2.0 * np.pi))


@given(st.integers(0, 10_000), st.sets(st.integers(6, 10), min_size=1, max_size=4))
def test_the_gain_is_the_ratio_of_exact_evidences(seed: int, freed: set[int]) -> None:
    linear, base = straight(seed), list(range(6))
    expected = log_density(linear, [*base, *freed]) - log_density(linear, base)
    assert linear.log_evidence_base == pytest.approx(log_density(linear, base), abs=1e-7)
    assert linear.gain(sorted(freed)) == pytest.approx(expected, abs=1e-7)


@given(st.floats(-3.0, 3.0), st.floats(0.2, 5.0))
def test_a_one_sided_prior_doubles_what_lies_on_its_side(mean: float, precision: float) -> None:
    value = log_mass(np.array([mean]), np.array([[1.0 / precision]]), np.array([True]))
    assert value == pytest.approx(np.log(2.0) + norm.logcdf(mean * np.sqrt(precision)), abs=1e-9)


def test_several_one_sided_priors_count_with_their_orthant() -> None:
    rng = np.random.default_rng(3)
    root = rng.normal(size=(3, 3)) + 2.0 * np.eye(3)
    covariance, mean = root @ root.T, np.array([1.0, -0.5, 2.0])
    draws = mean + rng.normal(size=(400_000, 3)) @ root.T
    expected = np.log(8.0 * np.mean(np.all(draws > 0.0, axis=1)))
    value = log_mass(mean, covariance, np.array([True] * 3))
    assert value == pytest.approx(expected, abs=0.02)


@pytest.mark.parametrize("pull", [1.0, 40.0])
@pytest.mark.parametrize("correlation", [-0.9, 0.0, 0.9])
@pytest.mark.parametrize("order", [[0, 1], [1, 0]])
def test_what_is_held_at_its_null_counts_however_hard_it_is_pulled(
    pull: float, correlation: float, order: list[int]
) -> None:
    """One at its null, whose mean lies far beyond it, and one that stands half a width from its own."""
    covariance = np.array([[1.0, correlation], [correlation, 1.0]])
    mean = np.array([0.0, 0.5]) - pull * covariance[:, 0]
    # Exact by one integral: the second's mass where it is positive, given the first.
    a = np.linspace(0.0, 20.0 / pull, 20_001)
    spread = np.sqrt(1.0 - correlation**2)
    given_a = mean[1] + correlation * (a - mean[0])
    logs = norm.logpdf(a, mean[0]) + norm.logcdf(given_a / spread)
    expected = logs.max() + np.log(trapezoid(np.exp(logs - logs.max()), a)) + 2.0 * np.log(2.0)
    value = log_mass(mean[order], covariance[np.ix_(order, order)], np.array([True, True]))
    assert value == pytest.approx(expected, abs=0.01)


@given(st.integers(0, 10_000))
def test_the_wildcard_is_the_density_of_its_covariance(seed: int) -> None:
    linear = straight(seed)
    columns = np.random.default_rng(seed + 1).normal(size=(30, 8))
    wildcard = Wildcard.of(columns, np.array([0.0, 0.3, 2.0]))
    free, scale = np.arange(6), np.full(6, 1.5)
    h = linear.h[:, free] * scale
    for amplitude, value in zip(wildcard.amplitudes, wildcard.profile(linear, free, scale), strict=True):
        covariance = np.eye(30) + h @ h.T + amplitude**2 * columns @ columns.T
        expected = multivariate_normal(np.zeros(30), covariance).logpdf(linear.residual) + 15.0 * np.log(2.0 * np.pi)
        assert value == pytest.approx(expected, abs=1e-6)


@given(st.integers(0, 10_000))
def test_a_straight_line_is_the_same_about_any_of_its_points(seed: int) -> None:
    linear = straight(seed, one_sided=(7,))
    x = np.random.default_rng(seed + 1).normal(size=11) * 5.0
    x[8:] = 0.0
    moved, free = about(linear, x), np.arange(8)
    wildcard = Wildcard.of(np.random.default_rng(seed + 2).normal(size=(30, 8)), np.array([0.0, 0.3, 2.0]))
    assert moved.log_evidence_base == pytest.approx(linear.log_evidence_base, abs=1e-7)
    assert moved.gain([6, 9]) == pytest.approx(linear.gain([6, 9]), abs=1e-7)
    assert moved.mean([7])[1] == pytest.approx(linear.mean([7])[1], abs=1e-9)
    assert moved.unexplained == pytest.approx(linear.unexplained, abs=1e-9)
    width = np.linspace(1.0, 2.0, 8)
    assert wildcard.profile(moved, free, width) == pytest.approx(wildcard.profile(linear, free, width), abs=1e-7)
    for one, other in zip(
        estimates_of(moved, free, width, wildcard, 0.3), estimates_of(linear, free, width, wildcard, 0.3), strict=True
    ):
        assert one == pytest.approx(other, abs=1e-8)


def test_slopes_almost_without_bound_leave_no_misfit_below_none() -> None:
    """Near a posture that transmits no force a tendon's point moves readings by 10⁶ uncertainties a prior width."""
    linear, free = straight(3), np.arange(6)
    wildcard = Wildcard.of(np.random.default_rng(4).normal(size=(30, 8)), np.array([0.0, 0.1]))
    x = np.zeros(11)
    x[:6] = 4.0
    misfits = []
    for steep in (1e4, 1e6):
        h = linear.h.copy()
        h[:, 0] *= steep
        h[:, 1] = h[:, 0] * 1.001 + linear.h[:, 1]
        misfits.append(estimates_of(replace(linear, h=h, x=x), free, np.ones(6), wildcard, 0.1)[0])
    assert misfits[1] > 0.0
    assert misfits[1] == pytest.approx(misfits[0], rel=1e-3)


def candidates(count: int = 4, first: int = 6) -> tuple[Candidate, ...]:
    return tuple(Candidate(f"e{k}", f"e{k}", ((first + k,),), 1.0, False) for k in range(count))


def test_the_prior_is_a_probability() -> None:
    many = (
        *candidates(3),
        Candidate("p.a", "p", ((9,),), 0.5, False),
        Candidate("p.b", "p", ((10,),), 0.5, False),
    )
    alone = [single(c, 0) for c in many]
    two = [Explanation((a.name, b.name), (a.effect, b.effect), (), (0, 0)) for a, b in pairs_of(many)]
    mass = sum(np.exp(log_prior(e, many)) for e in [Explanation((), (), ()), *alone, *two]) + np.exp(log_prior_else())
    assert mass == pytest.approx(1.0, abs=0.12)
    assert log_prior(Explanation((), (), ()), many) == pytest.approx(np.log(0.5))


def test_effects_that_do_the_same_are_one_class() -> None:
    linear = straight(5, effects=3)
    h = linear.h.copy()
    h[:, 7] = 2.0 * h[:, 6]
    same = confounding(replace(linear, h=5.0 * h), candidates(3))
    assert same.correlation[0, 1] == pytest.approx(1.0, abs=1e-6)
    assert same.classes == (("e0", "e1"),)
    assert same.alike("e0") == ("e1",)


def test_what_the_base_absorbs_cannot_be_detected() -> None:
    linear = straight(6, effects=2)
    h = linear.h.copy()
    h[:, :6] *= 1e4
    h[:, 6] = h[:, 0] * 1e-4
    shown = confounding(replace(linear, h=h), candidates(2))
    assert shown.detectability["e0"] < 0.01
    assert shown.detectability["e1"] > 1.0


def test_stated_probabilities_come_true_on_simulated_sessions() -> None:
    linear = straight(7, readings=60, effects=6, one_sided=(8, 9))
    found = calibrate(replace(linear, h=3.0 * linear.h), candidates(6), draws=600)
    assert found.false_finding_rate <= 0.02
    assert found.right is not None
    assert found.right >= 0.95
    for stated, came_true, count in found.reliability:
        assert abs(stated - came_true) <= 3.0 * np.sqrt(stated * (1.0 - stated) / count) + 0.05


def verdict_of(
    probability: dict[tuple[str, ...] | None, float],
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
) -> Any:
    """The verdict where only probabilities speak: everything fits, nothing is strained.

    `each` is the log evidence of each effect, `held_out` the error [N] of cases never fitted by the number of effects,
    `left` are explanations that leave too much, `another_law` those whose form is too far off, `impossible` those with
    a value far beyond its range, `implausible` those that leave more than noise would, and `together` is what all at
    once leave.
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
    )


def test_only_a_mounts_readings_are_a_whole_mount() -> None:
    held = SimpleNamespace(
        postures=("hook", "hook", "straight", "straight"),
        masses_g=({"FDS": 500.0}, {"FDP": 500.0}) * 2,
        locations=("tip", "bone") * 2,
    )
    problem = cast("Any", SimpleNamespace(rows=np.arange(24), observations=held))
    parts = {words: (rows.sum(), mount) for words, rows, mount in left_out(problem)}
    assert {words for words, (_, mount) in parts.items() if mount} == {"the tip readings", "the bone readings"}
    assert {"posture hook", "posture straight", "tendon FDS", "tendon FDP"} < set(parts)
    assert all(count == 12 for count, _ in parts.values())


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
def test_a_verdict_needs_its_probability(
    probability: dict[tuple[str, ...] | None, float], kind: str, effects: tuple[str, ...]
) -> None:
    verdict = verdict_of(probability)
    assert (verdict.kind, verdict.effects) == (kind, effects)


def test_a_companion_that_may_only_mend_the_form_is_not_named() -> None:
    probability: dict[tuple[str, ...] | None, float] = {("e0", "e1"): 0.95, ("e0",): 0.03, (): 0.01, None: 0.01}
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
    probability: dict[tuple[str, ...] | None, float] = {("e0", "e1"): 0.95, ("e0",): 0.03, (): 0.01, None: 0.01}
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
    probability: dict[tuple[str, ...] | None, float] = {("e0",): 0.0, (): 0.0, None: 1.0}
    usual, given_up = verdict_of(probability), verdict_of(probability, together=2_000.0)
    assert (usual.kind, given_up.kind) == ("none_of_catalogue", "none_of_catalogue")
    assert "the best of the catalogue (e0) leaves a misfit of 45" in usual.reasons[0]
    assert given_up.reasons[0].startswith("All 4 candidates at once leave a misfit of 2000 of the 45 ")
    assert "best of the catalogue" not in given_up.reasons[0]


@pytest.mark.parametrize(("alone", "said"), [(0.03, True), (0.2, False)])
def test_a_companion_whose_name_is_open_is_spoken_of(alone: float, said: bool) -> None:
    rest = 0.98 - alone
    probability: dict[tuple[str, ...] | None, float] = {
        ("e0", "e1"): 0.6 * rest, ("e0", "e2"): 0.4 * rest, ("e0",): alone, (): 0.01, None: 0.01
    }  # fmt: skip
    verdict = verdict_of(probability)
    assert (verdict.kind, verdict.effects) == ("found", ("e0",))
    beside = [reason for reason in verdict.reasons if reason.startswith("Something acts beside it")]
    assert bool(beside) is said
    assert all("e1 (0.57) or e2 (0.38)" in reason for reason in beside)


def test_values_are_less_sure_where_the_form_may_be_otherwise_and_the_base_is_bent_less() -> None:
    rng = np.random.default_rng(3)
    h = rng.normal(size=(60, 3))
    # The form is off along what the base's second parameter does.
    root = h[:, [1]] * 4.0
    x = np.array([0.3, 5.0, 2.0])
    fitted = SimpleNamespace(
        x=x,
        inner=np.arange(3),
        objective=np.inf,
        explanation=Explanation(("e",), ("e",), (2,)),
        linear=Linear(h @ x, h, np.arange(2), np.zeros(3, dtype=bool), np.zeros(3)),
    )
    form = Wildcard(root, FORM_ERRORS)
    misfit, plain, plain_sd = estimates_at(cast("Any", fitted), form, 1.0, 0.0)
    less, allowing, sd = estimates_at(cast("Any", fitted), form, 1.0, 0.2)
    assert plain == pytest.approx(x, rel=0.1)
    assert (sd >= plain_sd).all()
    assert 0.0 < less < misfit
    assert abs(allowing[1]) < 0.7 * abs(plain[1])


def test_what_would_need_an_impossible_value_is_none_of_the_catalogue() -> None:
    probability: dict[tuple[str, ...] | None, float] = {("e0",): 0.97, (): 0.02, None: 0.01}
    verdict = verdict_of(probability, impossible=(("e0",),))
    assert (verdict.kind, verdict.names) == ("none_of_catalogue", ())
    assert "e0, is not believable: e.size lies outside what is plausible" in verdict.reasons[0]


def test_a_law_that_would_have_to_be_another_is_none_of_the_catalogue() -> None:
    probability: dict[tuple[str, ...] | None, float] = {("e0",): 0.97, (): 0.02, None: 0.01}
    assert verdict_of(probability).kind == "found"
    verdict = verdict_of(probability, another_law=(("e0",),))
    assert verdict.kind == "none_of_catalogue"
    assert verdict.names == ()
    assert "e0, is not believable" in verdict.reasons[0]
    assert "another law" in verdict.reasons[0]
    # With a companion that the readings do not name the form of both is in question no more.
    open_pair: dict[tuple[str, ...] | None, float] = {
        ("e0",): 0.3,
        ("e0", "e1"): 0.4,
        ("e0", "e2"): 0.28,
        (): 0.02,
        None: 0.0,
    }
    verdict = verdict_of(open_pair, another_law=(("e0",),))
    assert (verdict.kind, verdict.names) == ("undecided", ("e0",))
    assert any("another law" in short for short in verdict.short)


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
    evidence = SimpleNamespace(probability={("e0", "e1"): 0.3, ("e0",): 0.6, (): 0.05, None: 0.05})
    included = inclusion(cast("Any", evidence))
    assert included == {"e0": pytest.approx(0.9), "e1": pytest.approx(0.3)}
