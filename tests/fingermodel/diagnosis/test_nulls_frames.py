"""Mistakes of a whole rig are named by what would put them right, and no effect of a finger is taken for one."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations, product
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from fingermodel.comparison.observations import Observations
from fingermodel.diagnosis.answer.answer import sentence
from fingermodel.diagnosis.diagnose import diagnose
from fingermodel.diagnosis.model_free.budget import Readings
from fingermodel.diagnosis.model_free.frames import rig_mistake
from fingermodel.diagnosis.model_free.nulls import nulls
from fingermodel.session import Session
from tests.fingermodel.fingers import PUBLISHED
from tests.simulator import draw_session, draw_truth

Floats = NDArray[np.float64]
FACTORS = {"millinewtons": 1e3, "kilonewtons": 1e-3, "pounds-force": 1 / 4.4482, "kilograms-force": 1 / 9.80665}


@pytest.fixture(scope="module")
def bench() -> Session:
    return Session.open("DEV-02", catalogue=False)


def mistake(bench: Session, wrench: Floats) -> str | None:
    found = rig_mistake(bench.model, replace(bench.observations, wrench=wrench))
    return found.words if found else None


def mistaken(bench: Session, axes: Floats, *places: str) -> Floats:
    """Readings of which somebody took the axes for others at some mounts."""
    out = bench.observations.wrench.copy()
    at = np.isin(bench.observations.locations, places)
    out[at] = np.concatenate([out[at, :3] @ axes, out[at, 3:] @ axes], axis=1)
    return out


def axes_of(order: list[int], signs: list[float]) -> Floats:
    return np.diag(signs) @ np.eye(3)[order]


SIGNS = list(product([1.0, -1.0], repeat=3))


@pytest.mark.parametrize("places", [("tip", "bone"), ("tip",), ("bone",)])
def test_axes_that_were_taken_for_others_are_named(places: tuple[str, ...], bench: Session) -> None:
    unnamed = []
    for order, signs in product(permutations([0, 1, 2]), SIGNS):
        said = mistake(bench, mistaken(bench, axes_of(list(order), list(signs)), *places))
        if order[:2] == (0, 1) and signs[:2] == (1.0, 1.0):
            # Next to nothing is loaded sideways: the balance cannot tell which side is which.
            assert said is None
        elif said is None:
            unnamed.append((order, signs))
        else:
            assert (f"the forces at the {places[0]}" if len(places) == 1 else "the forces ") in said
            right = [f"{'' if signs[k] > 0.0 else chr(0x2212)}{'xyz'[order[k]]}" for k in range(3)]
            turned = order == (0, 1, 2) and signs[:2] == (-1.0, -1.0)
            assert f"taken as ({right[0]}, {right[1]}, " in said or (turned and "turned round" in said)
    # What moves the tip's small forces along the pulls of several tendons is put right alike by more than two ways.
    assert len(unnamed) <= (4 if places == ("tip",) else 0)


@pytest.mark.parametrize(("unit", "factor"), FACTORS.items())
def test_another_unit_is_named(unit: str, factor: float, bench: Session) -> None:
    said = mistake(bench, factor * bench.observations.wrench)
    assert said is not None
    assert f"as {unit} have to be" in said


def test_two_mistakes_at_once_are_both_named(bench: Session) -> None:
    said = mistake(bench, 1e3 * mistaken(bench, -np.eye(3), "tip", "bone"))
    assert said is not None
    assert "turned round" in said
    assert "millinewtons" in said


def test_forces_in_the_metacarpal_s_axes_are_named(bench: Session) -> None:
    wrench, tip = bench.observations.wrench.copy(), np.array(bench.observations.locations) == "tip"
    to_base = Readings(bench.model, bench.observations.inputs, bench.observations).to_base[tip]
    wrench[tip, :3] = np.einsum("kab,kb->ka", to_base, wrench[tip, :3])
    said = mistake(bench, wrench)
    assert said is not None
    assert "at the tip taken as along the metacarpal's axes" in said


@pytest.mark.parametrize("session", ["DEV-01", "DEV-02", "DEV-05", "DEV-12", *PUBLISHED])
def test_no_session_as_it_was_recorded_is_called_mistaken(session: str) -> None:
    found = Session.open(session, catalogue=False)
    assert rig_mistake(found.model, found.observations) is None


@pytest.mark.parametrize("seed", range(6))
def test_no_missing_effect_is_taken_for_one(seed: int, tmp_path: Path) -> None:
    draw_session(tmp_path, seed, *draw_truth("outside" if seed % 2 else "two", seed))
    found = Session.open(tmp_path, catalogue=False)
    assert rig_mistake(found.model, found.observations) is None


@pytest.mark.parametrize("factor", [0.75, 1.3])
def test_friction_and_calibration_are_no_unit(factor: float, bench: Session) -> None:
    assert mistake(bench, factor * bench.observations.wrench) is None


def test_heavy_hangers_are_no_unit(tmp_path: Path) -> None:
    draw_session(tmp_path, 2, {"hanger_mass": 60.0})
    found = Session.open(tmp_path, catalogue=False)
    assert rig_mistake(found.model, found.observations) is None


def test_what_no_mistake_known_here_makes_is_called_none(bench: Session) -> None:
    rng = np.random.default_rng(1)
    assert mistake(bench, rng.normal(size=bench.observations.wrench.shape)) is None
    assert mistake(bench, np.zeros_like(bench.observations.wrench)) is None
    one_end = np.where(np.array(bench.observations.locations)[:, None] == "tip", bench.observations.wrench, np.nan)
    assert rig_mistake(bench.model, replace(bench.observations, wrench=one_end)) is None


def axes_mistaken(bench: Session) -> Observations:
    return replace(bench.observations, wrench=mistaken(bench, axes_of([1, 0, 2], [1.0] * 3), "tip", "bone"))


WORDS = "were the forces taken as (y, x, z) instead of (x, y, z), tip and bone would balance"


def test_it_is_said_where_tip_and_bone_do_not_balance(bench: Session) -> None:
    wrong = axes_mistaken(bench)
    (balance,) = [n for n in nulls(bench.model, wrong) if n.name == "balance"]
    assert balance.verdict == "violated"
    assert WORDS in balance.text
    assert "RigMistake" not in balance.text


@pytest.mark.full
def test_it_is_said_with_the_verdict(bench: Session) -> None:
    found = diagnose(Session.open("DEV-02").model, axes_mistaken(bench))
    # What would make up for it is no finding.
    assert found.verdict.kind in ("none_of_catalogue", "undecided")
    assert not found.verdict.effects
    assert found.faults[0].kind == "axes"
    assert found.faults[0].probability > 0.99
    assert WORDS.replace("were", "Were", 1) in sentence(found)
    # No formula is offered to make up for what is to be put right.
    assert found.hints == ()
