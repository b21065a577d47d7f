"""One hyperparameter on a grid, with the prior of each of its values."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from math import erf

import numpy as np
from numpy.typing import ArrayLike

from fingermodel.arrays import Floats


@dataclass(frozen=True, eq=False)
class Axis:
    """Values of one hyperparameter with the log probability of each, and the scale of its prior."""

    values: Floats
    log_weight: Floats
    scale: float = 1.0

    @classmethod
    def size(cls, some: float, scale: float, values: ArrayLike) -> Axis:
        """Of a size that may be none: an atom at none, else half-normal; `some` that it is not none."""
        at = np.array(values)
        cells = _cells(at, lambda edges: np.array([erf(x / (np.sqrt(2.0) * scale)) for x in edges]))
        return cls(at, np.log(cells), scale).with_atom(some)

    def times(self, unit: float) -> Axis:
        """The same of a size that is stated as a multiple of something."""
        return replace(self, values=unit * self.values, scale=unit * self.scale)

    @classmethod
    def none(cls) -> Axis:
        """Of a size that can only be none."""
        return cls(np.zeros(1), np.zeros(1))

    def with_atom(self, some: float) -> Axis:
        """An atom at the first value; the rest has a probability, in proportion to its weights."""
        rest = np.exp(self.log_weight[1:])
        return replace(self, log_weight=np.log(np.concatenate([[1.0 - some], some * rest / rest.sum()])))

    @classmethod
    def log_normal(cls, values: ArrayLike, about: float, factor: float) -> Axis:
        """Log-normal about a value, by a factor."""
        at = np.array(values)
        weight = np.exp(-0.5 * (np.log(np.maximum(at, 1e-4) / about) / np.log(factor)) ** 2)
        return cls(at, np.log(weight / weight.sum()))

    @classmethod
    def half_cauchy(cls, scale: float, values: ArrayLike) -> Axis:
        """Half-Cauchy, on values that begin at 0."""
        return cls(np.array(values), np.log(_cells(np.array(values), lambda x: np.arctan(x / scale))), scale)

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
