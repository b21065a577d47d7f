"""Recorded movements: derivatives of their curves, forces that do not overshoot, and clear errors."""

from __future__ import annotations

import copy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.testing import assert_allclose

from daq.errors import ModelError
from fingermodel.dynamics.motion import Motion, motion_names, read_motion
from fingermodel.fingers.files import read_finger

TOPOLOGY = read_finger("wu2008_index").topology
MADE: dict[str, Any] = {
    "format": "motion/1",
    "id": "mine",
    "title": "made",
    "sources": {"us": "made up"},
    "angles": {
        "unit": "deg",
        "curve": {"kind": "polynomial", "degree": 2},
        "times_s": [0.0, 0.1, 0.2, 0.3, 0.4],
        "rotations": {"abduction": 0.0, "MCP": [0.0, 1.0, 4.0, 9.0, 16.0], "PIP": 20.0, "DIP": 10.0},
        "source": "us",
        "certainty": "assumed",
    },
    "tip_force": {
        "times_s": [0.1, 0.2, 0.3],
        "components": {"Fy_N": [0.0, 2.0, 2.0]},
        "source": "us",
        "certainty": "assumed",
    },
}


def _written(folder: Path, change: Callable[[dict[str, Any]], Any] = lambda d: None) -> Path:
    document = copy.deepcopy(MADE)
    change(document)
    path = folder / "mine.yaml"
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    return path


@pytest.fixture(params=motion_names())
def shipped(request: pytest.FixtureRequest) -> Motion:
    return read_motion(str(request.param))


@pytest.mark.parametrize("curve", [("spline", 3), ("spline", 5), ("polynomial", 4)], ids=lambda c: f"{c[0]}{c[1]}")
def test_rates_are_the_derivatives_of_the_angles(shipped: Motion, curve: tuple[str, int]) -> None:
    h = 1e-5
    # Away from the samples, where a cubic spline's acceleration has corners.
    times = np.linspace(0.0017, 0.2367, 48)
    before, at, after = (shipped.sample(TOPOLOGY, times + d, curve=curve) for d in (-h, 0.0, h))
    rate = (np.asarray(after.posture) - np.asarray(before.posture)) / (2 * h)
    acceleration = (np.asarray(after.rate) - np.asarray(before.rate)) / (2 * h)
    assert_allclose(np.asarray(at.rate), rate, atol=1e-4)
    assert_allclose(np.asarray(at.acceleration), acceleration, atol=1e-2)


def test_splines_and_forces_go_through_the_samples(shipped: Motion) -> None:
    angles, force = shipped.document.angles, shipped.document.tip_force
    inside = [i for i, t in enumerate(angles.times_s) if shipped.span_s[0] <= t <= shipped.span_s[1]]
    sampled = shipped.sample(TOPOLOGY, np.array(angles.times_s)[inside])
    for name, column in angles.rotations.items():
        if isinstance(column, list):
            found = np.asarray(sampled.posture)[:, TOPOLOGY.rotations.index(name)]
            assert_allclose(found, np.array(column)[inside], atol=1e-12)
    assert force is not None
    dense = shipped.sample(TOPOLOGY, np.linspace(*shipped.span_s, 4001))
    values = np.array(force.components["Fy_N"])
    found = np.asarray(dense.tip_force)[:, 1]
    assert values.min() <= found.min()
    assert found.max() <= values.max()


def test_a_polynomial_of_the_right_order_is_found_again(tmp_path: Path) -> None:
    motion = read_motion(_written(tmp_path))
    times = np.linspace(0.0, 0.4, 9)
    found = motion.sample(TOPOLOGY, times)
    mcp = TOPOLOGY.rotations.index("MCP")
    assert_allclose(np.rad2deg(np.asarray(found.posture)[:, mcp]), 100.0 * times**2, atol=1e-9)
    assert_allclose(np.rad2deg(np.asarray(found.acceleration)[:, mcp]), 200.0, atol=1e-6)
    assert_allclose(np.asarray(found.tip_force)[[0, 8], 1], 0.0)
    assert motion.gravity_mm_s2.tolist() == [0.0, 0.0, 0.0]


def _put(*keys: str, value: Any) -> Callable[[dict[str, Any]], None]:
    def change(document: dict[str, Any]) -> None:
        for key in keys[:-1]:
            document = document[key]
        document[keys[-1]] = value

    return change


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (_put("angles", "times_s", value=[0.0, 0.1, 0.1, 0.3, 0.4]), "goes from 0.1 to 0.1 s at entry 3"),
        (_put("angles", "times_s", value=[0.0]), "1 times in angles.times_s; expected at least two"),
        (_put("angles", "rotations", "MCP", value=[0.0, 1.0]), "2 angles of MCP at 5 times"),
        (_put("angles", "rotations", "MCP", value=[0.0, 1.0, float("nan"), 1.0, 1.0]), "finite number"),
        (_put("angles", "rotations", "MCP", value=[0.0, 1.0, 400.0, 1.0, 1.0]), "an angle of MCP of 400 deg"),
        (_put("angles", "unit", value="grad"), "angles.unit"),
        (_put("angles", "curve", value={"kind": "polynomial", "degree": 9}), "5 times for a curve of degree 9"),
        (_put("tip_force", "components", value={"F": [0.0, 1.0, 1.0]}), "tip_force.components"),
        (_put("tip_force", "components", value={"Fx_N": [0.0]}), "1 values of Fx_N at 3 times"),
        (_put("angles", "source", value="nobody"), "source 'nobody' is not listed"),
        (
            _put("span_s", value={"vector": [0.0, 9.0], "source": "us", "certainty": "assumed"}),
            "span_s from 0 to 9 s; expected within 0 to 0.4 s",
        ),
    ],
    ids=[
        "time stands still",
        "one time",
        "too few angles",
        "not a number",
        "beyond a turn",
        "unit",
        "too few for the curve",
        "unknown component",
        "too few forces",
        "source",
        "span",
    ],
)
def test_a_bad_motion_is_named_in_one_line(tmp_path: Path, change: Callable[[dict[str, Any]], None], said: str) -> None:
    with pytest.raises(ModelError) as caught:
        read_motion(_written(tmp_path, change))
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda d: d["angles"]["rotations"].pop("PIP"), "motion mine has no angles of PIP"),
        (_put("angles", "rotations", "wrist", value=1.0), "motion mine has angles of wrist"),
    ],
    ids=["missing", "unknown"],
)
def test_joints_must_be_those_of_the_finger(tmp_path: Path, change: Callable[[dict[str, Any]], Any], said: str) -> None:
    motion = read_motion(_written(tmp_path, change))
    with pytest.raises(ModelError, match=said):
        motion.sample(TOPOLOGY, motion.times(5))


def test_times_outside_the_span_are_refused(shipped: Motion) -> None:
    with pytest.raises(ModelError, match="expected between"):
        shipped.sample(TOPOLOGY, np.array([shipped.span_s[1] + 0.01]))


def test_an_unknown_motion_names_those_there_are() -> None:
    with pytest.raises(ModelError, match="no motion 'wave'; expected a file, or one of wu2008_tap"):
        read_motion("wave")
