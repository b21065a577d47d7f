"""Ordinary benches: cases that scatter by a percent or two, and a slip of the pen in the session's file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from fingermodel.diagnosis.answer.answer import remarks, sentence
from fingermodel.diagnosis.diagnose import diagnose
from fingermodel.diagnosis.posterior.hyper import NOISE
from fingermodel.session import Session
from server.application.diagnosing import diagnosis_answer, run_diagnosis
from tests.scattered import (
    Floats,
    by_angle,
    by_component,
    by_direction,
    by_drift,
    by_hold,
    by_line,
    by_mount,
    by_setting,
    by_weight,
    by_zero,
    with_gain_drift,
    with_readings,
    with_saturation,
    with_tension_drift,
)
from tests.simulator import draw_session


def rough(folder: Path, seed: int, effects: dict[str, Any], scatter: float, spoilt: str | None = None) -> str | None:
    """Write a session whose true tensions scatter about what its file says; and spoil one mass or label in it.

    Returns:
        The id of the spoilt case.
    """
    draw_session(folder, seed, effects, protocol="short", nuisance_scale=0.8)
    file = folder / "session.yaml"
    document = yaml.safe_load(file.read_text(encoding="utf-8"))
    rng = np.random.default_rng(seed)
    for case in document["cases"]:
        case["masses_g"] = {m: float(g * np.exp(scatter * rng.normal())) for m, g in case["masses_g"].items()}
    case = next(
        c for c in document["cases"] if "FDP" in c["masses_g"] and c["location"] == "tip" and len(c["masses_g"]) == 1
    )
    if spoilt == "mass":
        case["masses_g"]["FDP"] *= 0.6
    if spoilt == "label":
        case["masses_g"] = {"FDS": case["masses_g"]["FDP"]}
    file.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
    return str(case["id"]) if spoilt else None


@cache
def diagnosed(folder: Path) -> dict[str, Any]:
    bench = Session.open(folder)
    return diagnosis_answer(bench, run_diagnosis(bench))


def test_a_clean_bench_that_repeats_to_two_percent_stays_clean(tmp_path: Path) -> None:
    rough(tmp_path, 41, {}, 0.02)
    found = diagnosed(tmp_path)
    assert found["verdict"] == "nothing_missing"
    assert found["repeatability"]["value_pct"] == pytest.approx(2.0, abs=0.7)
    assert not found["suspects"]


@pytest.mark.parametrize(
    ("extra_N", "verdict"), [(0.005, "nothing_missing"), pytest.param(0.03, "undecided", marks=pytest.mark.full)]
)
def test_noise_that_no_plateau_shows_is_no_effect_and_said_to_be_unusual_where_it_is_large(
    tmp_path: Path, extra_N: float, verdict: str
) -> None:
    draw_session(tmp_path, 44, {}, protocol="short", nuisance_scale=0.8)
    bench = Session.open(tmp_path)
    rng, o = np.random.default_rng(44), bench.observations
    unit = np.array([1.0, 1.0, 1.0, 10.0, 10.0, 10.0])
    noisy = replace(o, wrench=o.wrench + extra_N * unit * rng.normal(size=o.wrench.shape))
    d = diagnose(bench.model, noisy)
    assert d.verdict.kind == verdict
    assert d.verdict.effects == ()
    assert d.posterior.hyperparameter(NOISE)[0] == pytest.approx(extra_N, rel=0.4)
    assert ("mN of noise beside the measured one" in "".join(d.verdict.short)) == (verdict == "undecided")
    assert any(f"scatters by {1000.0 * d.posterior.hyperparameter(NOISE)[0]:.0f} mN" in line for line in remarks(d))


@pytest.mark.parametrize("effects", [(), pytest.param(("hanger_mass",), marks=pytest.mark.full)])
@pytest.mark.parametrize(
    ("scattered", "kind", "size", "said", "seed"),
    [  # how often this is right is in benchmarks/scatter.md
        pytest.param(by_direction, "direction", 0.02, "of the force in every direction", 50, marks=pytest.mark.full),
        pytest.param(by_component, "component", 0.015, "of each component by itself", 50, marks=pytest.mark.full),
        pytest.param(by_angle, "angle_rad", np.deg2rad(1.0), "of each joint angle", 50, marks=pytest.mark.full),
        (by_weight, "weight", 0.01, "of each weight", 50),
        pytest.param(
            by_line, "line_rad", np.deg2rad(1.5), "of each tendon's line at the bone", 50, marks=pytest.mark.full
        ),
        pytest.param(by_zero, "zero_N", 0.02, "of the zero from setting to setting", 50, marks=pytest.mark.full),
        pytest.param(by_drift, "drift_N", 0.02, "of the zero's drift within a setting", 50, marks=pytest.mark.full),
        pytest.param(
            by_setting,
            "turn_rad",
            np.deg2rad(1.0),
            "of the cell's orientation from setting to setting",
            50,
            marks=pytest.mark.full,
        ),
        pytest.param(
            by_hold, "hold_mm", 1.0, "of where the tip is held from setting to setting", 50, marks=pytest.mark.full
        ),
        pytest.param(
            by_mount,
            "apart_rad",
            np.deg2rad(1.0) / np.sqrt(2.0),
            "of each joint angle between tip and bone",
            52,
            marks=pytest.mark.full,
        ),
    ],
)
def test_scatter_that_no_tension_makes_hides_nothing_and_is_said(
    tmp_path: Path,
    scattered: Callable[[Session, np.random.Generator], Floats],
    kind: str,
    size: float,
    said: str,
    seed: int,
    effects: tuple[str, ...],
) -> None:
    # A drift within a setting shows where a setting has many cases.
    protocol = "dev" if kind == "drift_N" else "short"
    draw_session(tmp_path, seed, {"hanger_mass": 40.0} if effects else {}, protocol=protocol, nuisance_scale=0.8)
    exact = Session.open(tmp_path)
    bench = with_readings(exact, scattered(exact, np.random.default_rng(seed)))
    d = diagnose(bench.model, bench.observations)
    assert (d.verdict.kind, d.verdict.effects) == ("found" if effects else "nothing_missing", effects)
    assert d.posterior.other_scatter[kind][0] == pytest.approx(size, rel=0.5)
    assert any(said in line for line in remarks(d))
    assert d.trend is None


@pytest.mark.parametrize(
    ("changed", "what", "along", "course"),
    [
        (with_gain_drift, "the cell's gain", "time", (-3.0, 0.0, 3.0)),
        pytest.param(with_tension_drift, "what FDP pulls", "time", (-4.0, 0.0, 4.0), marks=pytest.mark.full),
        pytest.param(with_saturation, "the cell's gain", "load", (0.0, -4.0, -8.0), marks=pytest.mark.full),
    ],
)
def test_what_goes_with_time_or_load_is_no_scatter_and_said(
    tmp_path: Path, changed: Callable[[Session], Floats], what: str, along: str, course: tuple[float, ...]
) -> None:
    draw_session(tmp_path, 50, {}, nuisance_scale=0.8)
    exact = Session.open(tmp_path)
    bench = with_readings(exact, changed(exact))
    d = diagnose(bench.model, bench.observations)
    assert d.verdict.kind in ("undecided", "none_of_catalogue")
    assert not d.faults
    assert d.trend is not None
    assert (d.trend.what, d.trend.along) == (what, along)
    assert d.trend.course == pytest.approx(course, abs=2.0)
    assert any(d.trend.sentence in line for line in (*remarks(d), *d.verdict.short))
    assert d.trend.words in sentence(d)


def test_a_cell_that_reads_large_forces_low_is_recognised(tmp_path: Path) -> None:
    draw_session(tmp_path, 50, {}, protocol="short", nuisance_scale=0.8)
    exact = Session.open(tmp_path)
    wrench = np.array([case.wrench for case in exact.measured.cases])
    wrench[:, :3] *= 1.0 - 0.2 * (wrench[:, :3] / np.abs(wrench[:, :3]).max()) ** 2
    bench = with_readings(exact, wrench)
    d = diagnose(bench.model, bench.observations)
    assert d.verdict.kind == "none_of_catalogue"
    assert not d.suspects
    assert "(cell_nonlinearity)" in sentence(d)


@pytest.mark.full
def test_what_goes_with_time_takes_nothing_from_a_larger_effect(tmp_path: Path) -> None:
    draw_session(tmp_path, 50, {"hanger_mass": 60.0}, protocol="short", nuisance_scale=0.8)
    exact = Session.open(tmp_path)
    bench = with_readings(exact, with_gain_drift(exact))
    d = diagnose(bench.model, bench.observations)
    assert (d.verdict.kind, d.verdict.effects) == ("found", ("hanger_mass",))
    assert d.trend is not None
    assert any(d.trend.sentence in line for line in remarks(d))


@pytest.mark.full
def test_nothing_goes_with_time_where_none_is_known(tmp_path: Path) -> None:
    draw_session(tmp_path, 50, {}, protocol="short", nuisance_scale=0.8)
    exact = Session.open(tmp_path)
    bench = with_readings(exact, with_gain_drift(exact))
    o = bench.observations
    timeless = replace(o, inputs=o.inputs._replace(elapsed=0.0 * o.inputs.elapsed))
    d = diagnose(bench.model, timeless)
    assert d.trend is None or d.trend.along == "load"


@pytest.mark.parametrize(("seen", "effects"), [pytest.param(0.0, ("rig_friction",), marks=pytest.mark.full), (0.2, ())])
def test_what_settles_after_its_window_is_no_effect_where_the_windows_show_that_it_does(
    tmp_path: Path, seen: float, effects: tuple[str, ...]
) -> None:
    draw_session(tmp_path, 45, {}, protocol="short", nuisance_scale=0.8)
    measured = Session.open(tmp_path).measured
    too_early = tuple(replace(case, wrench=0.9 * case.wrench) for case in measured.cases)
    bench = Session.of(replace(measured, cases=too_early, creep=seen))
    assert diagnose(bench.model, bench.observations).verdict.effects == effects


@pytest.mark.parametrize(("off_N", "suspect"), [pytest.param(0.06, False, marks=pytest.mark.full), (0.8, True)])
def test_a_case_that_noise_puts_off_is_not_counted_and_accused_of_nothing(
    tmp_path: Path, off_N: float, suspect: bool
) -> None:
    draw_session(tmp_path, 45, {}, nuisance_scale=0.8)
    bench = Session.open(tmp_path)
    o = bench.observations
    case = next(i for i, role in enumerate(o.roles) if role == "identification" and o.locations[i] == "tip")
    wrench = o.wrench.copy()
    wrench[case, :3] += off_N * np.array([0.6, -0.5, 0.6])
    d = diagnose(bench.model, replace(o, wrench=wrench))
    assert d.verdict.kind == "nothing_missing"
    assert list(d.suspects) == ([case] if suspect else [])
    assert d.outliers == (() if suspect else (case,))
    assert any("Not counted" in line and o.ids[case] in line for line in remarks(d)) != suspect


def test_an_effect_is_found_only_where_the_rig_is_as_good_as_stated(tmp_path: Path) -> None:
    """What the rest wants of the rig may be another effect, or a wrong entry."""
    draw_session(tmp_path, 55, {"hanger_mass": 60.0}, protocol="short", nuisance_scale=3.0)
    found = diagnosed(tmp_path)
    assert (found["verdict"], found["candidates"], found["effects"]) == ("undecided", ["hanger_mass"], [])
    assert any(
        "hanger_mass, noise, scatter and budget as stated leave a misfit of" in reason for reason in found["reasons"]
    )


def test_an_effect_is_found_beside_scatter(tmp_path: Path) -> None:
    rough(tmp_path, 42, {"hanger_mass": 40.0}, 0.015)
    found = diagnosed(tmp_path)
    assert (found["verdict"], found["effects"]) == ("found", ["hanger_mass"])
    assert found["repeatability"]["value_pct"] == pytest.approx(1.5, abs=0.6)


@pytest.mark.parametrize(
    ("spoilt", "effects"),
    [("mass", {}), pytest.param("label", {"cell_rotation": (5.0, -4.0, 6.0)}, marks=pytest.mark.full)],
)
def test_a_slip_of_the_pen_is_a_suspect_and_no_story(tmp_path: Path, spoilt: str, effects: dict[str, Any]) -> None:
    case = rough(tmp_path, 43, effects, 0.01, spoilt)
    found = diagnosed(tmp_path)
    assert found["suspects"][0]["case"] == case
    assert found["suspects"][0]["probability"] > 0.9
    assert set(found["effects"]) == set(effects)
    assert found["verdict"] == ("found" if effects else "nothing_missing")
