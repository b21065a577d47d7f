"""The published study to its digits, and our own fit on the same split."""

from __future__ import annotations

import pytest

from fingermodel.studies.published import row, row_about, row_within
from server.reproduce.study import Reproduction, reproduce


@pytest.fixture(scope="module")
def study() -> Reproduction:
    return reproduce("synek2019", lambda fraction: None)


def test_every_published_figure_that_can_be_recomputed_agrees(study: Reproduction) -> None:
    rows = study.rows
    differing = [f"{r.quantity}: {r.published} published, {r.ours} ours" for r in rows if r.agrees is False]
    assert not differing
    assert sum(r.agrees is True for r in rows) == 38


def test_the_bonobo_never_agrees_without_its_points(study: Reproduction) -> None:
    bonobo = [r for r in study.rows if r.quantity.startswith("bonobo")]
    assert len(bonobo) == 23
    assert all(r.agrees is None and r.note for r in bonobo)


@pytest.mark.parametrize(
    ("quantity", "ours"),
    [
        ("friction factor c (Eq 1)", 0.8348),
        ("human tip force RMSE, initial model", 0.532),
        ("human tip force RMSE, published optimised model", 0.1095),
        ("human tension to tip force, mean", 3.779),
        ("human mean moment arm of FDP at the DIP", 4.262),
    ],
)
def test_figures_beyond_the_published_digits(study: Reproduction, quantity: str, ours: float) -> None:
    found = next(r for r in study.rows if r.quantity == quantity)
    assert found.ours == pytest.approx(ours, rel=1e-3)


def test_our_fit_holds_on_loads_that_were_never_fitted(study: Reproduction) -> None:
    fits = study.results["fits"]
    assert [f["specimen"] for f in fits] == ["HMEAN", "H01", "H02", "H03"]
    for fit in fits:
        assert all(fit["held_to"].values()), f"{fit['specimen']}: {fit['held_to']}"


def test_our_fit_is_nearer_to_the_fitted_loads_than_the_published_method(
    study: Reproduction,
) -> None:
    for fit in study.results["fits"]:
        ours, theirs = (fit[k]["identification/tip"]["sagittal"]["rmse_N"] for k in ("ours", "published_method"))
        assert 0.0 < ours < theirs


@pytest.mark.parametrize(
    ("published", "ours", "agrees"), [("0.835", 0.8348, True), ("0.835", 0.8343, False), ("32", 31.4, False)]
)
def test_agreement_is_to_the_printed_digits(published: str, ours: float, agrees: bool) -> None:
    assert row("x", published, ours, "1").agrees is agrees


def test_agreement_with_a_range_or_a_spread() -> None:
    assert [row_within("x", "1.5", "2.5", ours, "1").agrees for ours in (1.49, 1.5, 2.5, 2.51)] == [
        False,
        True,
        True,
        False,
    ]
    assert [row_about("x", "2.0", "0.5", ours, "1").agrees for ours in (1.49, 1.6, 2.4, 2.51)] == [
        False,
        True,
        True,
        False,
    ]
