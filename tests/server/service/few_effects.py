"""Real fits in workers, with a catalogue that compiles in a third of the time."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from fingermodel.effects import catalogue
from server.service.jobs import inputs, population, tasks
from server.service.jobs.worker import Tell
from server.service.sessions.turns import Made

HERE = __name__
_fit_part = population.fit_part
_EVERY = catalogue.CATALOGUE


@contextmanager
def few_effects() -> Iterator[None]:
    """Leave two effects in the catalogue, here and in the workers of population runs."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(catalogue, "CATALOGUE", catalogue.CATALOGUE)
        patch.setattr(population, "fit_part", fit_part)
        patch.setattr(population, "_open", Made(8))
        leave_few()
        yield


def leave_few() -> None:
    catalogue.CATALOGUE = tuple(e for e in _EVERY if e.name in ("hanger_mass", "zero_offset"))


def refit(payload: inputs.RefitInput, tell: Tell) -> tasks.Answer:
    leave_few()
    return tasks.refit(payload, tell)


def fit_part(part: population.Part) -> dict[str, Any]:
    leave_few()
    return _fit_part(part)
