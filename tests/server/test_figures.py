"""Figures of a comparison: what is drawn where, in which frame, and what is left out."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go
import pytest
from matplotlib.image import imread

from fingermodel.comparison.comparison import CaseComparison, Comparison
from server.figures.arrows import BETWEEN, MEASURED, NOMINAL, Spread, area_of, sector, spread_between
from server.figures.compared import Compared
from server.figures.comparison import comparison_sections
from server.figures.panels import MAX_LOADS
from server.figures.poses import finger_pose
from server.figures.report import figures_of
from server.figures.scatter import scatter_figure
from server.figures.static import render, write_static
from server.figures.style import TENDONS, NothingToDrawError, load_styles, load_text, number, posture_name
from server.figures.summary import errors_figure
from server.figures.vectors import bone_figure, vector_figure
from server.figures.zscores import z_figure
from tests.server.compared_sessions import AWKWARD, BOTH, POSTURES, finger, many_rows, ordinary, session


@pytest.mark.parametrize("name", list(AWKWARD))
def test_awkward_sessions_give_every_figure_that_they_can(name: str) -> None:
    make, missing = AWKWARD[name]
    model, observations, comparison = make()
    figures = figures_of(comparison_sections(Compared(model, observations, comparison)))
    assert set(figures) == {"scatter", "scatter_validation", "vectors", "bone", "errors", "z"} - missing
    for figure in figures.values():
        text = figure.to_json()
        assert "bdata" not in text, "numbers stay readable"
        assert len(render(json.loads(text), "svg")) > 1000


def test_before_and_after_are_both_drawn_and_written(tmp_path: Path) -> None:
    model, observations, comparison = ordinary()
    compared = Compared(model, observations, comparison, ("First guess", comparison), name="Fitted")
    figures = figures_of(comparison_sections(compared))
    written = write_static(tmp_path, figures, scale=1.0)
    assert {p.suffix for p in written} == {".png", ".svg"}
    assert sorted(tmp_path.iterdir()) == sorted(written), "nothing is left over"
    for name, figure in figures.items():
        parts = json.loads(figure.to_json())
        assert json.loads(go.Figure(parts).to_json()) == parts
        picture = imread(tmp_path / f"{name}.png")
        assert picture.shape[:2] == (figure.layout.height, figure.layout.width)
    text = (tmp_path / "scatter.svg").read_text(encoding="utf-8")
    assert "First guess: RMSE" in text
    assert "Fitted: RMSE" in text
    assert "measured Fx [N], proximal +" in text
    assert len(figures["errors"].data) == 2 * len(errors_figure([("Fitted", comparison)]).data)


def test_empty_selections_say_so() -> None:
    nothing = Comparison((), noise_assumed=False)
    model, observations, comparison = ordinary()
    with pytest.raises(NothingToDrawError, match="tip"):
        scatter_figure([("model", nothing)])
    with pytest.raises(NothingToDrawError, match="tip"):
        vector_figure(Compared(model, observations, comparison), cases=[])
    with pytest.raises(NothingToDrawError, match="bone"):
        bone_figure(Compared(model, observations, nothing))
    with pytest.raises(NothingToDrawError):
        errors_figure([("model", nothing)])
    with pytest.raises(NothingToDrawError):
        z_figure([("model", nothing)])


# --- vectors


def heads(figure: go.Figure, kind: str) -> dict[str, tuple[Any, Any]]:
    """Shaft and head of every arrow of a kind, by case."""
    shafts = {t.meta["case"]: t for t in figure.data if isinstance(t.meta, dict) and t.meta.get("kind") == kind}
    ends = {t.meta["case"]: t for t in figure.data if isinstance(t.meta, dict) and t.meta.get("kind") == f"{kind}_head"}
    return {case: (shafts[case], ends[case]) for case in shafts}


def drawn_force(shaft: Any, head: Any) -> np.ndarray[Any, Any]:
    """Force (2,) [N] read off an arrow, from its foot to the point of its head."""
    return np.array([head.x[0] - shaft.x[0], head.y[0] - shaft.y[0]]) / shaft.meta["mm_per_N"]


@pytest.mark.parametrize("kind", ["measured", "predicted"])
def test_tip_arrows_are_the_forces_turned_into_the_metacarpal_frame(kind: str) -> None:
    model, observations, comparison = ordinary()
    arrows = heads(vector_figure(Compared(model, observations, comparison)), kind)
    cases = {c.id: c for c in comparison.select("validation", "tip").cases}
    assert set(arrows) == set(cases)
    for name, (shaft, head) in arrows.items():
        case = cases[name]
        turn = np.deg2rad(sum(POSTURES[case.posture]))
        force = case.measured_N if kind == "measured" else case.predicted_N
        expected = [
            np.cos(turn) * force[0] - np.sin(turn) * force[1],
            np.sin(turn) * force[0] + np.cos(turn) * force[1],
        ]
        assert drawn_force(shaft, head) == pytest.approx(expected, abs=1e-9)


def test_arrows_start_at_the_load_point_and_at_the_joint() -> None:
    model, observations, comparison = ordinary()
    values = model.finger.values
    for name, (shaft, _) in heads(vector_figure(Compared(model, observations, comparison)), "measured").items():
        case = next(c for c in comparison.cases if c.id == name)
        at, turn = np.zeros(2), 0.0
        points = [*np.asarray(values.centre)[1:], np.asarray(values.load_point)]
        for flexion, point in zip(POSTURES[case.posture], points, strict=True):
            turn += np.deg2rad(flexion)
            at += np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ point[:2]
        assert (shaft.x[0], shaft.y[0]) == pytest.approx(tuple(at))
    for shaft, _ in heads(bone_figure(Compared(model, observations, comparison)), "measured").values():
        assert (shaft.x[0], shaft.y[0]) == pytest.approx((0.0, 0.0))


def test_bone_arrows_are_in_the_metacarpal_frame_with_the_models_joint_load() -> None:
    model, observations, comparison = ordinary()
    figure = bone_figure(Compared(model, observations, comparison))
    loads = np.asarray(model.predict(observations.inputs).joint)[:, 0]
    for name, (shaft, head) in heads(figure, "joint").items():
        assert drawn_force(shaft, head) == pytest.approx(loads[observations.ids.index(name)][:2])
    for name, (shaft, head) in heads(figure, "predicted").items():
        case = next(c for c in comparison.cases if c.id == name)
        assert drawn_force(shaft, head) == pytest.approx(case.predicted_N[:2])


def test_flexion_turns_the_finger_palmar_and_distal_is_left() -> None:
    posture = np.zeros(len(finger().topology.rotations))
    straight = finger_pose(finger(), finger().values, posture).load_point
    posture[finger().topology.rotations.index("PIP")] = np.deg2rad(60)
    bent = finger_pose(finger(), finger().values, posture).load_point
    assert straight[0] < 0
    assert straight[1] == pytest.approx(0.0)
    assert bent[1] < -10


def test_the_drawn_pose_balances_the_models_own_forces() -> None:
    model, observations, _ = ordinary()
    prediction = model.predict(observations.inputs)
    for i in range(len(observations.ids)):
        pose = finger_pose(model.finger, model.finger.values, np.asarray(observations.inputs.posture)[i])
        pull = np.asarray(observations.inputs.tension)[i] @ np.asarray(model.finger.values.suture)
        total = np.asarray(prediction.forces.bone)[i] + pose.tip_rotation @ np.asarray(prediction.forces.tip)[i, :3]
        assert total == pytest.approx(pull, abs=1e-9)


def test_panels_share_one_scale_and_have_equal_axes() -> None:
    model, observations, comparison = ordinary()
    layout = vector_figure(Compared(model, observations, comparison)).layout
    margin = layout.margin
    per_mm = set()
    for x, y in ((layout.xaxis, layout.yaxis), (layout.xaxis2, layout.yaxis2), (layout.xaxis3, layout.yaxis3)):
        assert y.scaleratio == 1
        height = (y.domain[1] - y.domain[0]) * (layout.height - margin.t - margin.b)
        per_mm.add(round(height / (y.range[1] - y.range[0]), 2))
        width = (x.domain[1] - x.domain[0]) * (layout.width - margin.l - margin.r)
        assert width / (x.range[1] - x.range[0]) >= height / (y.range[1] - y.range[0]) * 0.995
    assert len(per_mm) == 1


def test_a_crowded_posture_shows_the_heaviest_loads_and_says_so() -> None:
    model, observations, comparison = session(many_rows())
    figure = vector_figure(Compared(model, observations, comparison))
    arrows = heads(figure, "measured")
    shown = [c for c in comparison.cases if c.id in arrows]
    assert len(shown) < len(comparison.cases)
    assert max(sum(c.posture == p for c in shown) for p in POSTURES) <= MAX_LOADS + 1
    assert all(c.masses_g.get("RI", 650.0) in (650.0, 300.0) for c in shown)
    assert f"{len(shown)} of 96 cases" in figure.layout.title.subtitle.text


# --- areas


def a_case(force: Sequence[float], sd: Sequence[float], name: str = "c1") -> CaseComparison:
    return CaseComparison(
        name, "validation", "hook", "tip", BOTH, np.array(force), np.array(sd), np.zeros(3), None, None, None
    )


def test_areas_prefer_specimens_then_the_measurement_then_ten_percent() -> None:
    case = a_case((3.0, 4.0, 0.0), (0.5, 0.5, 0.1))
    between = area_of(case, False, {"c1": Spread(0.7, 4.0)})
    assert (between.magnitude_N, between.direction_deg, between.meaning) == (0.7, 4.0, BETWEEN)
    measured = area_of(case, False, None)
    assert measured.meaning == MEASURED
    assert measured.magnitude_N == pytest.approx(0.5)
    assert measured.direction_deg == pytest.approx(np.rad2deg(np.arctan(0.1)))
    for area in (area_of(case, True, {}), area_of(a_case((3.0, 4.0, 0.0), (0.0, 0.0, 0.0)), False, None)):
        assert (area.magnitude_N, area.direction_deg) == pytest.approx((0.5, 10.0))
        assert area.meaning == NOMINAL


def test_a_sector_spans_its_magnitudes_and_directions() -> None:
    area = area_of(a_case((0.0, -2.0, 0.0), (0.0, 0.0, 0.0)), True, None)
    outline = sector(np.array([0.0, -2.0]), area, np.array([5.0, 6.0, 0.0]), 10.0)
    x, y = (outline - [5.0, 6.0]).T / 10.0
    norms, angles = np.hypot(x, y), np.rad2deg(np.arctan2(y, x))
    assert (norms.min(), norms.max()) == pytest.approx((1.8, 2.2))
    assert (angles.min(), angles.max()) == pytest.approx((-100.0, -80.0))


def test_spread_between_specimens_is_that_of_magnitude_and_direction() -> None:
    forces = [(1.0, 0.0), (0.0, 2.0), (-3.0, 0.0)]
    specimens = [Comparison((a_case((*f, 0.0), (0.1, 0.1, 0.1), f"s{i}"),), False) for i, f in enumerate(forces)]
    reference = Comparison((a_case((1.0, 1.0, 0.0), (0.1, 0.1, 0.1), "mean"),), False)
    spread = spread_between(reference, specimens)
    assert list(spread) == ["mean"]
    assert (spread["mean"].magnitude_N, spread["mean"].direction_deg) == pytest.approx((1.0, 90.0))
    assert spread_between(reference, specimens[:1]) == {}


# --- style


def test_every_tendon_has_its_own_colour_and_symbol_everywhere() -> None:
    known = {k: v for k, v in TENDONS.items() if k != "none"}
    assert len({s.color for s in known.values()}) == len({s.symbol for s in known.values()}) == len(known)
    mixed = load_styles(["FCI", "FDP", "PI", "FDP+FCI"])
    assert mixed["FDP"] == TENDONS["FDP"]
    assert len(set(mixed.values())) == 4
    _, _, comparison = ordinary()
    figure = scatter_figure([("m", comparison)])
    for trace in figure.data:
        if trace.name in TENDONS:
            assert (trace.marker.color, trace.marker.symbol) == (TENDONS[trace.name].color, TENDONS[trace.name].symbol)


def test_the_scatter_holds_every_component_once_on_equal_axes() -> None:
    _, _, comparison = ordinary()
    figure = scatter_figure([("m", comparison)], plane="space")
    measured = sorted(c.measured_N[2] for c in comparison.select("identification", "tip").cases)
    third = [t for t in figure.data if t.xaxis == "x3" and t.mode == "markers"]
    assert sorted(v for t in third for v in t.x) == pytest.approx(measured)
    assert figure.layout.xaxis3.range == figure.layout.yaxis3.range
    assert figure.layout.yaxis3.scaleanchor == "x3"
    assert "in space" in figure.layout.annotations[0].text


def test_z_rows_hold_every_case_and_the_limit() -> None:
    _, _, comparison = ordinary()
    figure = z_figure([("model", comparison)])
    drawn = [case for t in figure.data if isinstance(t.meta, dict) for case in t.meta["cases"]]
    assert sorted(drawn) == sorted(c.id for c in comparison.cases)
    assert figure.data[0].x == pytest.approx((2.7955, 2.7955), abs=1e-4)


def test_numbers_read_as_printed_ones() -> None:
    assert [number(v) for v in (0.1234, -1.5, 0.0, 0.00012, None, float("nan"))] == [
        "0.12",
        "−1.50",
        "0.00",
        "0.00012",
        "–",
        "–",
    ]
    assert [posture_name(n) for n in ("major_flexion", "HyperExt", "hook")] == ["Major flexion", "Hyper ext", "Hook"]


def test_the_package_alone_loads_no_drawing_library() -> None:
    code = "import sys, server.figures; print([m for m in ('plotly', 'matplotlib', 'jax') if m in sys.modules])"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)  # noqa: S603
    assert out.stdout.strip() == "[]"


def test_a_load_has_one_name_and_style_in_whatever_order_it_was_written() -> None:
    assert load_text({"LU": 200.0, "EDC": 0.0, "FDP": 600.0}) == "FDP+LU 600 + 200 g"
    assert load_text({"FDS": 300.0, "FDP": 300.0}) == load_text({"FDP": 300.0, "FDS": 300.0})
    # The palette knows combinations by the same names.
    assert all(name == "+".join(sorted(name.split("+"))) for name in TENDONS)
