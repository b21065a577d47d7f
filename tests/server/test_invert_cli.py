"""`fingertwin invert`: its answer, its table, its figures, and what it refuses."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from fingermodel.inverse.closures import NAMES
from fingermodel.session import Session
from fingermodel.studies.inversion import invert_bench
from fingermodel.studies.inverted import Inversion
from server.figures.inversion import inversion_plots
from tests.server.command_line import Document, altered, refused, run

SESSION = "DEV-01"  # nothing is missing from its model
PUBLISHED = "synek2019_H01"  # forces alone, as published
Invert = Callable[[str], Inversion]


@pytest.fixture(scope="module")
def bench() -> Session:
    return Session.open(SESSION, catalogue=False)


@pytest.fixture(scope="module")
def inverted(bench: Session) -> Invert:
    return cache(partial(invert_bench, bench))


def test_the_json_answer_holds_forces_their_sd_and_what_hung() -> None:
    body: Document = run("invert", SESSION, "--json", "-").body("invert")
    assert (body["session"], body["closure"]) == (SESSION, "chao")
    assert body["closure_title"] == NAMES["chao"]
    case = body["cases"][0]
    assert set(case) == {
        "id", "role", "posture", "masses_g", "muscles", "slips", "contacts", "contacts_N", "pushes", "unbalanced_Nmm",
        "unread",
    }  # fmt: skip
    assert set(case["muscles"]) == {"FDP", "EDC", "RI", "LU", "UI"}
    assert set(case["contacts"]) == {"MCP", "PIP", "DIP"}
    assert all(a["sd_N"] > 0.0 for a in case["muscles"].values())
    assert body["found"] == sum(
        all(
            abs(a["force_N"] - a["hung_N"]) <= 2.0 * np.hypot(a["sd_N"], 0.012 * a["hung_N"])
            for a in c["muscles"].values()
        )
        for c in body["cases"]
    )


def test_the_table_says_what_hung_and_who_would_push() -> None:
    answer = run("invert", SESSION, "--closure", "minimal")
    assert (answer.code, answer.err) == (0, "")
    assert "four muscles, no hood" in answer.out
    assert "FDP 950 g" in answer.out
    assert "the load that really hung is found" in answer.out
    assert "The closure asks PF to push" in answer.out


def test_what_the_check_found_and_what_was_left_out_stands_above_the_forces(tmp_path: Path) -> None:
    def turned(document: Document) -> None:
        for case in document["cases"]:
            case["force_N"] = [-f for f in case["force_N"]]
        document["cases"][0]["excluded"] = "the suture slipped"

    answer = run("invert", altered(tmp_path, turned), "--closure", "least_squares", "--figures", tmp_path / "out")
    first = answer.out[: answer.out.index("Assigned less hung")]
    assert "Warning: load_cell.mounts.tip: " in first
    assert ": the suture slipped\n" in first
    page = (tmp_path / "out" / "inversion.html").read_text(encoding="utf-8")
    assert page.index("Before you read on") < page.index("Summary")


def test_a_session_without_moments_is_refused_in_one_line() -> None:
    refused(
        "invert",
        PUBLISHED,
        saying="no case at the tip of which force and moment were both read",
        instead="Closure least_squares leaves a moment that was not read free",
    )


def test_a_session_without_tip_cases_is_refused(tmp_path: Path) -> None:
    def only_bone(document: Document) -> None:
        document["cases"] = [c for c in document["cases"] if c["location"] == "bone"]

    refused("invert", altered(tmp_path, only_bone), saying="no case at the tip")


@pytest.mark.parametrize(
    ("arguments", "saying", "instead"),
    [
        pytest.param((SESSION, "--closure", "winslow"), "winslow", "chao", id="closure"),
        pytest.param(("nowhere",), "nowhere", "expected", id="session"),
        pytest.param((SESSION, "--model", "an1979_thumb"), "an1979_thumb", "expected", id="model"),
        pytest.param((PUBLISHED, "--model", "wu2008_index"), "EC", "expected", id="finger"),
    ],
)
def test_bad_arguments_are_refused_in_one_line(arguments: tuple[str, ...], saying: str, instead: str) -> None:
    refused("invert", *arguments, saying=saying, instead=instead)


@pytest.mark.parametrize("closure", ["minimal", "chao"])
def test_figures_show_every_case_of_every_muscle_and_joint(closure: str, inverted: Invert) -> None:
    inversion = inverted(closure)
    muscles, contacts = inversion_plots(inversion)
    assert (muscles.name, contacts.name) == ("inversion-muscles", "inversion-contacts")
    for plot, count in ((muscles, len(inversion.muscles)), (contacts, 3)):
        dots = [t for t in plot.figure.data if t.mode == "markers"]
        assert len(dots) == count
        assert all(len(t.y) == len(inversion.cases) for t in dots)
        # On the narrowest page, 720 px, of which 80 are margins: level names have room beside each other.
        lowest = next(x for x in plot.figure.select_xaxes() if x.showticklabels)
        per_place = (720 - 80) / (lowest.range[1] - lowest.range[0])
        for (a, left), (b, right) in pairwise(zip(lowest.ticktext, lowest.tickvals, strict=True)):
            assert lowest.tickangle == -40 or 3.4 * (len(a) + len(b)) <= (right - left) * per_place, (a, b)
    first = next(t for t in muscles.figure.data if t.mode == "markers")
    name = inversion.muscles[0].name
    assert sorted(first.y) == sorted(c.muscles[name].force_N for c in inversion.cases)
    hollow = sum(s == "circle-open" for s in first.marker.symbol)
    assert hollow == inversion.muscles[0].pushes
    assert sorted(first.error_y.array) == pytest.approx(sorted(2.0 * c.muscles[name].sd_N for c in inversion.cases))
    for t in contacts.figure.data:
        if t.mode == "markers":
            assert all(y - low >= 0.0 for y, low in zip(t.y, t.error_y.arrayminus, strict=True))


def test_the_command_writes_its_figures(tmp_path: Path) -> None:
    answer = run("invert", SESSION, "--figures", tmp_path / "out")
    assert answer.code == 0
    page = tmp_path / "out" / "inversion.html"
    assert f"Figures: {page}" in answer.out
    assert page.read_text(encoding="utf-8").count("<figure>") == 2
    assert {f.name for f in page.parent.iterdir()} == {
        "inversion.html",
        *(f"inversion-{name}.{kind}" for name in ("muscles", "contacts") for kind in ("png", "svg")),
    }


@pytest.mark.full  # another finger, for which all is compiled anew
def test_a_simulated_index_finger_is_inverted(tmp_path: Path) -> None:
    session = tmp_path / "index"
    assert run("simulate", "synek2019", "--model", "an1979_index", "--noise-N", "0", "--out", session).code == 0
    alone = [c for c in invert_bench(Session.open(str(session), catalogue=False)).cases if set(c.masses_g) == {"FDP"}]
    assert alone
    for case in alone:
        assert case.muscles["FDP"].force_N == pytest.approx(case.muscles["FDP"].hung_N, rel=0.02)
