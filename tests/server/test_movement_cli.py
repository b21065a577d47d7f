"""`fingertwin move`: what it computes, writes and draws, and what it refuses in one line."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.testing import assert_allclose

from daq.locations import data_dir
from fingermodel.studies.movement import MovementResult, move
from server.figures.movement import Reference, movement_plots
from tests.server.command_line import Document, refused, run

STEPS = 61
MUSCLES = ("FDP", "FDS", "EC", "EI", "RI", "UI", "LU")
ROTATIONS = ("abduction", "MCP", "PIP", "DIP")


@pytest.fixture(scope="module")
def result() -> MovementResult:
    return move("wu2008_tap", "wu2008_index", "wu2008", STEPS)


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Document]:
    """A folder with the command's table and figures, and its JSON answer."""
    folder = tmp_path_factory.mktemp("tap")
    answer = run("move", "--steps", STEPS, "--out", folder / "tap.csv", "--figures", folder, "--json", "-")
    return folder, answer.body("move")


def test_the_answer_holds_every_course_by_name(result: MovementResult, written: tuple[Path, Document]) -> None:
    _, body = written
    assert (body["motion"], body["finger"], body["muscle_set"]) == ("wu2008_tap", "wu2008_index", "wu2008")
    assert (tuple(body["muscles"]), tuple(body["rotations"])) == (MUSCLES, ROTATIONS)
    for key in ("angle_deg", "rate_deg_s", "acceleration_deg_s2", "torque_Nmm"):
        assert {name: len(course) for name, course in body[key].items()} == dict.fromkeys(ROTATIONS, STEPS)
    for key in ("force_N", "active_N", "passive_N", "activation", "length_mm"):
        assert {name: len(course) for name, course in body[key].items()} == dict.fromkeys(MUSCLES, STEPS)
    assert np.shape(body["tip_force_N"]) == (STEPS, 3)
    assert [p["muscle"] for p in body["peaks"]] == list(MUSCLES)
    assert all(p["peak_N"] == max(body["force_N"][p["muscle"]]) for p in body["peaks"])
    assert {k: v for k, v in body.items() if k not in ("schema", "file", "figures")} == result.as_dict()
    json.dumps(result.as_dict(), allow_nan=False)


def test_the_table_has_a_row_an_instant_with_units(written: tuple[Path, Document]) -> None:
    folder, body = written
    assert body["file"] == str(folder / "tap.csv")
    with (folder / "tap.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == STEPS
    assert_allclose([float(r["time_s"]) for r in rows], body["times_s"], rtol=1e-8)
    for name in MUSCLES:
        assert_allclose([float(r[f"{name}_force_N"]) for r in rows], body["force_N"][name], rtol=1e-8)
    for name in ROTATIONS:
        assert_allclose([float(r[f"{name}_torque_Nmm"]) for r in rows], body["torque_Nmm"][name], rtol=1e-8)


def test_the_figures_are_a_page_and_pictures(written: tuple[Path, Document]) -> None:
    folder, body = written
    assert body["figures"] == str(folder / "movement.html")
    page = (folder / "movement.html").read_text(encoding="utf-8")
    assert page.count("<figure>") == 2
    assert "wu2008_tap with wu2008_index" in page
    for name in ("movement", "muscles"):
        assert (folder / f"{name}.png").stat().st_size > 10_000
        assert (folder / f"{name}.svg").stat().st_size > 10_000


def test_a_reference_is_drawn_beside_its_muscle_alone(result: MovementResult) -> None:
    beside = Reference("theirs", np.array([0.0, 0.1]), {"FDP": np.array([1.0, 2.0])})
    movement, muscles = movement_plots(result, beside)
    assert (movement.name, muscles.name) == ("movement", "muscles")
    drawn = [t for t in muscles.figure.data if t.name == "theirs"]
    assert [list(t.y) for t in drawn] == [[1.0, 2.0]]
    assert len(muscles.figure.data) == 3 * len(MUSCLES) + 1
    assert "touches from" in movement.caption


def test_the_table_names_peaks_torques_and_contact(written: tuple[Path, Document]) -> None:
    _, body = written
    answer = run("move", "--steps", STEPS)
    assert (answer.code, answer.err) == (0, "")
    first, last = body["contact_s"]
    assert f"Contact from {first:.3f} to {last:.3f} s." in answer.out
    for word in ("over peak tip force", *MUSCLES, *ROTATIONS):
        assert word in answer.out


def _altered(kind: str, name: str, folder: Path, change: Callable[[Document], Any]) -> Path:
    document = yaml.safe_load((data_dir() / kind / f"{name}.yaml").read_text(encoding="utf-8"))
    change(document)
    path = folder / f"{kind}.yaml"
    path.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
    return path


def _still(document: Document) -> None:
    """The finger stands still and nothing touches it."""
    document["angles"]["rotations"] = {"abduction": 0.0, "MCP": 0.2, "PIP": 0.5, "DIP": 0.24}
    del document["tip_force"]


def test_a_finger_that_stands_still_asks_for_no_torque_but_its_weights(tmp_path: Path) -> None:
    still = _altered("motions", "wu2008_tap", tmp_path, _still)
    weightless = move(str(still), "wu2008_index", "wu2008", STEPS, gravity=False)
    assert_allclose(weightless.torque_Nmm, 0.0, atol=1e-12)
    assert weightless.contact_s() is None
    assert all(p["over_tip_force"] is None for p in weightless.peaks())
    held = move(str(still), "wu2008_index", "wu2008", STEPS)
    assert_allclose(held.torque_Nmm, held.torque_Nmm[0] * np.ones((STEPS, 1)), atol=1e-12)
    assert (held.torque_Nmm[:, ROTATIONS.index("MCP")] < 0.0).all()  # extension, against weight
    assert len(movement_plots(held)) == 2


@pytest.mark.parametrize(
    ("arguments", "saying", "instead"),
    [
        pytest.param(("wave",), "no motion 'wave'", "wu2008_tap", id="motion"),
        pytest.param(("--finger", "toe"), "toe", "wu2008_index", id="finger"),
        pytest.param(("--muscles", "strong"), "no muscles 'strong'", "wu2008_ammr", id="muscles"),
        pytest.param(("--finger", "an1979_middle"), "has no EDC", "the muscles of an1979_middle", id="another finger"),
        pytest.param(("--steps", "1"), "1 steps", "expected 2 to 20000", id="too few steps"),
        pytest.param(("--steps", "20001"), "20001 steps", "expected 2 to 20000", id="too many steps"),
        pytest.param(("--steps", "many"), "integer", "--steps", id="steps in words"),
    ],
)
def test_bad_arguments_are_refused_in_one_line(arguments: tuple[str, ...], saying: str, instead: str) -> None:
    refused("move", *arguments, saying=saying, instead=instead)


def test_a_finger_without_inertia_is_refused(tmp_path: Path) -> None:
    light = _altered("fingers", "wu2008_index", tmp_path, lambda d: d.pop("inertia"))
    said = refused("move", "--finger", light, saying="has no inertia of PP, MP, DP")
    assert "Add an inertia block" in said


def test_torques_beyond_the_muscles_are_refused_with_time_and_joint(tmp_path: Path) -> None:
    def harder(document: Document) -> None:
        force = document["tip_force"]["components"]
        force["Fy_N"] = [200.0 * f for f in force["Fy_N"]]

    hard = _altered("motions", "wu2008_tap", tmp_path, harder)
    said = refused("move", "--steps", STEPS, hard, saying="the muscles lack strength about", instead="a reserve of")
    assert " s: asked for" in said


def test_a_place_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    refused("move", "--steps", STEPS, "--out", tmp_path / "file" / "tap.csv", saying="tap.csv")
