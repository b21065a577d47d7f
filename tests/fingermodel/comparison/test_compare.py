"""Error summaries: the definitions of Eqs 6 and 7 on numbers that can be done by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fingermodel.comparing import compare
from fingermodel.comparison.comparison import CaseComparison, Comparison, _norms, muscles_of, summarise
from fingermodel.comparison.superposition import superposition
from fingermodel.session import Session
from tests.fingermodel.fingers import PUBLISHED


def case(measured: list[float], predicted: list[float], sd: float = 0.01, **changes: str) -> CaseComparison:
    m, p = np.array(measured), np.array(predicted)
    base = CaseComparison("c", "identification", "hook", "tip", {"FDP": 950.0}, m, np.full(3, sd), p, None, None, 1.0)
    return replace(base, **changes)  # type: ignore[arg-type]


def test_by_hand() -> None:
    e = summarise([case([3.0, 4.0, 0.0], [4.0, 3.0, 12.0]), case([0.0, -2.0, 0.0], [0.0, -1.0, 0.0])], 2)
    assert e.cases == 2
    assert e.components == 4
    assert e.rmse_N == pytest.approx(np.sqrt((1 + 1 + 0 + 1) / 4))
    assert e.rmse_rel_pct == pytest.approx(100 * np.sqrt(0.75) / 3.5)
    assert e.magnitude_error_N == pytest.approx(0.5)
    assert e.magnitude_error_pct == pytest.approx(25.0)
    assert e.direction_error_deg == pytest.approx(np.rad2deg(np.arccos(24 / 25)) / 2)
    assert e.direction_cases == 2


def test_directions_of_forces_lost_in_noise_are_left_out_and_counted() -> None:
    e = summarise([case([0.02, 0.0, 0.0], [0.0, 0.02, 0.0]), case([1.0, 0.0, 0.0], [1.0, 0.0, 0.0])], 3)
    assert e.direction_cases == 1
    assert e.direction_error_deg == pytest.approx(0.0, abs=1e-6)


def test_nothing_to_summarise_is_unknown_not_zero() -> None:
    e = summarise([], 3)
    assert e.cases == 0
    assert e.rmse_N is None
    assert e.direction_error_deg is None


@given(angle=st.floats(0, 2 * np.pi), scale=st.floats(0.1, 10))
def test_errors_do_not_depend_on_the_axes_and_relative_ones_not_on_the_unit(angle: float, scale: float) -> None:
    rng = np.random.default_rng(5)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    cases = [case(rng.normal(size=3).tolist(), rng.normal(size=3).tolist()) for _ in range(6)]
    turned = [
        case((scale * turn @ c.measured_N).tolist(), (scale * turn @ c.predicted_N).tolist(), 0.01 * scale)
        for c in cases
    ]
    a, b = summarise(cases, 2), summarise(turned, 2)
    assert b.rmse_N == pytest.approx(scale * (a.rmse_N or 0), rel=1e-9)
    assert b.rmse_rel_pct == pytest.approx(a.rmse_rel_pct, rel=1e-9)
    assert b.direction_error_deg == pytest.approx(a.direction_error_deg, rel=1e-6)


def test_every_case_is_in_exactly_one_summary() -> None:
    for name in PUBLISHED:
        comparison = compare(Session.open(name, catalogue=False))
        assert sum(s["space"]["cases"] for s in comparison.summary().values()) == len(comparison.cases) == 40
        for what in ("muscles", "posture", "location"):
            assert sum(s["space"]["cases"] for s in comparison.by(what).values()) == 40


def test_the_order_in_which_weights_were_written_makes_no_other_load() -> None:
    bench = Session.open("synek2019_H01", catalogue=False)
    cases = [
        m if k % 2 else replace(m, case=m.case.model_copy(update={"masses_g": dict([*m.case.masses_g.items()][::-1])}))
        for k, m in enumerate(bench.measured.cases)
    ]
    turned = compare(Session.of(replace(bench.measured, cases=tuple(cases)), catalogue=False))
    assert list({tuple(c.masses_g) for c in turned.cases if len(c.masses_g) > 1}) != [("FDP", "FDS")]
    assert turned.by("muscles") == compare(bench).by("muscles")
    assert muscles_of({"FDS": 300.0, "LU": 0.0, "FDP": 300.0}) == "FDP+FDS"


def test_superposition_limit_is_the_published_one() -> None:
    """Tip 2.69° and 6.3 %, bone 3.94° and 2.60 % for the mean human: single-tendon forces simply added."""
    bench = Session.open("synek2019_HMEAN", catalogue=False)
    limit = superposition(bench.model, bench.observations, compare(bench))
    tip, bone = (limit.select("validation", where).errors("sagittal") for where in ("tip", "bone"))
    assert tip.direction_error_deg == pytest.approx(2.69, abs=0.005)
    assert tip.magnitude_error_pct == pytest.approx(6.3, abs=0.05)
    assert bone.direction_error_deg == pytest.approx(3.94, abs=0.005)
    assert bone.magnitude_error_pct == pytest.approx(2.60, abs=0.005)


def test_z_is_the_residual_in_standard_uncertainties() -> None:
    bench = Session.open("DEV-01", catalogue=False)
    comparison = compare(bench)
    i = 7
    block = bench.observations.case_covariance[i][:3, :3]
    residual = comparison.cases[i].measured_N - comparison.cases[i].predicted_N
    assert comparison.cases[i].z == pytest.approx(np.sqrt(residual @ np.linalg.inv(block) @ residual))


def test_select_keeps_what_matches() -> None:
    comparison = Comparison((case([1, 0, 0], [1, 0, 0]), case([1, 0, 0], [1, 0, 0], role="validation")), False)
    assert len(comparison.select("validation").cases) == 1
    assert not comparison.select("validation", "bone").cases


def test_channels_that_say_the_same_have_a_norm_and_change_no_other() -> None:
    rng = np.random.default_rng(0)
    root = rng.normal(size=(4, 3, 3))
    covariances = root @ root.transpose(0, 2, 1)
    residuals = rng.normal(size=(4, 3))
    alone = _norms(residuals, covariances)
    same = np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 4.0]])
    both = _norms(
        np.vstack([residuals, [[1.0, 1.0, 2.0], [1.0, -1.0, 0.0]]]), np.concatenate([covariances, [same, same]])
    )
    assert both[:4] == pytest.approx(alone, rel=1e-6)
    assert both[4] == pytest.approx(np.sqrt(1.0 + 1.0))
    assert both[5] is not None
    assert 1e3 < both[5] < np.inf
