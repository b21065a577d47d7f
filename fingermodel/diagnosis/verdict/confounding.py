"""What this very protocol can show, and what it cannot tell apart, before any verdict."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fingermodel.arrays import Floats, Mask
from fingermodel.diagnosis.posterior.optimum import Optimum
from fingermodel.diagnosis.session_model.candidates import Candidates
from fingermodel.diagnosis.settings import ALIKE

# Standard deviations below which an effect as large as its prior hardly stands out.
_DETECTABLE = 2.0


@dataclass(frozen=True, eq=False)
class Confounding:
    """Candidates against each other."""

    names: tuple[str, ...]  # of the candidates
    correlation: Floats  # (n, n) largest canonical correlation of what they change, beyond what the base model absorbs
    detectability: dict[str, float]  # of each, in standard deviations at the size of its prior
    classes: tuple[tuple[str, ...], ...]  # sets of names that are alike, of two or more

    def alike(self, name: str) -> tuple[str, ...]:
        """Candidates that cannot be told from one, the nearest first."""
        if name not in self.names:
            return ()
        row = self.correlation[self.names.index(name)]
        order = np.argsort(-row)
        return tuple(self.names[i] for i in order if self.names[i] != name and row[i] >= ALIKE)

    def hidden(self, candidates: Candidates) -> tuple[str, ...]:
        """Effects of the catalogue that hardly stand out wherever they act, even as large as their priors."""
        known = [c for c in candidates.all if not c.outside]
        shown = {c.effect for c in known if self.detectability[c.name] >= _DETECTABLE}
        return tuple(dict.fromkeys(c.effect for c in known if c.effect not in shown))

    def as_dict(self) -> dict[str, object]:
        """As the answer gives it."""
        return {
            "effects": list(self.names),
            "correlation": [[round(float(x), 4) for x in row] for row in self.correlation],
            "classes": [list(c) for c in self.classes],
        }


def confounding(base: Optimum, candidates: Candidates) -> Confounding:
    """Compare what the candidates change beyond noise and all that the base model absorbs, nothing smooth allowed for.

    Of each its first form is taken.
    """
    node = base.hyper.without_smooth(base.best)
    quadratic, parameters = base.effects_at(node)
    position = {int(p): k for k, p in enumerate(parameters)}
    chosen = [[position[i] for i in c.forms[0]] for c in candidates.all]
    names, n = tuple(c.name for c in candidates.all), len(chosen)
    blocks = [quadratic.hessian[np.ix_(index, index)] for index in chosen]
    roots = [_inverse_root(block) for block in blocks]
    detectability = {
        name: float(np.sqrt(max(np.trace(b), 0.0) / len(b))) for name, b in zip(names, blocks, strict=True)
    }
    correlation = np.eye(n)
    for i in range(n):
        for j in range(i):
            cross = quadratic.hessian[np.ix_(chosen[i], chosen[j])]
            value = np.linalg.norm(roots[i] @ cross @ roots[j].T, 2)
            correlation[i, j] = correlation[j, i] = min(float(value), 1.0)
    shown = np.array([detectability[name] >= _DETECTABLE for name in names])
    return Confounding(names, correlation, detectability, _classes(names, correlation, shown))


def _inverse_root(block: Floats) -> Floats:
    """B^-½ over the directions that the data see at all."""
    values, vectors = np.linalg.eigh(block)
    kept = values > max(1.0, 1e-6 * float(values.max(initial=0.0)))
    out: Floats = (vectors[:, kept] / np.sqrt(values[kept])).T
    return out if kept.any() else np.zeros((1, len(block)))


def _classes(names: tuple[str, ...], correlation: Floats, shown: Mask) -> tuple[tuple[str, ...], ...]:
    """Connected sets of candidates that are alike and can be seen."""
    joined = (correlation >= ALIKE) & shown & shown[:, None]
    for k in range(len(names)):
        # Whatever is alike to one is joined to all that this one is joined to.
        joined |= joined[:, [k]] & joined[k]
    groups = dict.fromkeys(tuple(np.flatnonzero(row)) for row in joined)
    return tuple(tuple(names[i] for i in group) for group in groups if len(group) > 1)
