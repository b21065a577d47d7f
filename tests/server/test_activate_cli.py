"""`fingertwin activate`: forces and deficits as data, as a table and as figures, and what it refuses."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import pytest

from fingermodel.studies.activation import activate
from fingermodel.studies.activation_result import ActivationResult
from server.figures.activation import activation_plots, activation_report
from tests.server.command_line import refused, run

THUMB = "barry2018_thumb"


@pytest.fixture(scope="module")
def pinch() -> ActivationResult:
    return activate(THUMB, force_N={"palmar": 20.0, "radial": 2.0}, lost={"ADP": 1.0})


def test_the_figures_show_both_planes_and_both_measures(pinch: ActivationResult, tmp_path: Path) -> None:
    alone, deficits = (p.figure for p in activation_plots(pinch))
    headings = [a["text"] for a in alone.layout.annotations if a["text"].endswith(")</b>")]
    assert headings == [
        "<b>Sagittal plane (dorsal up, palmar down)</b>",
        "<b>Coronal plane (radial up, ulnar down)</b>",
    ]
    assert {t.xaxis for t in deficits.data} == {"x", "x2"}
    page = activation_report(pinch, tmp_path / "figures", static=False)
    assert "Each muscle alone" in page.read_text(encoding="utf-8")


def test_the_command_answers_with_numbers_and_a_table(tmp_path: Path) -> None:
    table = tmp_path / "deficits.csv"
    levels = ["--activation", "FPL=50", "--activation", "ADP=20"]
    body: dict[str, Any] = run("activate", THUMB, *levels, "--deficit", "FPL=25", "--out", table, "--json", "-").body(
        "activate"
    )
    assert body["activation"]["FPL"] == 0.5
    assert body["activation"]["ADPt"] == 0.2
    assert body["together"]["lost_pct"] == {"FPL": 25.0}
    fpl = next(d for d in body["deficits"] if d["muscle"] == "FPL")
    assert body["together"]["force_N"] == pytest.approx(fpl["force_N"][1])
    with table.open(encoding="utf-8", newline="") as file:
        lines = list(csv.DictReader(file))
    assert len(lines) == 8 * 5
    assert float(lines[1]["magnitude_N"]) == pytest.approx(fpl["magnitude_N"][1])


def test_the_command_prints_what_each_muscle_does() -> None:
    code, out, err = run("activate", THUMB, "--force", "palmar=20")
    assert (code, err) == (0, "")
    assert "Baseline, activation in %: FPL" in out
    assert "turned by [deg]" in out
    assert "no passive joint torques" in out


REFUSED = {
    "no finger": (["activate", "toe"], "no finger 'toe'"),
    "no muscles": (["activate", "an1979_middle"], "no muscles for an1979_middle"),
    "other muscles": (["activate", THUMB, "--muscles", "wu2008"], "has no FPL"),
    "no angle": (["activate", THUMB, "--posture", "PIP=3"], "no angle 'PIP'"),
    "no number": (["activate", THUMB, "--posture", "IP=bent"], "--posture IP=bent"),
    "angle twice": (["activate", THUMB, "--posture", "IP=3", "--posture", "IP=4"], "--posture IP is given twice"),
    "force twice": (["activate", THUMB, "--force", "palmar=8", "--force", "palmar=9"], "--force palmar is given twice"),
    "deficit twice": (["activate", THUMB, "--deficit", "FPL=25", "--deficit", "FPL=30"], "FPL is given twice"),
    "no muscle": (["activate", THUMB, "--deficit", "FDI=25"], "no muscle 'FDI'"),
    "too much": (["activate", THUMB, "--deficit", "FPL=125"], "FPL at 125 %"),
    "no direction": (["activate", THUMB, "--force", "up=3"], "no direction 'up'"),
    "too strong": (["activate", THUMB, "--force", "palmar=9000"], "beyond the muscles' strength"),
    "both": (["activate", THUMB, "--force", "palmar=3", "--activation", "FPL=3"], "activations and a force"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_computed_is_refused_in_one_line(case: str) -> None:
    arguments, message = REFUSED[case]
    assert message in refused(*arguments, instead="")
