"""Predictions over the network are those of the model, in as many requests as it takes."""

from __future__ import annotations

import numpy as np
import pytest

from daq.errors import InputError
from fingermodel.fingers.files import read_finger
from fingermodel.model import clamp_forces_batch, jax_values
from fingertwin.client import Client, ServiceError
from fingertwin.client import predictions as asking
from tests.client.services import InProcess

RNG = np.random.default_rng(7)
N = 50
POSTURES = {"MCP": RNG.uniform(-20, 60, N), "PIP": RNG.uniform(20, 90, N), "DIP": RNG.uniform(10, 60, N)}
MASSES = {"FDP": RNG.uniform(0, 1500, N), "EDC": RNG.uniform(0, 400, N)}


def test_predictions_are_those_of_the_model(twin: Client) -> None:
    finger = read_finger("an1979_middle")
    angles, tension = np.zeros((N, len(finger.topology.rotations))), np.zeros((N, len(finger.topology.muscles)))
    for name, degrees in POSTURES.items():
        angles[:, finger.topology.rotations.index(name)] = np.deg2rad(degrees)
    for name, mass_g in MASSES.items():
        tension[:, finger.topology.muscles.index(name)] = 0.835 * 9.81e-3 * mass_g
    direct = clamp_forces_batch(finger.topology, jax_values(finger.values), angles, tension)
    found = twin.predict(POSTURES, MASSES, tension_factor=0.835)
    assert len(found) == N
    np.testing.assert_allclose(found.tip_force_N, np.asarray(direct.tip)[:, :3], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(found.tip_moment_Nmm, np.asarray(direct.tip)[:, 3:], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(found.bone_force_N, np.asarray(direct.bone), rtol=1e-9, atol=1e-12)


def test_large_numbers_of_load_cases_go_in_portions(
    twin: Client, line: InProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = twin.predict(POSTURES, MASSES | {"LU": 40.0})
    line.asked.clear()
    monkeypatch.setattr(asking, "PORTION", 16)
    parts = twin.predict(POSTURES, MASSES | {"LU": 40.0})
    assert len(line.asked) == 4
    np.testing.assert_allclose(parts.tip_force_N, whole.tip_force_N, rtol=1e-9)
    np.testing.assert_allclose(parts.bone_force_N, whole.bone_force_N, rtol=1e-9)


def test_one_load_case_is_a_row(twin: Client) -> None:
    found = twin.predict({"MCP": 0.0, "PIP": 65.0, "DIP": 50.0}, {"FDP": 950.0})
    assert found.tip_force_N.shape == found.bone_force_N.shape == (1, 3)


def test_a_straight_finger_is_undetermined(twin: Client) -> None:
    found = twin.predict({"MCP": [0.0, 0.0], "PIP": [0.0, 65.0], "DIP": [0.0, 50.0]}, tensions_N={"FDP": 5.0})
    assert np.isnan(found.tip_force_N).all(axis=1).tolist() == [True, False]


@pytest.mark.parametrize(
    ("postures_deg", "masses_g", "message"),
    [
        ({"PIP": [1.0, np.nan]}, {"FDP": 1.0}, "postures_deg PIP is nan in row 1"),
        ({"PIP": [1.0, 2.0]}, {"FDP": [1.0, 2.0, 3.0]}, "columns of 2, 3 load cases"),
        ({"PIP": []}, {"FDP": 1.0}, "of shape"),
        ({"PIP": "a lot"}, {"FDP": 1.0}, "a lot"),
        ({"elbow": 1.0}, {"FDP": 1.0}, "elbow"),
        ({"MCP": 1.0, "PIP": 1.0, "DIP": 1.0}, {"FDP": -1.0}, "below zero"),
        ({"PIP": 1.0}, None, "masses_g or tensions_N"),
    ],
)
def test_what_cannot_be_predicted_is_said_in_one_line(
    twin: Client, postures_deg: dict[str, float], masses_g: dict[str, float] | None, message: str
) -> None:
    with pytest.raises(InputError, match=message) as caught:
        twin.predict(postures_deg, masses_g)
    assert len(str(caught.value).splitlines()) == 1


def test_a_model_that_is_not_there_is_refused(twin: Client) -> None:
    with pytest.raises(ServiceError, match="no_finger") as caught:
        twin.predict({"PIP": 1.0}, {"FDP": 1.0}, model="no_finger")
    assert caught.value.status == 422
