"""Forces that a sound finger cannot have read: in other units, of the other sign, too large."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from daq.checks import check
from tests.daq.benches import averaged, save


def warned(folder: Path, data: dict[str, Any]) -> set[str]:
    """The codes of the warnings about a session."""
    return {f.code for f in check(save(folder / "S1", data)).warnings}


def test_forces_in_grams_are_remarked(tmp_path: Path) -> None:
    data = averaged()
    data["cases"][0]["force_N"] = [-90.0, -200.0, 5.0]
    assert "force_units" in warned(tmp_path, data)


@pytest.mark.parametrize(
    ("posture", "force_N", "expected"),
    [
        ({"MCP": 20, "PIP": 30, "DIP": 15}, [0.63, -1.23, 0.05], set()),
        ({"MCP": 10, "PIP": 42, "DIP": 22}, [0.54, -1.48, 0.05], set()),
        ({"MCP": 0, "PIP": 65, "DIP": 50}, [0.47, -1.44, 0.05], {"wrong_sign"}),
        ({"MCP": 20, "PIP": 30, "DIP": 15}, [0.63, 1.23, 0.05], {"wrong_sign"}),
    ],
)
def test_the_sign_of_a_force_is_judged_only_where_a_sound_finger_has_one(
    posture: dict[str, float], force_N: list[float], expected: set[str], tmp_path: Path
) -> None:
    # Forces, but for the turned signs, of the finger an1979_middle with 950 g on FDP.
    data = averaged()
    data["postures_deg"]["hook"] = posture
    data["cases"][0]["force_N"] = force_N
    assert warned(tmp_path, data) == expected


def test_an_unweighed_hanger_makes_no_force_too_large_for_the_lumbrical(tmp_path: Path) -> None:
    data = averaged()
    data["cases"][1] |= {"masses_g": {"LU": 45}, "force_N": [0.75, 0.05, 0.0]}
    assert "force_units" not in warned(tmp_path, data)
