"""`reproduce synek2019`: the published study to its digits, and our own fit on the same split."""

from __future__ import annotations

from typing import Any

import pytest

from tests.server.command_line import run


@pytest.fixture(scope="module")
def study() -> dict[str, Any]:
    body: dict[str, Any] = run("reproduce", "synek2019", "--json", "-").body("reproduce")
    return body


def test_every_published_number_stands_beside_ours_once(study: dict[str, Any]) -> None:
    rows = study["rows"]
    assert all({"quantity", "published", "ours", "unit", "agrees"} <= set(row) for row in rows)
    names = [row["quantity"] for row in rows]
    assert len(names) == len(set(names)) > 50
    assert all(row["note"] for row in rows if row["agrees"] is None)


def test_every_published_figure_that_can_be_recomputed_agrees(study: dict[str, Any]) -> None:
    rows = study["rows"]
    assert [f"{r['quantity']}: {r['published']}, {r['ours']} ours" for r in rows if r["agrees"] is False] == []
    assert sum(r["agrees"] is True for r in rows) == 38


def test_the_bonobo_never_agrees_without_its_points(study: dict[str, Any]) -> None:
    bonobo = [r for r in study["rows"] if r["quantity"].startswith("bonobo")]
    assert len(bonobo) == 23
    assert all(r["agrees"] is None and r["note"] for r in bonobo)


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
def test_figures_beyond_the_published_digits(study: dict[str, Any], quantity: str, ours: float) -> None:
    found = next(r for r in study["rows"] if r["quantity"] == quantity)
    assert found["ours"] == pytest.approx(ours, rel=1e-3)


def test_our_fit_holds_on_loads_that_were_never_fitted(study: dict[str, Any]) -> None:
    fits = study["fits"]
    assert [f["specimen"] for f in fits] == ["HMEAN", "H01", "H02", "H03"]
    for fit in fits:
        assert all(fit["held_to"].values()), f"{fit['specimen']}: {fit['held_to']}"


def test_our_fit_is_nearer_to_the_fitted_loads_than_the_published_method(study: dict[str, Any]) -> None:
    for fit in study["fits"]:
        ours, theirs = (fit[k]["identification/tip"]["sagittal"]["rmse_N"] for k in ("ours", "published_method"))
        assert 0.0 < ours < theirs
