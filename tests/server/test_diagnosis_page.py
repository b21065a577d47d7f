"""Page of a diagnosis: drawn from its answer alone, whatever the verdict and whatever is absent."""

from __future__ import annotations

import copy
import io
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import plotly.graph_objects as go
import pytest
from matplotlib.image import imread

import server
from fingermodel.fitting.reading_errors import OTHER_SCATTER
from server.application.diagnosis_report import diagnosis_sections, draw_diagnosis
from server.figures.diagnosis_map import residual_map
from server.figures.diagnosis_tables import bent_table
from server.figures.diagnosis_torque import torque_figure
from server.figures.report import figures_of
from server.figures.report_front import to_do
from server.figures.static import render
from tests.server.diagnosis_answers import (
    ANSWERS,
    HISTORY,
    found,
    hostile,
    none_of_catalogue,
    nothing_missing,
    one_of,
    undecided,
)
from tests.server.diagnosis_pages import HEADINGS, MISSING, NAMES, Page, page
from tests.server.diagnosis_parts import EFFECTS, HOSTILE, Answer, load_cases, size_curves, where


@pytest.mark.parametrize("verdict", list(ANSWERS))
def test_every_verdict_gives_every_figure_that_it_can(verdict: str) -> None:
    figures = figures_of(diagnosis_sections(ANSWERS[verdict](), None))
    assert set(figures) == NAMES - MISSING.get(verdict, set())
    for figure in figures.values():
        text = figure.to_json()
        assert "bdata" not in text, "numbers stay readable"
        assert json.loads(go.Figure(json.loads(text)).to_json()) == json.loads(text)
        assert len(render(json.loads(text), "svg")) > 1000


def test_page_and_pictures_are_written(tmp_path: Path) -> None:
    folder = tmp_path / "new" / "folder"
    written = draw_diagnosis(one_of(), folder)
    assert written == folder / "diagnose.html"
    assert {p.name for p in folder.iterdir()} == {"diagnose.html"} | {
        f"{n}.{e}" for n in NAMES - MISSING["one_of"] for e in ("png", "svg")
    }
    for name, figure in figures_of(diagnosis_sections(one_of(), None)).items():
        picture = imread(io.BytesIO((folder / f"{name}.png").read_bytes()), format="png")
        assert picture.shape[:2] == (2 * figure.layout.height, 2 * figure.layout.width)


def test_a_saved_answer_gives_the_same_page(tmp_path: Path) -> None:
    first = draw_diagnosis(found(), tmp_path / "a", static=False).read_bytes()
    saved = json.loads(json.dumps(found()))
    assert draw_diagnosis(saved, tmp_path / "b", static=False).read_bytes() == first
    assert saved == found(), "the answer is left as it was"


def test_the_verdict_comes_first_and_the_sections_in_order(tmp_path: Path) -> None:
    read = page(found(), tmp_path, HISTORY)
    assert read.headings == list(HEADINGS)
    assert read.paragraphs[:2] == ["Model: an1979_middle", found()["sentence"]]
    assert read.paragraphs[2].startswith("Verdict: found, probability 0.96. Not confirmed yet")
    assert read.paragraphs[3] == "Probability of what: hanger_mass acts by its known law, whatever else does."
    assert read.paragraphs[4] == "Suspect load case: c056 (probability 0.99)."
    assert read.paragraphs[5:8] == found()["reasons"]
    words = " ".join(read.words)
    for said in (
        "812.4 at 120 degrees of freedom (p < 0.001); 131.9 with the best explanation",
        "Scatter and noise are taken as large as the best explanation needs.",
        "378 explanations searched, fitted or by the linearised model.",
        "FDS hung, not FDP",
        "The whole session: the finger is mirrored (probability 0.03",
        "bent most: zero.bone.z",
        "Of 7 other assumptions, 6 leave the verdict sure",
        "Under none of them is it less probable than not.",
        "It is no longer sure once the rig's own errors (the budget) are 3.2 times as large.",
        "acts, alone or beside others: probability 0.03; if so, about 0.02 N.",
        "Predictive check on the validation cases: p < 0.001 without any effect, p = 0.31 with",
        "Their log density changes by +250.5.",
        "40 load cases, 32 at the tip and 8 at the bone; 16 for validation.",
        "Clearly missing at PIP.",
        "not to be told apart by these load cases: suture angle and cell rotation.",
        "k*t_EDC*sin(q_PIP)",
        "Hang 20 g on the lumbrical",
        "hanger mass / worn pulley FDP",
        "0.210 → 0.034",
        "The diagnosis took 1.8 s.",
    ):
        assert said in words


def test_a_chi_square_without_any_effect_says_how_scatter_and_noise_are_counted(tmp_path: Path) -> None:
    words = page(ANSWERS["none_of_catalogue"]() | {"chi_square": {"value": 390.5, "after": 390.5}}, tmp_path).words
    assert "Scatter and noise are taken as large as this model needs to explain the readings." in " ".join(words)


@pytest.mark.parametrize(
    ("verdict", "sentence"),
    [
        ("one_of", "One of these is missing, and these load cases cannot say which: cell rotation or suture angle."),
        ("none_of_catalogue", "Something is missing that no effect of the catalogue explains."),
        ("nothing_missing", "Nothing is missing: the model explains the readings within their uncertainty."),
    ],
)
def test_a_verdict_without_a_sentence_gets_one(verdict: str, sentence: str, tmp_path: Path) -> None:
    assert page(ANSWERS[verdict](), tmp_path).paragraphs[1] == sentence


def test_what_is_absent_is_said_to_be(tmp_path: Path) -> None:
    words = " ".join(page(nothing_missing(), tmp_path).words)
    assert "No figure: no missing joint torque could be worked out." in words
    assert "No figure: there is no validation case with a prediction before and after." in words
    assert "None: no simple formula takes up what is left." in words
    assert "None: the session's load cases allow no such test." in words
    pooled = page(undecided(), tmp_path)
    assert "Diagnosis of DEV-01, DEV-02, DEV-03 and 1 more" in pooled.words
    assert (
        "It would be less probable than not if the budget were twice as large; or if the posture hook were left out."
        in pooled.paragraphs
    )
    assert "Not worked out for this answer." in page({}, tmp_path).paragraphs


def bent(name: str, widths: float) -> Answer:
    return {"name": name, "value": 0.02 * widths, "unit": "N", "stated_sd": 0.02, "widths": widths}


def test_what_to_do_follows_from_the_verdict_the_suspects_and_the_rig() -> None:
    steps = to_do(found() | {"session": "S1"})
    assert steps[0].startswith("Look at load case c056: it reads like this: FDS hung, not FDP.")
    assert steps[1].startswith("Weigh the hangers (the readings say hanger_mass.all = 41.3 ± 2.6 g)")
    assert steps[2] == "Put it into the model: fingertwin add hanger_mass S1."
    assert "to confirm it" in steps[3]
    # What the model holds already is not put into it again.
    held = to_do(found() | {"session": "S1", "held": ["hanger_mass.m0"]})
    assert held == [*steps[:2], *steps[3:]]
    sound = nothing_missing() | {"suspects": [], "session_faults": []}
    assert to_do(sound) == ["Nothing: no measurement and no change of the model is asked for."]
    assert to_do(sound | {"predictive_check": {"missed_after": ["c048", "c016"]}}) == [
        "Measure c048 and c016 again. If the reading comes again, fit cases like it: something acts there that no "
        "fitted case shows."
    ]
    far = {
        "where_after": {
            "added": [],
            "bent": [bent("zero.bone.z", 19.4), bent("zero.bone.x", -4.2), bent("zero.tip.x", 2.1)],
        }
    }
    assert to_do(sound | far) == [
        "Tare the bone mount again: the refit takes zero.bone.z to be 19 stated standard deviations off."
    ]


def test_errors_of_the_rig_stand_after_both_fits_where_the_model_fails() -> None:
    whole = {
        "where": {"added": [], "bent": [bent("zero.bone.z", 19.4), bent("zero.tip.x", -2.6)]},
        "where_after": {"added": ["hanger_mass"], "bent": [bent("zero.bone.z", 3.1)]},
    }
    (table,) = bent_table(whole)
    assert list(table.header)[2:4] == ["after a refit with nothing added", "after a refit with hanger mass added"]
    assert [list(row)[2:4] for row in table.rows] == [
        ["0.388 N (19 sd)", "0.062 N (3 sd)"], ["\N{MINUS SIGN}0.052 N (3 sd)", "within 2 sd"],
    ]  # fmt: skip
    assert bent_table({}) == []


def test_residuals_say_after_which_fit_they_are() -> None:
    cell = {"muscles": "FDP", "posture": "hook", "location": "tip", "cases": 1, "rmse_N": 0.1, "z_rms": 3.0}
    for added, said in (([], "nothing added"), (["hanger_mass"], "hanger mass added")):
        part = {"where": {"added": added, "cells": [cell], "joint_torque_Nmm": {"PIP": {"rms": 2.0, "sd": 0.5}}}}
        assert residual_map(part).layout.title.text == f"Where the model fails, after a refit with {said}"
        assert torque_figure(part).layout.title.text == f"Joint torque that is missing, after a refit with {said}"


@pytest.mark.parametrize("confirmed", [True, False, "revision r4"])
def test_confirmation_is_told(confirmed: object, tmp_path: Path) -> None:
    status = page(found() | {"confirmed": confirmed}, tmp_path).paragraphs[2]
    assert ("agreed" in status) is (confirmed is not False)
    assert ("revision r4" in status) is (confirmed == "revision r4")


def test_an_empty_answer_still_gives_a_page(tmp_path: Path) -> None:
    assert page({}, tmp_path).headings == list(HEADINGS)
    assert figures_of(diagnosis_sections({}, None)) == {}
    draw_diagnosis({}, tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["diagnose.html"]


def holes(tree: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Paths of everything in an answer, of lists only the first entry."""
    out = [path] if path else []
    items = tree.items() if isinstance(tree, dict) else enumerate(tree[:1]) if isinstance(tree, list) else ()
    for key, below in items:
        out += holes(below, (*path, key))
    return out


@pytest.mark.parametrize("part", [0, *(pytest.param(part, marks=pytest.mark.full) for part in (1, 2))])
def test_no_absent_value_breaks_the_page(part: int) -> None:
    whole = nothing_missing() | {k: found()[k] for k in ("ranking", "hints", "next_cases", "nulls")}
    whole["size"] = {"curves": size_curves()[:2]}
    whole["where"] = where(load_cases()[6:8])
    whole["cases"] = load_cases()[6:8]
    names = EFFECTS[:3]
    whole["confounding"] = {"effects": names, "correlation": [[1.0, 0.95, 0.1]] * 3, "classes": [names[:2]]}
    whole["detectability"] = {names[0]: 3.0}
    whole["curve"] = none_of_catalogue()["curve"]
    assert set(figures_of(diagnosis_sections(whole, HISTORY))) == NAMES
    whole["where"] |= {key: {} for key in ("by_posture", "by_location", "by_load_level", "by_component")}
    whole |= {when: {"validation/tip": {"space": {"rmse_N": 0.1}}} for when in ("before", "after")}
    nothings: list[Any] = [None, float("nan"), []]
    for count, path in enumerate(holes(whole)[part::3]):
        broken = copy.deepcopy(whole)
        at: Any = broken
        for key in path[:-1]:
            at = at[key]
        at[path[-1]] = nothings[count % 3]
        for figure in figures_of(diagnosis_sections(broken, None)).values():
            assert "NaN" not in str(figure.to_dict())


def test_hostile_names_are_shown_and_do_nothing(tmp_path: Path) -> None:
    answer = hostile(found())
    path = draw_diagnosis(answer, tmp_path, hostile(HISTORY), static=False)
    text = path.read_text(encoding="utf-8")
    read = Page(text)
    assert read.scripts == 2, "Plotly and the figures; a hostile name adds none"
    assert all(address.startswith("#") for address in read.addresses)
    assert HOSTILE not in text
    assert any(HOSTILE in word for word in read.words), "the name is still to be read"
    assert "default-src 'none'" in text
    figures = figures_of(diagnosis_sections(answer, hostile(HISTORY)))
    assert set(figures) == NAMES - MISSING["found"]
    for figure in figures.values():
        assert b"<script" not in render(figure, "svg")


def test_importing_the_report_loads_no_drawing_library() -> None:
    code = (
        "import sys, server.application.diagnosis_report; "
        "print([m for m in ('plotly', 'matplotlib', 'jax') if m in sys.modules])"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)  # noqa: S603
    assert out.stdout.strip() == "[]"


def test_the_table_of_the_rig_has_a_row_for_every_error_that_an_answer_tells() -> None:
    rows = (Path(server.__file__).parent / "pages" / "views" / "answer.js").read_text(encoding="utf-8")
    assert [kind.key for kind in OTHER_SCATTER.values() if f'"{kind.key}", "{kind.unit}"' not in rows] == []
