"""Effects are added to a model that may have some already: what is left, and what is refused before any fit."""

from __future__ import annotations

import pytest

from daq.errors import ModelError
from fingermodel.diagnosis.answer.addition import add_effects
from fingermodel.diagnosis.session_model.candidates import Candidates
from fingermodel.session import Session

HELD = tuple(f"zero_offset.bone.{axis}" for axis in "xyz")


@pytest.fixture(scope="module")
def bench() -> Session:
    return Session.open("DEV-01")


def test_candidates_beside_the_one_that_a_model_has_can_still_be_found(bench: Session) -> None:
    every, left = (Candidates.of(bench.model, held=held) for held in ((), HELD))
    assert {c.name for c in every.all} - {c.name for c in left.all} == {"zero_offset.bone"}
    # What is left of an effect is as probable as before.
    before = {c.name: c.share for c in every.all}
    assert all(c.share == before[c.name] for c in left.all)


@pytest.mark.parametrize("name", ["zero_offset.bone", "hanger_mass"])
def test_what_the_model_has_is_not_added_again(bench: Session, name: str) -> None:
    with pytest.raises(ModelError, match=f"the model has {name} already"):
        add_effects(bench.model, bench.observations, [name], held=[*HELD, "hanger_mass.m0"])


@pytest.mark.parametrize("names", [("hanger_mass", "hanger_mass"), ("worn_pulley.FDP", "worn_pulley.FDP")])
def test_an_effect_is_added_once(bench: Session, names: tuple[str, ...]) -> None:
    with pytest.raises(ModelError, match="share a parameter"):
        add_effects(bench.model, bench.observations, names)
