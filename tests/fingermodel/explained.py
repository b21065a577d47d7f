"""Made-up linear models and candidates that the tests of a diagnosis share."""

from __future__ import annotations

import numpy as np
from fingermodel.diagnosis.candidates import Candidate
from fingermodel.diagnosis.linear import Linear


def straight(seed: int, readings: int = 30, base: int = 6, effects: int = 5, one_sided: tuple[int, ...] = ()) -> Linear:
    """A random linear model: `base` parameters, then `effects`."""
    rng = np.random.default_rng(seed)
    h = rng.normal(size=(readings, base + effects)) * rng.uniform(0.2, 3.0, base + effects)
    sided = np.zeros(base + effects, dtype=bool)
    sided[list(one_sided)] = True
    return Linear(rng.normal(size=readings) * 2.0, h, np.arange(base), sided, np.zeros(base + effects))


def candidates(count: int = 4, first: int = 6) -> tuple[Candidate, ...]:
    return tuple(Candidate(f"e{k}", f"e{k}", ((first + k,),), 1.0, False) for k in range(count))
