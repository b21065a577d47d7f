"""A mounting that a refit finds to be off: how a session takes it up, and what the refit prints of it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from daq.sessions import read_session
from daq.sessions.protocols import read_protocol
from daq.standins.simulated import SimulatedCell
from fingermodel.fingers.files import read_finger
from fingermodel.rig import simulate_session
from fingermodel.session import Session
from server.application.fitted_mounts import fitted_mounts
from tests.server.command_line import H01, run

Floats = NDArray[np.float64]
# Above what the cell's noise leaves in an averaged reading.
NOISE_N, NOISE_NMM = 0.03, 1.0


def simulated(folder: Path, truth: dict[str, float]) -> dict[str, Floats]:
    """What each case would read without noise, of a rig that is recorded in a folder."""
    finger, protocol, cell = read_finger("an1979_middle"), read_protocol("synek2019"), SimulatedCell(rate_hz=50.0)
    return simulate_session(finger, protocol, folder, cell=cell, seed=4, truth=truth, readings_name="readings.parquet")[
        1
    ]


def enter(folder: Path, mounts: dict[str, Any]) -> None:
    """Put mounts into a session's description."""
    file = folder / "session.yaml"
    document = yaml.safe_load(file.read_text(encoding="utf-8"))
    document["load_cell"]["mounts"] |= mounts
    file.write_text(yaml.safe_dump(document), encoding="utf-8")


def away(folder: Path, sound: dict[str, Floats], location: str) -> Floats:
    """How far the session's readings at a location are at most from those of a sound rig: force, and torque."""
    cases = [m for m in Session.open(folder, catalogue=False).measured.cases if m.case.location == location]
    off = np.abs([m.wrench - sound[m.case.id] for m in cases]).max(axis=0)
    return np.array([off[:3].max(), off[3:].max()])


def test_readings_are_those_of_a_sound_rig_once_what_was_fitted_is_entered(tmp_path: Path) -> None:
    truth = {"mounting_rotation.tip.x": 4.0, "mounting_rotation.tip.z": 6.0, "mount_offset.tip.x": 5.0}
    truth |= {"mount_offset.tip.y": -2.0, "cell_rotation.common.y": -3.0, "cell_rotation.tip.x": 2.0}
    simulated(tmp_path / "off", truth)
    sound = simulated(tmp_path / "sound", {})
    before = away(tmp_path / "off", sound, "tip")
    mounts = fitted_mounts(Session.open(tmp_path / "off"), truth)
    assert set(mounts) == {"tip", "bone"}, "the whole cell was turned"
    enter(tmp_path / "off", {location: mount.model_dump(exclude_none=True) for location, mount in mounts.items()})
    for location in mounts:
        force_N, torque_Nmm = away(tmp_path / "off", sound, location)
        assert force_N < NOISE_N < before[0]
        assert torque_Nmm < NOISE_NMM < before[1]


def test_a_refit_prints_the_line_to_enter_and_that_its_sign_is_the_opposite(tmp_path: Path) -> None:
    simulated(tmp_path / "off", {"mount_offset.tip.x": 5.0, "mount_offset.tip.z": 4.0})
    told = run("refit", tmp_path / "off", "--out", tmp_path / "m.json").out
    assert "mount_offset.tip.x" in told
    assert "offset_mm is the opposite" in told
    (line,) = re.findall(r"session\.yaml: +(tip: .*)$", told, re.MULTILINE)
    entry = yaml.safe_load("{" + line + "}")
    np.testing.assert_allclose(entry["tip"]["offset_mm"], [-5.0, 0.0, -4.0], atol=0.3)
    enter(tmp_path / "off", entry)
    body = run("refit", tmp_path / "off", "--out", tmp_path / "n.json", "--json", "-").body("refit")
    values = {p["name"]: p["value"] for p in body["parameters"]}
    assert max(abs(values[f"mount_offset.tip.{axis}"]) for axis in "xyz") < 0.3
    np.testing.assert_allclose(body["mounts"]["tip"]["offset_mm"], entry["tip"]["offset_mm"], atol=0.3)


def test_readings_of_a_left_hand_that_state_no_rotation_get_no_rotation_to_enter(tmp_path: Path) -> None:
    assert read_session("DEV-04").specimen.side == "left"
    told = run("add", "cell_rotation", "DEV-04", "--out", tmp_path / "m.json").out
    assert "session.yaml cannot turn the bone readings of a left hand" in told
    assert "put into load_cell.mounts" not in told


def test_a_rig_that_is_as_described_and_averaged_forces_have_no_such_line(tmp_path: Path) -> None:
    simulated(tmp_path / "sound", {})
    assert "put into load_cell.mounts" not in run("refit", tmp_path / "sound", "--out", tmp_path / "m.json").out
    assert run("refit", H01, "--out", tmp_path / "h.json", "--json", "-").body("refit")["mounts"] == {}
