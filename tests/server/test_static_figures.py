"""Figures drawn without a browser: everything lands where it belongs, and the same bytes come twice."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from unittest.mock import patch

import plotly.graph_objects as go
import pytest
from matplotlib.image import imread

from server.figures.compared import Compared
from server.figures.static import UnsupportedFigureError, render, write_static
from server.figures.static_axes import finish_axes
from server.figures.summary import errors_figure
from server.figures.vectors import vector_figure
from server.figures.zscores import z_figure
from tests.server.compared_sessions import ordinary


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


def test_bars_stand_beside_and_before_each_other() -> None:
    words = {"type": "category", "visible": False}
    bars = [go.Bar(x=["a"], y=[4], marker={"color": "red"}), go.Bar(x=["a"], y=[2], marker={"color": "blue"})]
    beside = small(bars, xaxis=words, barmode="group", bargap=0.0)
    assert pixel(beside, 25, 75) == RED
    assert pixel(beside, 75, 25) == BLUE
    assert pixel(beside, 75, 75) == WHITE
    before = small(bars, xaxis=words, barmode="overlay", bargap=0.0)
    assert (pixel(before, 50, 75), pixel(before, 50, 25)) == (RED, BLUE)
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
                colorscale=scale,
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
                marker={"color": "red"},
            ),
            go.Bar(x=[1, 2], y=[1, 1], name="bars", text=["u", "v"], textposition="outside", marker={"color": "blue"}),
        ],
        layout={"template": {}, "legend": {"orientation": "h", "title": {"text": "key"}}},
    )
    drawn = render(figure, "svg").decode()
    for word in ("first", "second", "series", "bars", "key", "u"):
        assert f">{word}<" in drawn


def test_a_figure_drawn_twice_gives_the_same_bytes() -> None:
    model, observations, comparison = ordinary()
    figure = vector_figure(Compared(model, observations, comparison))
    assert render(figure, "svg") == render(figure, "svg")
    assert render(z_figure([("model", comparison)]), "png") == render(z_figure([("model", comparison)]), "png")
    assert b"<dc:date>" not in render(errors_figure([("model", comparison)]), "svg")


def test_both_files_of_a_figure_come_of_one_layout_and_are_what_each_is_alone(tmp_path: Path) -> None:
    model, observations, comparison = ordinary()
    figures = {"vectors": vector_figure(Compared(model, observations, comparison)), "z": z_figure([("m", comparison)])}
    alone = {f"{n}.{kind}": render(figure, kind) for n, figure in figures.items() for kind in ("png", "svg")}
    with patch("server.figures.static.finish_axes", wraps=finish_axes) as laid_out:
        written = write_static(tmp_path, figures)
    assert {path.name: path.read_bytes() for path in written} == alone
    assert laid_out.call_count == len(figures)


@pytest.mark.parametrize(
    ("figure", "words"),
    [
        (small([go.Pie(values=[1])]), "is a pie"),
        (small([go.Scatter3d(x=[1], y=[1], z=[1])]), "is a scatter3d"),
        (small([go.Scatter(x=[1], y=[1], fill="tonexty")]), "fill 'tonexty'"),
        (small([go.Scatter(x=[1], y=[1], line={"shape": "spline"})]), "shape 'spline'"),
        (
            small([go.Scatter(x=[1], y=[1], mode="markers", marker={"symbol": "star-diamond", "color": "red"})]),
            "star-diamond",
        ),
        (small([go.Scatter(x=[1], y=[1], marker={"colorscale": "Viridis"})]), "colorscale"),
        (small([go.Scatter(x=["word"], y=[1], mode="markers", marker={"color": "red"})]), "type='category'"),
        (small([go.Scatter(x=[1], y=[1])]), "no mode"),
        (small([go.Scatter(x=[1], y=[1], mode="lines")]), "no line.color"),
        (small([go.Scatter(x=[1], y=[1], mode="markers")]), "no marker.color"),
        (small([go.Scatter(x=[1], y=[1], mode="none", fill="toself")]), "no fillcolor"),
        (small([go.Bar(x=[1], y=[1], marker={"pattern": {"shape": "/"}})]), "pattern"),
        (small([go.Bar(x=[1], y=[1])]), "no marker.color"),
        (small([go.Bar(x=[1], y=[1], text="t", marker={"color": "red"})]), "no textposition"),
        (small([], barmode="stack"), "barmode 'stack'"),
        (small([go.Heatmap(z=[[1]], zmid=0)]), "zmid"),
        (small([go.Heatmap(z=[[1]])]), "no colorscale"),
        (small([], annotations=[{"text": "", "x": 1, "y": 1, "ax": 5, "ay": 5, "arrowhead": 2}]), "in pixels"),
        (small([], yaxis2={"overlaying": "y"}), "overlaying"),
        (small([], yaxis={"scaleanchor": "x2"}), "scaled to x2"),
        (small([], annotations=[{"text": "a<sub>b</sub>", "x": 1, "y": 1, "showarrow": False}]), "<sub>"),
        (small([], shapes=[{"type": "circle"}]), "type 'circle'"),
        (small([], images=[{"source": "x"}]), "images"),
        (go.Figure(go.Scatter(x=[1], y=[1], mode="markers", marker={"color": "red"})), "template"),
    ],
)
def test_what_is_not_drawn_is_refused(figure: go.Figure, words: str) -> None:
    with pytest.raises(UnsupportedFigureError, match=re.escape(words)):
        render(figure, "svg")


def test_an_unknown_format_is_refused() -> None:
    with pytest.raises(ValueError, match="pdf"):
        render(small([]), "pdf")


def test_a_name_in_another_script_is_drawn_without_a_warning_and_kept_as_text() -> None:
    """Warnings are errors here; what no installed font holds is a box in the PNG alone."""
    named = small([], annotations=[{"text": "样本 三", "x": 2, "y": 2, "showarrow": False}])
    assert render(named, "png").startswith(b"\x89PNG")
    assert "样本 三" in render(named, "svg").decode("utf-8")
