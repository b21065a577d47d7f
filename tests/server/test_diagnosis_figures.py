"""Figures of a diagnosis: drawn from its answer alone, whatever it holds."""

from __future__ import annotations

import math
from collections.abc import Callable

import plotly.graph_objects as go
import pytest

from server.figures.diagnosis_answer import (
    effect_name,
    explanation_name,
    named_rows,
    probability_text,
    ranked,
    with_sd,
)
from server.figures.diagnosis_confounding import confounding_figure
from server.figures.diagnosis_held_out import held_out, held_out_figure
from server.figures.diagnosis_map import residual_map
from server.figures.diagnosis_ranking import MOST_ROWS, ranking_figure
from server.figures.diagnosis_revisions import revisions_figure, steps_of
from server.figures.diagnosis_sensitivity import assumptions, sensitivity_figure
from server.figures.diagnosis_size import curves, size_figure
from server.figures.diagnosis_torque import torque_figure
from server.figures.shared_law import own_curve_figure
from server.figures.style import NothingToDrawError
from tests.server.diagnosis_answers import HISTORY, found, none_of_catalogue, nothing_missing, one_of, undecided
from tests.server.diagnosis_pages import bars
from tests.server.diagnosis_parts import EFFECTS, MASSES, Answer, assumed, row

# --- where the model fails


def test_the_map_holds_every_tested_cell_and_no_other() -> None:
    figure = residual_map(found())
    tip, bone = figure.data
    cells = found()["where"]["cells"]
    assert sum(v is not None for panel in (tip, bone) for line in panel.z for v in line) == len(cells)
    assert list(figure.layout.yaxis.ticktext) == ["FDP", "FDS", "EDC", "RI", "UI", "LU", "FDP+FDS"]
    assert figure.layout.xaxis.ticktext == figure.layout.xaxis2.ticktext
    one = next(c for c in cells if (c["muscles"], c["posture"], c["location"]) == ("LU", "hook", "tip"))
    assert tip.text[5][2] == f"{one['z_rms']:.1f}"
    assert tip.z[5][2] == pytest.approx(math.log10(one["z_rms"]))
    assert [[v for v in line if v is not None] for line in bone.z][:6] == [[]] * 6
    assert [n.text for n in figure.layout.annotations] == ["<b>Cell at the tip</b>", "<b>Cell at the bone</b>"]


def test_cells_that_come_twice_are_pooled_and_colours_end_at_twenty() -> None:
    cell = {"muscles": ["FDP", "LU"], "posture": "hook", "location": "tip", "cases": 1, "rmse_N": 0.1, "z_rms": 3.0}
    figure = residual_map({"where": {"cells": [cell, cell | {"cases": 3, "z_rms": 5.0}]}})
    assert figure.data[0].text[0][0] == f"{math.sqrt((9 + 3 * 25) / 4):.1f}"
    assert list(figure.layout.yaxis.ticktext) == ["FDP+LU"]
    figure = residual_map({"where": {"cells": [cell | {"z_rms": 1e4}, cell | {"posture": "b", "z_rms": 0.01}]}})
    assert figure.data[0].z[0] == pytest.approx((math.log10(20), math.log10(0.5)))
    assert figure.data[0].text[0][0] == "10000"


def test_an_error_of_a_tension_is_named_by_its_tendon_alone() -> None:
    curve = none_of_catalogue()["curve"]
    parts = [{**p, "joint": ""} for p in curve["parts"]]
    figure = own_curve_figure({"curve": {**curve, "stage": "tension", "parts": parts}})
    assert "<b>FDS, 4.0 nat</b>" in [n.text for n in figure.layout.annotations]


def test_torque_of_alike_cases_is_their_mean() -> None:
    one = {"id": "a", "posture": "hook", "muscles": "FDP", "torque_Nmm": {"PIP": 4.0, "MCP": 0.5}}
    cases = [one | {"sd_Nmm": {"PIP": 0.6, "MCP": 1.0}}]
    cases += [one | {"id": "b", "torque_Nmm": {"PIP": 2.0}, "sd_Nmm": {"PIP": 0.8}}]
    figure = torque_figure({"where": {"joint_torque_cases": cases}})
    by_joint = {t.xaxis: t for t in bars(figure)}
    assert by_joint["x"].x == (0.5,)
    assert by_joint["x2"].x == (3.0,)
    assert by_joint["x2"].error_x.array == pytest.approx((0.5,))
    assert by_joint["x2"].name == "beyond two standard deviations"
    assert by_joint["x"].name == "within them"


def test_many_groups_leave_the_clearest_and_no_cases_the_joints() -> None:
    case = {"muscles": "FDP", "sd_Nmm": {"PIP": 1.0}}
    cases = [case | {"id": str(k), "posture": f"p{k}", "torque_Nmm": {"PIP": 0.1 * k}} for k in range(60)]
    figure = torque_figure({"where": {"joint_torque_cases": cases}})
    assert sum(len(t.x) for t in bars(figure)) == 40
    assert min(v for t in bars(figure) for v in t.x) == pytest.approx(2.0)
    assert "40 clearest of 60" in figure.layout.title.subtitle.text
    answer = found()
    answer["where"]["joint_torque_cases"] = []
    figure = torque_figure(answer)
    assert [t.x[0] for t in bars(figure)] == [3.1, 6.0, 1.0]
    assert "root mean square" in figure.layout.yaxis.ticktext[0]


# --- which explanation


def test_the_ranking_shows_nothing_and_something_else_however_improbable() -> None:
    answer = found()
    figure = ranking_figure(answer)
    kinds = {t.name: t for t in bars(figure)}
    assert len({t.marker.color for t in figure.data if t.type == "scatter"}) == len(kinds) == 3
    places = [p for t in bars(figure) for p in t.y]
    assert sorted(places) == list(range(MOST_ROWS + 1))
    assert kinds["nothing missing"].y == (MOST_ROWS,)
    assert kinds["nothing missing"].text == ("&lt;0.001",)
    assert "6 more" in figure.layout.title.subtitle.text
    words = [n.text for n in figure.layout.annotations]
    assert "<b>hanger mass</b>" in words
    assert "0.171 → 0.031" in words
    assert "0.19 (0.17–0.21)" in words
    assert "zero offset tip *" in words
    assert len(figure.layout.shapes) == 1


def test_explanations_that_were_not_weighed_are_not_drawn() -> None:
    answer = one_of()
    answer["ranking"] += [row(["axis_tilt"], 0.0, 99.0, None)]
    assert "axis tilt" not in [n.text for n in ranking_figure(answer).layout.annotations]
    answer |= {"verdict": "found", "effects": ["axis_tilt"]}
    assert "<b>axis tilt</b>" in [n.text for n in ranking_figure(answer).layout.annotations]


def test_rows_that_the_verdict_names_are_found() -> None:
    def named(answer: Answer) -> list[str]:
        return [explanation_name(r) for r in named_rows(answer)]

    assert named(found()) == ["hanger mass"]
    assert named(one_of()) == ["cell rotation", "suture angle"]
    assert named(none_of_catalogue()) == ["something else"]
    assert named(nothing_missing()) == ["nothing missing"]
    assert named(undecided()) == []
    pulley = {"effects": ["worn_pulley"], "candidates": ["worn_pulley.FDP"], "probability": 0.4}
    other = {"effects": ["worn_pulley"], "candidates": ["worn_pulley.EDC"], "probability": 0.6}
    ranking = {"ranking": [pulley, other], "effects": ["worn_pulley"], "verdict": "found"}
    assert named(ranking | {"candidates": ["worn_pulley.FDP"]}) == ["worn pulley FDP"]
    both = ranking | {"candidates": ["worn_pulley.EDC", "worn_pulley.FDP"], "verdict": "one_of"}
    assert named(both) == ["worn pulley EDC", "worn pulley FDP"]
    assert [r["probability"] for r in ranked(one_of())] == [0.55, 0.39, 0.05, 0.01]


def test_names_are_written_for_reading() -> None:
    assert [effect_name(n) for n in ("fdp_fds_coupling", "lumbrical_on_fdp", "zero_offset.bone.x")] == [
        "FDP–FDS coupling",
        "lumbrical on FDP",
        "zero offset bone x",
    ]
    both = {"effects": ["hanger_mass", "worn_pulley"], "variant": "worn_pulley.EDC"}
    assert explanation_name(both) == "hanger mass + worn pulley EDC"
    assert explanation_name(both | {"variant": ["hanger_mass", "worn_pulley.EDC"]}) == "hanger mass + worn pulley EDC"
    assert explanation_name({"effects": ["zero_offset"], "variant": "bone"}) == "zero offset (bone)"
    assert [probability_text(p) for p in (0.5, 0.004, 1e-9, 0.0, 0.995, 1.0, None)] == [
        "0.50",
        "0.004",
        "<0.001",
        "<0.001",
        "0.995",
        ">0.999",
        "–",
    ]
    assert [with_sd(*v) for v in ((41.26, 2.63), (-0.01234, 0.0011), (1e-12, 1e-13), (250.0, 120.0), (3.0, None))] == [
        ("41.3", "2.6"),
        ("−0.0123", "0.0011"),
        ("1e-12", "1e-13"),
        ("250", "120"),
        ("3", "–"),
    ]


def test_classes_stand_together_and_are_outlined() -> None:
    figure = confounding_figure(found())
    order = [t.split(", d")[0] for t in figure.layout.yaxis.ticktext]
    assert order[:2] == ["rig friction", "cell crosstalk"]
    assert len(order) == len(EFFECTS)
    assert "hanger mass, d = 31.0" in figure.layout.yaxis.ticktext
    assert [(s.x0, s.x1) for s in figure.layout.shapes] == [(-0.5, 1.5), (1.5, 3.5), (3.5, 5.5)]
    heat = figure.data[0]
    for shape in figure.layout.shapes:
        inside = range(math.ceil(shape.x0), math.ceil(shape.x1))
        assert all(heat.z[a][b] >= 0.9 for a in inside for b in inside)
    assert [heat.z[i][i] for i in range(len(order))] == [1.0] * len(order)


def test_many_effects_leave_classes_and_the_most_detectable() -> None:
    names = [f"e{i}" for i in range(50)]
    answer = {
        "confounding": {"effects": names, "correlation": [[0.1] * 50] * 50, "classes": [["e0", "e1"]]},
        "detectability": {n: float(i) for i, n in enumerate(names)},
    }
    figure = confounding_figure(answer)
    labels = [t.split(",")[0] for t in figure.layout.yaxis.ticktext]
    assert labels[:2] == ["e0", "e1"]
    assert set(labels[2:]) == set(names[20:])
    assert "32 of 50 effects" in figure.layout.title.subtitle.text


# --- before and after


def test_steps_come_from_the_history_or_from_before_and_after() -> None:
    assert [s.lines for s in steps_of(found(), HISTORY)] == [
        ["start"],
        ["+ worn pulley FDP", "ln evidence +281.0"],
        ["+ hanger mass", "+ goniometer bias", "− worn pulley FDP", "ln evidence +25.4"],
    ]
    before, after = steps_of(found(), None)
    assert before.rmse_N["validation/tip"] == pytest.approx(0.9 * 0.171)
    assert after.lines == ["after", "with hanger mass"]
    assert steps_of(found() | {"judged_in": "sagittal"}, None)[0].rmse_N["validation/tip"] == pytest.approx(0.171)
    assert steps_of(one_of(), None)[1].lines == ["after", "with cell rotation or suture angle"]
    assert steps_of(found(), []) == steps_of(found(), None)


def test_bars_end_at_the_error_and_caps_at_the_step_before() -> None:
    figure = revisions_figure(found(), HISTORY)
    tip = [t for t in bars(figure) if t.yaxis == "y" and t.offsetgroup == "validation"]
    solid, falls, rises, words = tip
    assert words.base == pytest.approx((0.171, 0.19, 0.032))
    assert words.text == ("0.171", "0.190", "0.032")
    assert solid.y == pytest.approx((0.171, 0.171, 0.032))
    assert falls.y == pytest.approx((0.0, 0.0, 0.158))
    assert rises.y == pytest.approx((0.0, 0.019, 0.0))
    assert rises.base[1] + rises.y[1] == pytest.approx(0.19)
    assert "+0.019" in solid.hovertext[1]


def test_a_long_history_keeps_its_first_and_last_steps() -> None:
    history = [HISTORY[0] | {"id": f"r{k}", "added": [f"e{k}"]} for k in range(30)]
    figure = revisions_figure(found(), history)
    assert [t.split("<br>")[0] for t in figure.layout.xaxis2.ticktext] == ["+ e0", *(f"+ e{k}" for k in range(23, 30))]
    assert "of 30 steps" in figure.layout.title.subtitle.text


def test_held_out_cases_are_sorted_and_measured_in_the_plane() -> None:
    cases = held_out(found())
    assert len(cases) == 16
    assert [c.before_N for c in cases] == sorted((c.before_N for c in cases), reverse=True)
    one = next(c for c in found()["cases"] if c["id"] == cases[0].label.split()[0])
    assert cases[0].before_N == pytest.approx(math.dist(one["measured_N"], one["before_N"]))
    assert cases[0].sd_N == pytest.approx(math.sqrt(0.03**2 + 0.03**2 + 0.02**2))
    flat = {c.label: c for c in held_out(found() | {"judged_in": "sagittal"})}
    assert flat[cases[0].label].after_N == pytest.approx(math.dist(one["measured_N"][:2], one["after_N"][:2]))
    figure = held_out_figure(found())
    before, after = (next(t for t in figure.data if t.name == n) for n in ("before", "after"))
    assert (list(before.x), list(after.x)) == ([c.before_N for c in cases], [c.after_N for c in cases])
    falls = sum(c.after_N < c.before_N for c in cases)
    assert f"falls in {falls} of them" in figure.layout.title.subtitle.text


# --- sensitivity and size


def test_every_assumption_has_a_dot_beside_the_line_of_the_sure() -> None:
    figure = sensitivity_figure(found())
    dots = {t.name: t for t in figure.data}
    assert {name: len(t.x) for name, t in dots.items()} == {"sure": 9, "not sure": 1, "below one half": 1}
    assert dots["not sure"].x == (0.71,)
    words = dict(zip(figure.layout.yaxis.tickvals, figure.layout.yaxis.ticktext, strict=True))
    assert words[dots["below one half"].y[0]] == "without posture hook"
    assert [s.x0 for s in figure.layout.shapes] == [0.9, 0.962]
    headings = [n.text for n in figure.layout.annotations if n.text.startswith("<b>")]
    assert headings[0] == "<b>Prior probability of nothing</b>"
    assert len(headings) == len({a["group"] for a in assumed()})


def test_of_many_parts_of_the_data_those_that_matter_most_are_drawn() -> None:
    parts = [{"group": "without", "words": f"without p{k}", "probability": 0.01 * k} for k in range(60)]
    answer = {
        "robustness": {"assumptions": [*parts, assumed()[0], {"group": "own", "words": "else", "probability": 2}]}
    }
    assert [a.probability for a in assumptions(answer)][-1] == 1.0
    figure = sensitivity_figure(answer)
    assert sum(len(t.x) for t in figure.data) == 40
    assert max(x for t in figure.data for x in t.x[:-2] if t.name == "below one half") < 0.4
    assert "22 parts" in figure.layout.title.subtitle.text


def test_size_has_a_panel_for_each_posture_and_mount_and_a_line_for_each_tendon() -> None:
    figure = size_figure(found())
    assert "hanger mass" in figure.layout.title.text
    titles = [n.text for n in figure.layout.annotations]
    assert titles[0] == "<b>Hyperextension, at the tip</b>"
    assert len(titles) == 8
    lines = [t for t in figure.data if t.mode == "lines+markers"]
    bands = [t for t in figure.data if t.fill == "toself"]
    assert len(lines) == len(bands) == 8 * len(MASSES)
    assert [t.name for t in lines if t.showlegend] == ["FDP", "FDS", "EDC", "RI", "UI", "LU"]
    assert {tuple(figure.layout[a].range) for a in ("yaxis", "yaxis8")} == {tuple(figure.layout.yaxis.range)}
    one = next(c for c in curves(found()) if c.muscle == "FDP")
    assert max(one.change_N) < figure.layout.yaxis.range[1]
    assert "950 g changes it by 0.095 N (0.076–0.114)" in lines[0].hovertext[-1]
    bare = {
        "size": {"curves": [{"muscle": "LU", "load_g": [20.0], "change_N": [0.1], "low_N": None}, {"load_g": [1.0]}]}
    }
    assert [t.mode for t in size_figure(bare).data] == ["lines+markers"]


@pytest.mark.parametrize(
    "draw",
    [
        sensitivity_figure,
        residual_map,
        torque_figure,
        ranking_figure,
        size_figure,
        confounding_figure,
        revisions_figure,
        held_out_figure,
    ],
)
def test_nothing_to_draw_is_said(draw: Callable[[Answer], go.Figure]) -> None:
    with pytest.raises(NothingToDrawError):
        draw({})
