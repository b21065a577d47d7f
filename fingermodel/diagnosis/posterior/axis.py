"""One hyperparameter on a grid, with the prior of each of its values."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import erf

from fingermodel.arrays import Floats
from fingermodel.diagnosis.settings import Amount


@dataclass(frozen=True, eq=False)
class Axis:
    """Values of one hyperparameter with the log probability of each."""

    values: Floats
    log_weight: Floats

    @classmethod
    def of(cls, size: Amount) -> Axis:
        """Of a size that may be none."""
        spread = np.sqrt(2.0) * size.scale
        return cls.with_atom(size.values, _cells(size.values, lambda x: erf(x / spread)), size.some)

    @classmethod
    def none(cls) -> Axis:
        """Of a size that can only be none."""
        return cls(np.zeros(1), np.zeros(1))

    @classmethod
    def with_atom(cls, values: Floats, weight: Floats, some: float) -> Axis:
        """An atom at the first value; the rest has a probability, in proportion to weights (the first is ignored)."""
        rest = weight[1:] / weight[1:].sum()
        return cls(values, np.log(np.concatenate([[1.0 - some], some * rest])))

    @classmethod
    def normal(cls, values: Floats, z: Floats) -> Axis:
        """Normal in what each value is (n,) in standard deviations."""
        weight = np.exp(-0.5 * z**2)
        return cls(values, np.log(weight / weight.sum()))

    @classmethod
    def half_cauchy(cls, values: Floats, scale: float) -> Axis:
        """Half-Cauchy, on values that begin at 0."""
        return cls(values, np.log(_cells(values, lambda x: np.arctan(x / scale))))

    @cached_property
    def mode(self) -> int:
        """Index of the most probable value."""
        return int(np.argmax(self.log_weight))

    @cached_property
    def within(self) -> Floats:
        """Standard deviation of what each value of a size stands for: uniform over its cell, and 0 for the first."""
        if len(self.values) == 1:
            return np.zeros(1)
        lower = _between(self.values)
        upper = np.append(lower[1:], self.values[-1] ** 2 / lower[-1])
        return np.concatenate([[0.0], (upper - lower) / np.sqrt(12.0)])

    @cached_property
    def value(self) -> list[float]:
        """The values as plain numbers: thousands of nodes ask for one each."""
        return self.values.tolist()

    @cached_property
    def weight(self) -> list[float]:
        """Their log probabilities as plain numbers."""
        return self.log_weight.tolist()


def _cells(values: Floats, cdf: Callable[[Floats], Floats]) -> Floats:
    """Probability of the cells about values that begin at 0, by a distribution function up to a factor."""
    edges = np.concatenate([[0.0], _between(values), [np.inf]])
    probability = np.diff(cdf(edges))
    return np.maximum(probability / probability.sum(), 1e-12)


def _between(values: Floats) -> Floats:
    """Edges of the cells about values that grow in proportion, the first of which may be 0."""
    out: Floats = np.sqrt(values[:-1] * values[1:])
    out[0] = out[0] or 0.5 * values[1]
    return out
