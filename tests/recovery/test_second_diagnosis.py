"""Sessions of the second simulator, read: a small sample of `python -m benchmarks.recovery --second`."""

from __future__ import annotations

from pathlib import Path

import pytest

from fingermodel.diagnosis.answer.ranking import parameters_of
from fingermodel.session import Session
from server.application.diagnosing import run_diagnosis
from tests.second_simulator import Kind, write_session


@pytest.mark.parametrize(
    ("kind", "seed", "effects"),
    [
        # A zero that the mounting does not lever: its moment is not a tip elsewhere.
        pytest.param("one", 21, ("zero_offset",), marks=pytest.mark.full),
        # A drift that swings, and flexors held beyond a joint and pressed on an extended one.
        pytest.param("one", 22, ("tare_drift",), marks=pytest.mark.full),
        pytest.param("one", 31, ("bowstringing",), marks=pytest.mark.full),
        # Sutures that meet in one eyelet, as far behind the joint as they truly are.
        ("one", 41, ("suture_angle",)),
    ],
)
def test_an_effect_of_another_form_is_named(tmp_path: Path, kind: Kind, seed: int, effects: tuple[str, ...]) -> None:
    truth = write_session(tmp_path, kind, seed)
    assert truth.effects == effects
    found = run_diagnosis(Session.open(tmp_path))
    assert (found.verdict.kind, found.verdict.effects) == ("found", effects), found.verdict
    if effects == ("suture_angle",):
        sizes = {p["name"]: p["value"] for p in parameters_of(found.best)}
        assert sizes["suture_angle.convergence"] == pytest.approx(1000.0 / 140.0, abs=0.5)


@pytest.mark.full
@pytest.mark.parametrize("seed", [2, 4, 8])
def test_what_the_catalogue_does_not_hold_is_not_named(tmp_path: Path, seed: int) -> None:
    truth = write_session(tmp_path, "outside", seed)
    found = run_diagnosis(Session.open(tmp_path))
    assert not found.verdict.effects, truth.outside
