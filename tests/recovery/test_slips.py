"""Slips of the pen in simulated sessions: which case is wrong, what was really done, and what stands beside it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from benchmarks.recorded import Recorded
from daq.sessions.models import Mount
from daq.signals.calibration import mount_transform
from daq.vocabulary import OTHER_MOUNT
from tests.recovery.diagnosed import diagnosed
from tests.simulator import draw_session
from tests.simulator.protocols import PROTOCOLS
from tests.simulator.slips import Done


@pytest.mark.parametrize(
    ("kind", "effects", "scatter"),
    [
        pytest.param("posture", {}, 0.01, marks=pytest.mark.full),
        pytest.param("exchanged", {"hanger_mass": 40.0}, 0.01, marks=pytest.mark.full),
        ("kept", {}, 0.0),
        pytest.param("tare", {}, 0.01, marks=pytest.mark.full),
    ],
)
def test_the_case_is_named_and_what_was_done(
    tmp_path: Path, kind: str, effects: dict[str, Any], scatter: float
) -> None:
    done = Done(51, scatter, kind)
    draw_session(tmp_path, 51, effects, nuisance_scale=0.8, done=done)
    found = diagnosed(tmp_path)
    wrong = done.wrong(PROTOCOLS["dev"]())
    assert {s["case"] for s in found["suspects"]} == set(wrong)
    truth = {c.id: c for c in PROTOCOLS["dev"]().cases}
    for suspect in found["suspects"]:
        assert suspect["probability"] > 0.9
        like = suspect["reads_like"][0]
        if kind == "tare":
            assert like["kind"] in ("window", "mass", "unloaded")
        elif kind == "kept":
            assert "still hung" in like["words"]
        else:
            assert like["posture"] == truth[suspect["case"]].posture
            assert like["masses_g"] == pytest.approx(truth[suspect["case"]].masses_g)
        if kind == "exchanged":
            assert {suspect["case"], like["exchanged_with"]} == set(wrong)
    assert found["verdict"] == ("found" if effects else "nothing_missing")
    assert set(found["effects"]) == set(effects)


@pytest.mark.parametrize("location", [pytest.param("tip", marks=pytest.mark.full), "bone"])
def test_a_zero_too_many_on_a_heavy_weight_is_named_and_makes_no_effect(tmp_path: Path, location: str) -> None:
    draw_session(tmp_path, 54, {"hanger_mass": 40.0}, protocol="short")
    file = tmp_path / "session.yaml"
    document = yaml.safe_load(file.read_text(encoding="utf-8"))
    wrong = next(
        c
        for c in document["cases"]
        if c["role"] == "identification" and c["location"] == location and c["masses_g"] == {"FDP": 950.0}
    )
    wrong["masses_g"]["FDP"] = 9500.0
    file.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
    found = diagnosed(tmp_path)
    (suspect,) = found["suspects"]
    assert suspect["case"] == wrong["id"]
    assert suspect["probability"] > 0.9
    assert suspect["reads_like"][0]["masses_g"]["FDP"] == pytest.approx(950.0, rel=0.1)
    # Nobody is asked to hang what was only ever mistyped.
    assert found["next_cases"]
    assert all(sum(c["masses_g"].values()) <= 2.0 * 950.0 for c in found["next_cases"])
    assert (found["verdict"], found["effects"]) == ("found", ["hanger_mass"])


def test_a_case_of_either_mount_that_was_entered_at_the_other_is_named(tmp_path: Path) -> None:
    """Where the cell is turned otherwise at the other mount, too."""
    draw_session(tmp_path, 56, {}, protocol="short", nuisance_scale=0.8)
    session = Recorded(tmp_path)
    cases, wrong = session.document["cases"], dict[str, str]()
    # The cell's own x is the bone's y, its y the bone's -x.
    session.document["load_cell"]["mounts"]["bone"]["rotation_deg"] = [0.0, 0.0, 90.0]
    turned = np.zeros(len(session.t_s), dtype=bool)
    for case in cases:
        if case["location"] == "bone":
            turned |= session.within(case, "unloaded_s") | session.within(case, "loaded_s")
    to_bone = mount_transform(Mount(rotation_deg=(0.0, 0.0, 90.0)), "right").matrix
    session.values[turned] = session.values[turned] @ np.linalg.inv(to_bone).T
    for place, other in OTHER_MOUNT.items():
        of_place = [c for c in cases if (c["location"], c["role"]) == (place, "identification")]
        wrong[of_place[3]["id"]] = place
        of_place[3]["location"] = other
    session.write()
    found = diagnosed(tmp_path)
    assert {s["case"]: s["reads_like"][0]["location"] for s in found["suspects"]} == wrong
    assert all(s["reads_like"][0]["probability"] > 0.9 for s in found["suspects"])
    assert found["verdict"] == "nothing_missing"


@pytest.mark.full
def test_a_slip_that_another_effect_would_explain_is_named_beside_the_true_one(tmp_path: Path) -> None:
    draw_session(tmp_path, 62, {"cell_rotation": (-3.5, 4.0, 0.3)}, nuisance_scale=1.5)
    file = tmp_path / "session.yaml"
    document = yaml.safe_load(file.read_text(encoding="utf-8"))
    # Of one tendon the bone is read once only, and the posture that was entered is another.
    first, *further = [c for c in document["cases"] if c["location"] == "bone" and set(c["masses_g"]) == {"RI"}]
    document["cases"] = [c for c in document["cases"] if c not in further]
    posture, first["posture"] = first["posture"], "major_flexion"
    file.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
    found = diagnosed(tmp_path)
    assert [s["case"] for s in found["suspects"]] == [first["id"]]
    assert found["suspects"][0]["reads_like"][0]["posture"] == posture
    assert (found["verdict"], found["effects"]) == ("found", ["cell_rotation"])


def test_a_validation_case_with_a_slip_is_named_and_does_not_veto(tmp_path: Path) -> None:
    draw_session(tmp_path, 52, {"hanger_mass": 40.0}, protocol="short", nuisance_scale=0.8)
    file = tmp_path / "session.yaml"
    document = yaml.safe_load(file.read_text(encoding="utf-8"))
    case = next(c for c in document["cases"] if c["role"] == "validation" and c["location"] == "tip")
    (wrong, grams), *_ = case["masses_g"].items()
    case["masses_g"][wrong] = 0.4 * grams
    file.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
    found = diagnosed(tmp_path)
    assert [(s["case"], s["role"]) for s in found["suspects"]] == [(case["id"], "validation")]
    assert (found["verdict"], found["effects"]) == ("found", ["hanger_mass"])


def test_a_suspect_does_not_count_in_the_errors(tmp_path: Path) -> None:
    done = Done(51, 0.0, "mass")
    draw_session(tmp_path, 51, {}, nuisance_scale=0.8, done=done)
    found = diagnosed(tmp_path)
    (wrong,) = done.wrong(PROTOCOLS["dev"]())
    assert [s["case"] for s in found["suspects"]] == [wrong]
    place = next(c["location"] for c in found["cases"] if c["id"] == wrong)
    counted = sum(c["location"] == place and c["role"] == "identification" for c in found["cases"])
    summary = found["before"][f"identification/{place}"]["sagittal"]
    assert summary["cases"] == counted - 1
    assert summary["rmse_N"] < 0.05


@pytest.mark.full
def test_loads_hung_the_other_way_round_in_two_postures_are_told_and_put_right_by_their_masses(tmp_path: Path) -> None:
    draw_session(tmp_path, 51, {}, nuisance_scale=0.8, done=Done(51, 0.01))
    file = tmp_path / "session.yaml"
    document = yaml.safe_load(file.read_text(encoding="utf-8"))
    at_tip = [c for c in document["cases"] if c["role"] == "identification" and c["location"] == "tip"]
    one = next(c for c in at_tip if list(c["masses_g"]) == ["FDP"])
    other = next(c for c in at_tip if list(c["masses_g"]) == ["EDC"] and c["posture"] != one["posture"])
    hung = {one["id"]: one["masses_g"], other["id"]: other["masses_g"]}
    one["masses_g"], other["masses_g"] = other["masses_g"], one["masses_g"]
    file.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
    found = diagnosed(tmp_path)
    assert {s["case"] for s in found["suspects"]} == set(hung)
    for suspect in found["suspects"]:
        like = suspect["reads_like"][0]
        assert (like["kind"], like["exchanged_with"]) == ("exchanged", None)
        assert like["masses_g"] == hung[suspect["case"]]
    assert found["verdict"] == "nothing_missing"
