"""Fingers, movements, studies and forces inside, asked from Python."""

from __future__ import annotations

from pathlib import Path

import pytest

from fingermodel.fingers.files import finger_names, read_finger
from fingertwin.client import Client, ServiceError
from server.reproduce.study import STUDIES

FINGER = "an1979_middle"


def test_a_finger_goes_out_and_comes_back(twin: Client, tmp_path: Path) -> None:
    assert [f["name"] for f in twin.fingers()] == finger_names()
    file = twin.export_finger(FINGER, tmp_path / "theirs.osim")
    back = twin.import_finger(file)
    ours = tmp_path / "back.yaml"
    ours.write_text(back["file"], encoding="utf-8")
    assert read_finger(ours).topology == read_finger(FINGER).topology
    with pytest.raises(ServiceError, match="no finger none"):
        twin.export_finger("none", tmp_path / "none.osim")
    assert not (tmp_path / "none.osim").exists()


def test_a_specimen_is_scaled(twin: Client) -> None:
    found = twin.scale_finger(FINGER, {"PP": 40.0})
    assert {b["bone"] for b in found["bones"]} == set(read_finger(FINGER).topology.bones)
    with pytest.raises(ServiceError, match="mm"):
        twin.scale_finger(FINGER, {"PP": 0.04})


def test_movements_and_activations_are_worked_out(twin: Client) -> None:
    found = twin.move(steps=20)
    assert len(found["times_s"]) == 20
    with pytest.raises(ServiceError, match="document"):
        twin.move({"format": "motion/1"})
    held = twin.activate("barry2018_index", {"FDP": 1.0})
    assert held["together"]["lost_pct"] == {"FDP": 100.0}


def test_studies_are_jobs(twin: Client) -> None:
    assert [s["name"] for s in twin.studies()] == [s.name for s in STUDIES]
    job = twin.reproduce("wu2008")
    assert job.kind == "reproduce"
    job.cancel()
    with pytest.raises(ServiceError, match="no study none"):
        twin.reproduce("none")


def test_forces_inside_are_asked_of_a_session(twin: Client) -> None:
    session = twin.upload("DEV-01")
    found = session.invert("minimal")
    assert found["closure"] == "minimal"
    assert found["sentences"]
