"""Fingers and revisions as files: every number has a source, what is written reads back, bad files get one line."""

from __future__ import annotations

import importlib.util
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.testing import assert_allclose

from daq.errors import ModelError
from daq.locations import data_dir
from fingermodel.comparison.comparison import compare
from fingermodel.comparison.observations import layout_of
from fingermodel.fingers.files import finger_document, finger_names, read_finger, write_finger
from fingermodel.fitting.identification import refit_map
from fingermodel.model_files import (
    free_path,
    load_model,
    read_revision,
    revision_document,
    revision_of,
    write_revision,
)
from fingermodel.revisions import save_revision
from fingermodel.session import Session
from tests.fingermodel.fingers import FINGERS
from tests.stated import stated_problem


def test_shipped_fingers_are_the_known_ones() -> None:
    others = {"an1979_index", "barry2018_index", "barry2018_thumb", "synek2019_network", "wu2008_index"}
    assert set(finger_names()) == {*FINGERS, *others}


@pytest.mark.parametrize("name", FINGERS)
def test_every_number_names_its_source_and_certainty(name: str) -> None:
    raw = yaml.safe_load((data_dir() / "fingers" / f"{name}.yaml").read_text(encoding="utf-8"))
    blocks = [
        raw["length_unit"],
        raw["load_point"],
        *raw["joints"],
        *raw["segments"],
        *raw["hood"]["fractions"].values(),
    ]
    assert len(blocks) == 2 + 3 + 13 + 6
    for block in blocks:
        assert block["source"] in raw["sources"]
        assert block["certainty"] in ("high", "medium", "low", "assumed", "fitted")


def test_published_points_are_as_printed() -> None:
    """Spot checks against An et al. 1979 as carried by Synek et al. 2019, with the corrected sign of UI."""
    finger = read_finger("an1979_middle")
    at = {s.name: i for i, s in enumerate(finger.topology.segments)}
    unit = finger.length_unit_mm
    assert unit == 23.63
    ui = at["MCP.UI"]
    assert_allclose(finger.values.proximal_point[ui], unit * np.array([0.4, -0.264, -0.358]))
    assert_allclose(finger.values.distal_point[ui], unit * np.array([-0.38 - 0.37, 0.036, -0.357]))
    assert finger.phalanx_lengths_mm() == pytest.approx({"PP": 47.0237, "MP": 28.8286}, abs=1e-4)
    assert finger.values.load_point[0] == pytest.approx(-(7.5 + 0.17 * 23.63), abs=1e-3)


def test_bonobo_is_what_its_script_builds() -> None:
    spec = importlib.util.spec_from_file_location("build_bonobo", data_dir() / "build_bonobo.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    built, shipped = module.build(), read_finger("synek2019_bonobo")
    for ours, theirs in zip(built.values, shipped.values, strict=True):
        assert_allclose(ours, theirs, atol=1e-9)
    assert shipped.prior_width == 3.0


def test_a_changed_finger_reads_back_and_says_what_was_changed(tmp_path: Path) -> None:
    finger = read_finger("synek2019_initial")
    moved = np.array(finger.values.proximal_point)
    moved[4] = moved[4] + np.array([0.5, -0.25, 0.125])
    fraction = finger.values.fraction.copy()
    fraction[0] = 0.4
    changed = finger.replace_values(proximal_point=moved, fraction=fraction)
    write_finger(finger_document(changed, "fit", "a test", "fitted"), tmp_path / "mine.yaml")
    back = read_finger("mine.yaml", tmp_path)
    for ours, theirs in zip(back.values, changed.values, strict=True):
        assert_allclose(ours, theirs, atol=1e-12)
    sources = [s["source"] for s in back.document["segments"]]
    assert sources.count("fit") == 1
    assert sources[4] == "fit"


def _bad_fingers() -> dict[str, Any]:
    raw = yaml.safe_load((data_dir() / "fingers" / "an1979_middle.yaml").read_text(encoding="utf-8"))

    last = raw["joints"][-1]
    (turn,) = last["rotations"]
    origin = {j["name"]: j["distal_origin"] for j in raw["joints"]}[raw["segments"][0]["joint"]]
    at_centre = {"proximal": [0, 0, 0], "distal": [origin, 0, 0]}

    def changed(**changes: Any) -> dict[str, Any]:
        return raw | changes

    return {
        "not a mapping": [1, 2],
        "wrong format": changed(format="finger/9"),
        "unknown key": changed(colour="red"),
        "missing hood fraction": changed(hood=raw["hood"] | {"fractions": {}}),
        "too few reactions": changed(reactions=["Fx", "Fy"]),
        "unlisted source": changed(length_unit=raw["length_unit"] | {"source": "hearsay"}),
        "no length": changed(length_unit=raw["length_unit"] | {"value_mm": 0}),
        "infinite point": changed(load_point=raw["load_point"] | {"offset_mm": [float("inf"), 0, 0]}),
        "slip from nowhere": changed(segments=[raw["segments"][0] | {"slip": "XX"}]),
        "unknown joint": changed(segments=[raw["segments"][0] | {"joint": "wrist"}]),
        "unknown bone": changed(joints=[raw["joints"][0] | {"child": "femur"}, *raw["joints"][1:]]),
        "bones in another order": changed(bones=["PP", "MC", "MP", "DP"]),
        "bone twice": changed(bones=[*raw["bones"], "DP"]),
        "joints in another order": changed(joints=raw["joints"][::-1]),
        "joint of other bones": changed(joints=[*raw["joints"][:-1], raw["joints"][-1] | {"parent": "PP"}]),
        "axis of no length": changed(joints=[*raw["joints"][:-1], last | {"rotations": [turn | {"axis": [0, 0, 0]}]}]),
        "rotation twice": changed(joints=[*raw["joints"][:-1], last | {"rotations": [turn | {"name": "PIP"}]}]),
        "muscle twice": changed(muscles=[*raw["muscles"], "FDP"]),
        "segment twice": changed(segments=[*raw["segments"], raw["segments"][0]]),
        "segment of no length": changed(segments=[raw["segments"][0] | at_centre, *raw["segments"][1:]]),
        "segment on an unknown bone": changed(segments=[raw["segments"][0] | {"distal_bone": "femur"}]),
        "segment that crosses no joint": changed(segments=[raw["segments"][0] | {"distal_bone": "MC"}]),
        "muscle in two parts of the hood": changed(hood=raw["hood"] | {"extensors": ["EDC", "LU"]}),
        "one slip on both sides": changed(hood=raw["hood"] | {"ulnar_band": raw["hood"]["radial_band"]}),
        "slip with a muscle's name": changed(hood=raw["hood"] | {"central_slip": "EDC"}),
    }


@pytest.mark.parametrize("what", _bad_fingers())
def test_bad_finger_files_get_one_line(what: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(yaml.safe_dump(_bad_fingers()[what]), encoding="utf-8")
    with pytest.raises(ModelError) as caught:
        read_finger(path)
    assert "\n" not in str(caught.value)
    assert "bad.yaml" in str(caught.value)


def test_a_wrong_name_is_met_with_the_right_one() -> None:
    with pytest.raises(ModelError, match="Did you mean an1979_middle"):
        read_finger("an1979_midle")


def test_a_revision_predicts_what_the_fit_did_and_keeps_its_parent(tmp_path: Path) -> None:
    bench = Session.open("synek2019_H02", catalogue=False)
    fit = refit_map(stated_problem(bench.model, bench.observations))
    # The published identification held this share at half; predictions before any fit need all of it.
    assert "fraction.RI_EM is 1 in the finger's file; every fit holds it at 0.5." in fit.message
    after = compare(bench.model, bench.observations, fit.theta)
    document = revision_document(fit, bench.loaded.parent, {}, after.summary(), None)
    path = free_path(tmp_path, "synek2019_H02")
    write_revision(document, path)
    assert path.name == "synek2019_H02-r1.json"
    assert free_path(tmp_path, "synek2019_H02").name == "synek2019_H02-r2.json"
    with pytest.raises(ModelError, match="never overwritten"):
        write_revision(document, path)

    again = Session.open("synek2019_H02", str(path), catalogue=False)
    assert again.loaded.parent == document["id"]
    assert read_revision(path).parent == "synek2019_initial"
    repeated = compare(again.model, again.observations, again.theta)
    assert_allclose([c.predicted_N for c in repeated.cases], [c.predicted_N for c in after.cases], atol=1e-9)

    # On another specimen its anatomy holds, and the errors of this rig do not.
    other = Session.open("synek2019_H03", str(path), catalogue=False)
    assert "errors of that rig are not" in other.loaded.notes[0]
    budget = other.model.parameters.of_kind("budget")
    assert not other.theta[budget].any()
    assert_allclose(other.theta[~budget], again.theta[~budget], atol=1e-12)

    # Fitting it again finds the same optimum: its priors still stand where they stood.
    twice = refit_map(stated_problem(again.model, again.observations), start=again.theta)
    assert twice.objective == pytest.approx(fit.objective, rel=1e-6)


def test_a_revision_says_where_the_session_was_changed_after_its_fit(tmp_path: Path) -> None:
    name = "synek2019_H02"
    bench = Session.open(name, catalogue=False)
    path = tmp_path / "r1.json"
    here = compare(bench.model, bench.observations).summary()
    fit = refit_map(stated_problem(bench.model, bench.observations))
    document = save_revision(bench, fit, path, here, here)
    again = Session.open(name, str(path), catalogue=False)
    assert (again.loaded.fitted, again.loaded.notes) == (f"{document['id']}, fitted to these readings", ())
    measured, (first, *rest) = bench.measured, bench.measured.cases
    entry = first.case
    changes = {
        "mass": (replace(first, case=entry.model_copy(update={"masses_g": {"FDP": 1.0}})), *rest),
        "role": (replace(first, case=entry.model_copy(update={"role": "validation"})), *rest),
        "reading": (replace(first, wrench=first.wrench + 0.001), *rest),
        "left out": tuple(rest),
    }
    for what, cases in changes.items():
        weights = measured.tare_weights[-len(cases) :]
        changed = replace(measured, cases=cases, tare_weights=weights)
        loaded = Session.of(changed, str(path), catalogue=False).loaded
        assert loaded.fitted == f"{document['id']}, fitted to this session before it was changed", what
        assert "before it was changed" in loaded.notes[0], what
        assert loaded.outdated, what
    # A refit takes the change in; a cell's last digit is none; and earlier versions said nothing of it.
    assert not Session.of(changed, str(path), catalogue=False).at(fit).loaded.outdated
    near = replace(measured, cases=(replace(first, wrench=first.wrench + 1e-9), *rest))
    assert not Session.of(near, str(path), catalogue=False).loaded.outdated
    del document["session"]["measured_sha256"]
    old = Session.of(changed, revision_of(document, "old"), catalogue=False)
    assert old.loaded.fitted == f"{document['id']}, fitted to these readings"


@pytest.mark.parametrize(
    "text",
    [
        "{",
        "[]",
        '{"format": "other"}',
        '{"format": "fingertwin-model/1"}',
        "\x00\x01",
        '{"format": "fingertwin-model/1", "parameters": 3}',
    ],
)
def test_damaged_revisions_get_one_line(text: str, tmp_path: Path) -> None:
    path = tmp_path / "model.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ModelError) as caught:
        read_revision(path)
    assert "\n" not in str(caught.value)


def test_no_model_file() -> None:
    bench = Session.open("synek2019_H01", catalogue=False)
    with pytest.raises(ModelError, match="no model file"):
        load_model("absent.json", "x", "an1979_middle", None, layout_of(bench.measured), bench.model.budget)


def test_revision_holds_only_plain_json(tmp_path: Path) -> None:
    bench = Session.open("synek2019_H01", catalogue=False)
    fit = refit_map(stated_problem(bench.model, bench.observations))
    document = revision_document(fit, "x", {}, {}, None)
    text = json.dumps(document, allow_nan=False)
    assert json.loads(text)["covariance"]["names"] == [p.name for p in fit.parameters]
