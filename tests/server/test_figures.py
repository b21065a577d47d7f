"""Figures and reports: drawn for ordinary and awkward sessions, true to the forces, and without a browser."""

from __future__ import annotations

import io
import json
import re
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import plotly.graph_objects as go
import pytest
from matplotlib.image import imread

from fingermodel.comparison import CaseComparison, Comparison, compare
from fingermodel.finger_files import read_finger
from fingermodel.fingers import Finger
from fingermodel.model import Model
from fingermodel.observations import Observations
from fingermodel.reading_noise import Noise
from fingermodel.stages import Layout, LoadCaseInput
from server.figures.arrows import BETWEEN, MEASURED, NOMINAL, Spread, area_of, sector, spread_between
from server.figures.bone import bone_figure
from server.figures.comparison import comparison_figures, comparison_report
from server.figures.panels import MAX_LOADS
from server.figures.poses import finger_pose
from server.figures.report import Picture, Section, Table, report_html, write_report
from server.figures.scatter import scatter_figure
from server.figures.static import UnsupportedFigureError, render, write_static
from server.figures.style import TENDONS, NothingToDrawError, load_styles, number, posture_name
from server.figures.summary import errors_figure
from server.figures.vectors import vector_figure
from server.figures.zscores import z_figure

POSTURES = {"hook": (0.0, 65.0, 50.0), "minor_flexion": (40.0, 55.0, 35.0), "hyperextension": (-20.0, 50.0, 45.0)}
SINGLES = {"RI": 650.0, "LU": 45.0, "UI": 500.0, "FDP": 950.0, "FDS": 950.0, "EDC": 400.0}
BOTH = {"FDP": 950.0, "FDS": 950.0}
HOSTILE = "</script><script>alert('x')</script> <b>& $x_1$"


class Row(NamedTuple):
    role: str
    posture: str
    location: str
    masses_g: dict[str, float]


class Session(NamedTuple):
    model: Model
    observations: Observations
    comparison: Comparison


@cache
def finger() -> Finger:
    return read_finger("an1979_middle")


def session(rows: Sequence[Row], *, sd: float = 0.05, scale: float = 1.0, assumed: bool = False) -> Session:
    """A session whose readings are the model's own with noise, and weights scaled."""
    topology, names = finger().topology, list(dict.fromkeys(r.posture for r in rows))
    flexion = {j.name: topology.rotations.index(j.name) for j in topology.joints}
    posture, tension = np.zeros((len(rows), len(topology.rotations))), np.zeros((len(rows), len(topology.muscles)))
    for i, row in enumerate(rows):
        for joint, angle in zip(("MCP", "PIP", "DIP"), POSTURES[row.posture], strict=True):
            posture[i, flexion[joint]] = np.deg2rad(angle)
        for muscle, mass in row.masses_g.items():
            tension[i, topology.muscles.index(muscle)] = scale * mass * 9.81e-3 * 0.835
    at_bone = np.array([float(r.location == "bone") for r in rows])
    count = len(rows)
    setting = np.array([names.index(r.posture) for r in rows])
    unused = np.zeros((count, 3)), np.zeros(count)
    inputs = LoadCaseInput(
        *map(jnp.asarray, (posture, tension, at_bone, *unused, setting, at_bone.astype(int), *[np.zeros(count)] * 4))
    )
    layout = Layout(tuple((n, 0) for n in names), (("tip", 0), ("bone", 0)))
    model = Model(finger(), layout)
    wrench = np.asarray(model.predict(inputs).reading).copy()
    wrench[:, :3] += max(sd, 0.03 * scale) * np.random.default_rng(7).standard_normal((count, 3))
    observations = Observations(
        ids=tuple(f"c{i:03d}" for i in range(count)),
        roles=tuple(r.role for r in rows),
        postures=tuple(r.posture for r in rows),
        locations=tuple(r.location for r in rows),
        masses_g=tuple(r.masses_g for r in rows),
        inputs=inputs,
        wrench=wrench,
        noise=Noise(np.tile(np.diag([sd**2] * 3 + [1.0] * 3), (count, 1, 1))),
        layout=layout,
        noise_assumed=assumed,
    )
    return Session(model, observations, compare(model, observations))


def ordinary_rows(postures: Sequence[str] = tuple(POSTURES)) -> list[Row]:
    rows = []
    for posture in postures:
        rows += [Row("identification", posture, "tip", {m: mass}) for m, mass in SINGLES.items()]
        for level in (0.3, 1.0):
            masses = {m: level * mass for m, mass in BOTH.items()}
            rows += [Row("validation", posture, "tip", masses), Row("validation", posture, "bone", masses)]
    return rows


@cache
def ordinary() -> Session:
    return session(ordinary_rows())


def many_rows() -> list[Row]:
    """96 cases: levels of every tendon and of pairs, a posture with more loads than fit in a panel."""
    loads = [{m: level * mass} for m, mass in SINGLES.items() for level in (0.2, 0.4, 0.6, 1.0)]
    loads += [{"FDP": level * 900, other: level * 300} for other in ("EDC", "LU", "UI", "RI") for level in (0.5, 1.0)]
    rows = [Row("identification", p, "tip", load) for p in POSTURES for load in loads]
    return rows[:96]


def only(keep: Callable[[CaseComparison], bool]) -> Session:
    """The ordinary session with some of its cases."""
    model, observations, comparison = ordinary()
    return Session(model, observations, replace(comparison, cases=tuple(c for c in comparison.cases if keep(c))))


AWKWARD: dict[str, tuple[Callable[[], Session], set[str]]] = {
    "one posture": (lambda: only(lambda c: c.posture == "hook"), set()),
    "no bone": (lambda: only(lambda c: c.location == "tip"), {"bone"}),
    "no validation": (lambda: only(lambda c: c.role == "identification"), {"scatter_validation", "bone"}),
    "one case": (lambda: only(lambda c: c.id == "c007"), {"scatter", "scatter_validation", "vectors"}),
    "many": (lambda: session(many_rows()), {"scatter_validation", "bone"}),
    "tiny": (lambda: session(ordinary_rows(), sd=1e-9, scale=1e-6), set()),
    "no force": (lambda: session([r._replace(masses_g={}) for r in ordinary_rows()], sd=0.0, scale=0.0), {"z"}),
    "assumed": (lambda: session(ordinary_rows(), assumed=True), set()),
}


@pytest.mark.parametrize("name", list(AWKWARD))
def test_awkward_sessions_give_every_figure_that_they_can(name: str) -> None:
    make, missing = AWKWARD[name]
    model, observations, comparison = make()
    figures = comparison_figures(model, observations, comparison)
    assert set(figures) == {"scatter", "scatter_validation", "vectors", "bone", "errors", "z"} - missing
    for figure in figures.values():
        text = figure.to_json()
        assert "bdata" not in text, "numbers stay readable"
        assert len(render(json.loads(text), "svg")) > 1000


def test_before_and_after_are_both_drawn_and_written(tmp_path: Path) -> None:
    model, observations, comparison = ordinary()
    figures = comparison_figures(model, observations, comparison, comparison, "First guess", model_name="Fitted")
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
    assert len(figures["errors"].data) == 2 * len(errors_figure(comparison).data)


def test_empty_selections_say_so() -> None:
    nothing = Comparison((), noise_assumed=False)
    model, observations, comparison = ordinary()
    with pytest.raises(NothingToDrawError, match="tip"):
        scatter_figure([("model", nothing)])
    with pytest.raises(NothingToDrawError, match="tip"):
        vector_figure(model, observations, comparison, cases=[])
    with pytest.raises(NothingToDrawError, match="bone"):
        bone_figure(model, observations, nothing)
    with pytest.raises(NothingToDrawError):
        errors_figure(nothing)
    with pytest.raises(NothingToDrawError):
        z_figure(nothing)


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
    arrows = heads(vector_figure(model, observations, comparison), kind)
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
    for name, (shaft, _) in heads(vector_figure(model, observations, comparison), "measured").items():
        case = next(c for c in comparison.cases if c.id == name)
        at, turn = np.zeros(2), 0.0
        points = [*np.asarray(values.centre)[1:], np.asarray(values.load_point)]
        for flexion, point in zip(POSTURES[case.posture], points, strict=True):
            turn += np.deg2rad(flexion)
            at += np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ point[:2]
        assert (shaft.x[0], shaft.y[0]) == pytest.approx(tuple(at))
    for shaft, _ in heads(bone_figure(model, observations, comparison), "measured").values():
        assert (shaft.x[0], shaft.y[0]) == pytest.approx((0.0, 0.0))


def test_bone_arrows_are_in_the_metacarpal_frame_with_the_models_joint_load() -> None:
    model, observations, comparison = ordinary()
    figure = bone_figure(model, observations, comparison)
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
    layout = vector_figure(model, observations, comparison).layout
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
    figure = vector_figure(model, observations, comparison)
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


# --- reports


class Links(HTMLParser):
    """Collects what a page would fetch, its scripts' number and its plain text."""

    def __init__(self) -> None:
        super().__init__()
        self.links: list[str] = []
        self.scripts = 0
        self.words: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.links += [str(v) for k, v in attrs if k in ("src", "href", "data", "action", "srcset")]
        self.scripts += tag == "script"

    def handle_data(self, data: str) -> None:
        self.words.append(data)


def test_the_report_is_one_file_that_fetches_nothing(tmp_path: Path) -> None:
    model, observations, comparison = ordinary()
    rows = [c for c in comparison.cases if c.location == "tip"]
    part = Comparison(tuple(rows), comparison.noise_assumed)
    written = comparison_report(tmp_path, model, observations, part, session=HOSTILE, model_name=HOSTILE, static=False)
    assert written == [tmp_path / "compare.html"]
    assert list(tmp_path.iterdir()) == written
    text = written[0].read_text(encoding="utf-8")
    page = Links()
    page.feed(text)
    assert page.links
    assert all(link.startswith("#") for link in page.links)
    assert page.scripts == 2, "Plotly and the figures; a hostile name adds none"
    assert text.count("plotly.js v") == 1
    assert "default-src 'none'" in text
    assert '"showSendToCloud": false' in text
    assert HOSTILE not in text
    words = "".join(page.words)
    assert HOSTILE in words, "the name is still to be read"
    assert "No figure: no force was measured at the bone." in words


def test_figures_of_a_hostile_model_name_are_drawn(tmp_path: Path) -> None:
    model, observations, comparison = ordinary()
    write_static(tmp_path, {"vectors": vector_figure(model, observations, comparison, model_name=HOSTILE)})
    assert "&lt;/script&gt;&lt;script&gt;" in (tmp_path / "vectors.svg").read_text(encoding="utf-8")


def test_figure_data_cannot_end_the_script() -> None:
    figure = go.Figure(go.Scatter(x=[1], y=[1], name="</script><img src=x>\u2028"))
    page = report_html([Section("A", [Picture(figure, "c"), Table(["h"], [["<i>"]], "t"), "p"])], "T")
    tail = page[page.rindex("const figures") :]
    assert "</script><img" not in tail
    assert "\u2028" not in page
    found = re.search(r"const figures = (.*);\n", tail)
    assert found
    assert json.loads(found[1])[0]["data"][0]["name"] == figure.data[0].name
    assert "&lt;i&gt;" in page


def test_a_report_without_figures_needs_no_script(tmp_path: Path) -> None:
    path = write_report(tmp_path / "new" / "r.html", [Section("A b", ["x"]), Section("A b", ["y"])], "T", "s")
    text = path.read_text(encoding="utf-8")
    assert "<script" not in text
    assert len(set(re.findall(r'<section id="([^"]+)"', text))) == 2


# --- without a browser


def small(data: Sequence[Any], **layout: Any) -> go.Figure:
    base = {"template": {}, "width": 200, "height": 200, "margin": {"l": 0, "r": 0, "t": 0, "b": 0}}
    plain = {"range": [0, 4], "showgrid": False, "zeroline": False, "showticklabels": False}
    return go.Figure(data=list(data), layout=base | {"xaxis": plain, "yaxis": plain} | layout)


def pixel(figure: go.Figure, x: float, y: float) -> tuple[int, ...]:
    """Colour at a point given in hundredths of the picture from its lower left."""
    picture = imread(io.BytesIO(render(figure, "png", scale=1.0)), format="png")
    height, width = picture.shape[:2]
    return tuple(round(255 * float(v)) for v in picture[int(height * (1 - y / 100)), int(width * x / 100)][:3])


RED, BLUE, WHITE = (255, 0, 0), (0, 0, 255), (255, 255, 255)


def test_points_lines_and_areas_land_where_they_belong() -> None:
    marker = {"color": ["#ff0000", "rgb(0,0,255)"], "size": [20, 16], "symbol": ["square", "circle"]}
    points = go.Scatter(x=[1, 3], y=[3, 1], mode="markers", marker=marker)
    assert pixel(small([points]), 25, 75) == RED
    assert pixel(small([points]), 75, 25) == BLUE
    assert pixel(small([points]), 50, 50) == WHITE
    area = go.Scatter(
        x=[0, 2, 2, 0, None, 3, 4, 4, 3],
        y=[0, 0, 2, 2, None, 3, 3, 4, 4],
        mode="lines",
        fill="toself",
        fillcolor="#ff0000",
        line={"width": 0},
    )
    assert pixel(small([area]), 25, 25) == RED
    assert pixel(small([area]), 87, 87) == RED
    assert pixel(small([area]), 63, 63) == WHITE
    half = {"range": [0, 4], "domain": [0.5, 1], "visible": False}
    assert pixel(small([points], xaxis=half), 62, 75) == RED
    line = go.Scatter(x=[0, 4], y=[2, 2], mode="lines", line={"color": "blue", "width": 6})
    assert pixel(small([line]), 40, 50) == BLUE
    rising = {"type": "log", "range": [0, 2], "visible": False}
    ten = go.Scatter(x=[10], y=[2], mode="markers", marker={"color": "red", "size": 20})
    assert pixel(small([ten], xaxis=rising), 50, 50) == RED


def test_bars_stand_beside_and_upon_each_other() -> None:
    words = {"type": "category", "visible": False}
    bars = [go.Bar(x=["a"], y=[4], marker={"color": "red"}), go.Bar(x=["a"], y=[2], marker={"color": "blue"})]
    beside = small(bars, xaxis=words, barmode="group", bargap=0.0)
    assert pixel(beside, 25, 75) == RED
    assert pixel(beside, 75, 25) == BLUE
    assert pixel(beside, 75, 75) == WHITE
    halves = [go.Bar(x=["a"], y=[2], marker={"color": c}) for c in ("red", "blue")]
    upon = small(halves, xaxis=words, barmode="stack", bargap=0.0)
    assert (pixel(upon, 50, 25), pixel(upon, 50, 75)) == (RED, BLUE)
    floating = go.Bar(x=[1], y=["a"], base=[2], orientation="h", marker={"color": "red"})
    across = small([floating], yaxis=words)
    assert (pixel(across, 25, 50), pixel(across, 62, 50), pixel(across, 87, 50)) == (WHITE, RED, WHITE)


def test_heatmaps_shapes_and_arrows_are_drawn() -> None:
    scale = [[0, "#0000ff"], [1, "#ff0000"]]
    words = {"type": "category", "visible": False}
    cells = go.Heatmap(x=["a", "b"], y=["c", "d"], z=[[0, 1], [None, 0]], colorscale=scale, showscale=False)
    grid = small([cells], xaxis=words, yaxis=words)
    assert (pixel(grid, 25, 25), pixel(grid, 75, 25), pixel(grid, 25, 75)) == (BLUE, RED, WHITE)
    box = {"type": "rect", "x0": 0, "x1": 1, "y0": 0, "y1": 0.5, "xref": "paper", "yref": "paper", "fillcolor": "red"}
    assert pixel(small([], shapes=[box]), 50, 25) == RED
    arrow = {
        "x": 4,
        "y": 2,
        "ax": 0,
        "ay": 2,
        "xref": "x",
        "yref": "y",
        "axref": "x",
        "ayref": "y",
        "text": "",
        "arrowwidth": 4,
        "arrowcolor": "#0000ff",
    }
    assert pixel(small([], annotations=[arrow]), 30, 50) == BLUE
    rich = go.Figure(
        data=[
            go.Heatmap(
                x=["a", "b"],
                y=["c"],
                z=[[1.0, -2.0]],
                text=[["1", "-2"]],
                texttemplate="%{text}",
                zmid=0,
                colorscale="RdBu",
                xgap=2,
                colorbar={"title": {"text": "z [1]"}, "thickness": 12, "len": 0.5},
            )
        ],
        layout={
            "template": {},
            "xaxis": {"type": "category"},
            "yaxis": {"type": "category"},
            "title": {"text": "<b>t</b>"},
        },
    )
    assert b"z [1]" in render(rich, "svg")


def test_error_bars_texts_and_legends_are_drawn() -> None:
    figure = go.Figure(
        data=[
            go.Scatter(
                x=[1, 2],
                y=[1, 2],
                mode="markers+text",
                text=["first", "second"],
                textposition="top center",
                error_y={"type": "data", "array": [0.1, 0.2]},
                error_x={"type": "data", "array": [0.1, 0.2], "arrayminus": [0.3, 0.1]},
                name="series",
            ),
            go.Bar(x=[1, 2], y=[1, 1], name="bars", text=["u", "v"], textposition="outside"),
        ],
        layout={"template": {}, "legend": {"orientation": "h", "title": {"text": "key"}}},
    )
    drawn = render(figure, "svg").decode()
    for word in ("first", "second", "series", "bars", "key", "u"):
        assert f">{word}<" in drawn


def test_a_figure_drawn_twice_gives_the_same_bytes() -> None:
    model, observations, comparison = ordinary()
    figure = vector_figure(model, observations, comparison)
    assert render(figure, "svg") == render(figure, "svg")
    assert render(z_figure(comparison), "png") == render(z_figure(comparison), "png")
    assert b"<dc:date>" not in render(errors_figure(comparison), "svg")


@pytest.mark.parametrize(
    ("figure", "words"),
    [
        (small([go.Pie(values=[1])]), "is a pie"),
        (small([go.Scatter3d(x=[1], y=[1], z=[1])]), "is a scatter3d"),
        (small([go.Scatter(x=[1], y=[1], fill="tonexty")]), "fill 'tonexty'"),
        (small([go.Scatter(x=[1], y=[1], line={"shape": "spline"})]), "shape 'spline'"),
        (small([go.Scatter(x=[1], y=[1], marker={"symbol": "star-diamond"})]), "star-diamond"),
        (small([go.Scatter(x=[1], y=[1], marker={"colorscale": "Viridis"})]), "colorscale"),
        (small([go.Scatter(x=["word"], y=[1])]), "type='category'"),
        (small([go.Bar(x=[1], y=[1], marker={"pattern": {"shape": "/"}})]), "pattern"),
        (small([go.Bar(x=[1], y=[1], text="t")]), "textposition"),
        (small([], yaxis2={"overlaying": "y"}), "overlaying"),
        (small([], yaxis={"scaleanchor": "x2"}), "scaled to x2"),
        (small([], annotations=[{"text": "a<sub>b</sub>", "x": 1, "y": 1, "showarrow": False}]), "<sub>"),
        (small([], shapes=[{"type": "circle"}]), "type 'circle'"),
        (small([], images=[{"source": "x"}]), "images"),
        (go.Figure(go.Scatter(x=[1], y=[1])), "template"),
    ],
)
def test_what_is_not_drawn_is_refused(figure: go.Figure, words: str) -> None:
    with pytest.raises(UnsupportedFigureError, match=re.escape(words)):
        render(figure, "svg")


def test_an_unknown_format_is_refused() -> None:
    with pytest.raises(ValueError, match="pdf"):
        render(small([]), "pdf")


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
    figure = z_figure(comparison)
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
