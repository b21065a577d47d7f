"""An effect must act to first order at its null: else no evidence could speak against it."""

from __future__ import annotations

from pathlib import Path

import pytest

from daq.errors import ModelError
from fingermodel.effects.catalogue import EFFECTS
from fingermodel.effects.contract import flat_faults
from fingermodel.effects.user import load_effect, shipped_effects
from fingermodel.fingers.files import read_finger
from fingermodel.stages import Effect, Layout

LAYOUT = Layout((("hook", 0), ("minor_flexion", 0)), (("tip", 0), ("bone", 0)))
PASSIVE = """format: fingertwin-effect/1
name: passive
title: a passive torque
source: a test
formula: torque[MCP] += k * (exp(a * q_MCP) - 1)
parameters:
  k: {unit: "N mm", range: [-20, 20]}
  a: {unit: "1", range: [-3, 3]NULL}
"""


def shipped() -> list[Effect]:
    return [load_effect(Path(name)) for name in shipped_effects()]


@pytest.mark.parametrize("effect", shipped(), ids=lambda e: e.name)
def test_every_shipped_effect_acts_at_once(effect: Effect) -> None:
    assert not flat_faults(effect, read_finger("an1979_middle").topology, LAYOUT)


@pytest.mark.parametrize("name", ["bowstringing", "worn_pulley", "hood_shift"])
def test_effects_with_forms_of_several_parameters_act_at_once(name: str) -> None:
    assert not flat_faults(EFFECTS[name], read_finger("an1979_middle").topology, LAYOUT)


def test_two_parameters_that_vanish_together_are_refused_with_what_to_do(tmp_path: Path) -> None:
    file = tmp_path / "passive.yaml"
    file.write_text(PASSIVE.replace("NULL", ""), encoding="utf-8")
    with pytest.raises(ModelError, match="nothing changes to first order"):
        load_effect(file)
    file.write_text(PASSIVE.replace("NULL", ", null: 2"), encoding="utf-8")
    assert load_effect(file).name == "passive"
