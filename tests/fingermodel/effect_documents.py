"""Documents of effects with formulas, and what a refusal says."""

from __future__ import annotations

from typing import Any

import pytest

from daq.errors import ModelError
from fingermodel.effects.formula import FORMAT
from fingermodel.effects.formula_effect import FormulaEffect
from fingermodel.effects.user import effect_from_dict

K = {"unit": "mm", "range": [-5, 5]}
SHARE = {"unit": "1", "range": [0, 1]}


def document(formula: str | list[str] = "torque[PIP] += k * t_EDC * sin(q_PIP)", **changes: Any) -> dict[str, Any]:
    """An effect's file with some keys changed; None removes one."""
    lines = {"formula": formula} if isinstance(formula, str) else {"formulas": formula}
    whole = {"format": FORMAT, "name": "mine", "title": "a stiff joint", "source": "ours", **lines}
    whole |= {"parameters": {"k": K}} | changes
    return {key: value for key, value in whole.items() if value is not None}


def made(formula: str | list[str], **changes: Any) -> FormulaEffect:
    effect = effect_from_dict(document(formula, **changes), "mine.yaml")
    assert isinstance(effect, FormulaEffect)
    return effect


def with_unit(unit: str, formula: str, low: float = -1.0) -> FormulaEffect:
    return made(formula, parameters={"k": {"unit": unit, "range": [low, 1]}})


def one_line(found: pytest.ExceptionInfo[ModelError]) -> str:
    text = str(found.value)
    assert "\n" not in text
    assert len(text) < 700
    return text
