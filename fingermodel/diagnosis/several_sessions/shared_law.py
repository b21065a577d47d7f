"""A law that nobody listed and that several sessions share: found as a smooth curve, and likened to small laws.

Beside all that acts in each session by itself (anatomy, budget, noise, scatter, something smooth of its own) a curve of
each tendon and joint is the same in all of them: an error of moment arms, tensions or forces, smooth over postures.
Each session says of the curve's weights what its readings do; the curve's evidence is that of the sum.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import TypeVar

import numpy as np
from scipy.special import logsumexp

from fingermodel.arrays import Floats, Ints
from fingermodel.diagnosis.posterior.curves import (
    SIZES,
    Curve,
    Curves,
    SmoothCurve,
    Stage,
    described,
    gain,
    values_of,
)
from fingermodel.diagnosis.posterior.gaussian import Quadratic
from fingermodel.diagnosis.posterior.hyper import Node
from fingermodel.diagnosis.posterior.optimum import Optimum
from fingermodel.diagnosis.settings import SEED

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class SharedCurve(SmoothCurve):
    """A curve that sessions share; its log evidence is over each session's having its own."""

    left_out_gain: Floats  # (sessions,) log density that it adds to each session, learned from the other specimens
    own: Floats  # (sessions, parts, postures) by each session alone
    nodes: tuple[Node, ...]  # of the sessions


@dataclass(eq=False)
class StageSearch:
    """The curve of one stage: what sessions say of it at their nodes, each asked once."""

    fits: Sequence[Optimum]  # of each session
    specimens: Sequence[str]  # of each session
    curves: Curves  # of the sessions
    stage: Stage  # of the curve
    # Nodes of the sessions to which each size that was tried leads.
    paths: dict[float, tuple[Node, ...]] = field(default_factory=dict)
    _known: dict[tuple[int, Node], Quadratic] = field(default_factory=dict, repr=False)

    @cached_property
    def columns(self) -> list[Curve]:
        """Of each session."""
        return [self.curves.of(fit, self.stage) for fit in self.fits]

    def said(self, k: int, node: Node) -> Quadratic:
        """What a session says at a node; without the curve, minus twice the log joint there."""
        if (k, node) not in self._known:
            fit = self.fits[k]
            found = fit.quadratic_of(self.columns[k].columns, node)
            self._known[k, node] = replace(found, value=-2.0 * fit.log_joint(node))
        return self._known[k, node]

    def all_said(self, nodes: Sequence[Node]) -> list[Quadratic]:
        """What all sessions say, each at its node."""
        return [self.said(k, node) for k, node in enumerate(nodes)]

    def value(self, nodes: Sequence[Node], size: float) -> float:
        """Log of prior times likelihood of all sessions together."""
        return _together(self.all_said(nodes), size)

    def climbed(self, nodes: Sequence[Node], size: float) -> list[Node]:
        """The sessions' nodes from which no step along an axis of one of them leads higher."""
        value = partial(self.value, size=size)
        return _ascended(nodes, value, lambda k, node: self.fits[k].hyper.neighbours(node))[0]

    def log_evidence(self, nodes: Sequence[Node], size: float) -> float:
        """With each session's hyperparameters summed about its node, the others where they are."""
        value, more = self.value(nodes, size), 0.0
        for k, fit in enumerate(self.fits):
            around = [node for node in fit.hyper.neighbours(nodes[k]) if (k, node) in self._known]
            each = [self.value([*nodes[:k], node, *nodes[k + 1 :]], size) for node in around]
            more += float(logsumexp([value, *each])) - value
        return value + more

    def run(self) -> SharedCurve:
        """Climb at every size, and describe the best."""
        nodes: list[Node] = [fit.best for fit in self.fits]
        sizes = SIZES[self.stage]
        values = {}
        for size in (0.0, *sizes):
            nodes = self.climbed(nodes, size)
            self.paths[size] = tuple(nodes)
            values[size] = self.log_evidence(nodes, size)
        together = float(logsumexp([values[s] for s in sizes]) - np.log(len(sizes)))
        best = max(sizes, key=lambda s: values[s])
        return self._described(best, together - values[0.0])

    def _described(self, size: float, over_own: float) -> SharedCurve:
        said = self.all_said(self.paths[size])
        others = [[s for s, of in zip(said, self.specimens, strict=True) if of != own] for own in self.specimens]
        left_out = np.array([gain([*o, s], size) - gain(o, size) for o, s in zip(others, said, strict=True)])
        own = np.array([values_of(self.curves, [one], size)[0] for one in said])
        found = described(self.curves, self.columns[0], said, size, over_own)
        return SharedCurve(**vars(found), left_out_gain=left_out, own=own, nodes=self.paths[size])

    def shown_by(self, found: SharedCurve, changes: Sequence[Floats]) -> Floats:
        """What the curve would be if the sessions' readings were changed by a law and by nothing else.

        A law and the curve are alike only as far as the readings see both; so the law is smoothed as the curve is.

        Args:
            found: the curve, with its size and the sessions' nodes.
            changes: (cases, 6) of each session's readings by the law.

        Returns:
            (parts, postures), in the stage's unit.
        """
        said = []
        for fit, curve, node, change in zip(self.fits, self.columns, found.nodes, changes, strict=True):
            law = change.reshape(-1)[fit.session.rows[fit.session.fitted]]
            both = fit.quadratic_of(np.column_stack([curve.columns, law]), node).hessian
            said.append(Quadratic(0.0, both[:-1, -1], both[:-1, :-1], 0.0))
        return values_of(self.curves, said, found.size)[0]

    def best_value(self, shuffled: Sequence[tuple[Ints, Floats]]) -> float:
        """What sharing gains at most over not sharing, with tendons of each session in another order and sign."""
        tendons, weights = self.tendons, self.columns[0].columns.shape[1]
        of_tendons = np.arange(weights).reshape(tendons, -1)
        turned = [(of_tendons[order].reshape(-1), np.repeat(sign, weights // tendons)) for order, sign in shuffled]
        reached = [dict.fromkeys(path[k] for path in self.paths.values()) for k in range(len(self.fits))]
        said = [{n: self.said(k, n).turned(*turned[k]) for n in nodes} for k, nodes in enumerate(reached)]
        nothing, out = -0.5 * sum(min(s.value for s in mine.values()) for mine in said), 0.0
        for size, path in self.paths.items():
            start = [mine[node] for mine, node in zip(said, path, strict=True)]
            value = partial(_together, size=size)
            best = _ascended(start, value, lambda k, one: [s for s in said[k].values() if s is not one])[1]
            out = max(out, best - nothing)
        return out

    @property
    def tendons(self) -> int:
        """How many tendons the weights are of, those of one after those of another."""
        return len({muscle for muscle, _ in self.columns[0].parts})


def _together(said: Sequence[Quadratic], size: float) -> float:
    """Log of prior times likelihood of all sessions together, with weights of a size."""
    return Quadratic.of_all(said).of_size(size).log_evidence


def _ascended(
    start: Sequence[T], value: Callable[[Sequence[T]], float], others: Callable[[int, T], Iterable[T]]
) -> tuple[list[T], float]:
    """Choose one of each session such that no other one of a session is better; with the value that it has.

    Args:
        start: where to begin.
        value: of all sessions' choices together.
        others: what else may be chosen of a session, by its index and what is chosen.
    """
    best, reached, moved = list(start), value(start), True
    while moved:
        moved = False
        for k in range(len(best)):
            for other in others(k, best[k]):
                trial = [*best[:k], other, *best[k + 1 :]]
                if (now := value(trial)) > reached:
                    best, reached, moved = trial, now, True
    return best, reached


def permuted(searches: Sequence[StageSearch], count: int, tell: Callable[[float], None]) -> tuple[float, Floats]:
    """What sharing gains at most, as the sessions are and with tendons and signs of each shuffled.

    Sessions that share nothing gain as much in any order. Those of one specimen are shuffled alike: what is its own is
    no chance.

    Args:
        searches: of the stages, that have run.
        count: of shuffles.
        tell: is told the share done.

    Returns:
        The gain as the sessions are, and (count,) after shuffles; always the same ones.
    """
    rng = np.random.default_rng(SEED)

    def best(shuffled: Sequence[tuple[Ints, Floats]]) -> float:
        return max(search.best_value(shuffled) for search in searches)

    muscles, specimens = searches[0].tendons, searches[0].specimens
    plain = (np.arange(muscles), np.ones(muscles))
    observed = best([plain] * len(specimens))
    out = np.empty(count)
    others = [one for one in dict.fromkeys(specimens) if one != specimens[0]]
    for k in range(count):
        of = {one: (rng.permutation(muscles), rng.choice([-1.0, 1.0], muscles)) for one in others}
        out[k] = best([of.get(one, plain) for one in specimens])
        tell((k + 1) / count)
    return observed, out


def p_value(observed: float, shuffled: Floats) -> float:
    """Share of the shuffles that gain as much, the sessions as they are counted as one."""
    return float((1 + np.sum(shuffled >= observed)) / (1 + len(shuffled)))
