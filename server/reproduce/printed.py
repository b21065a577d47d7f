"""Numbers as papers print them, from `data/reference`, and rows that set ours beside them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
import yaml

from daq.locations import data_dir
from fingermodel.studies.published import Row, not_available, row


@cache
def reference(study: str) -> dict[str, Any]:
    """Return the contents of `data/reference/STUDY.yaml`: tables and text as printed, and what stands for gaps."""
    numbers: dict[str, Any] = yaml.safe_load((data_dir() / "reference" / f"{study}.yaml").read_text(encoding="utf-8"))
    return numbers


def rows_beside(lines: Sequence[Sequence[str]], ours: Mapping[str, float | None], why: str = "") -> list[Row]:
    """Set printed numbers beside ours.

    Args:
        lines: quantity, printed number, unit, name of ours; and a note, where there is one.
        ours: by name.
        why: reason why all of them cannot be recomputed; empty where they are compared.
    """
    if why:
        return [not_available(quantity, text, ours.get(name), unit, why) for quantity, text, unit, name, *_ in lines]
    rows = []
    for quantity, text, unit, name, *note in lines:
        value = ours[name]
        rows.append(row(quantity, text, np.nan if value is None else value, unit, *note))
    return rows
