"""What is said is read off here: the posterior over explanations and hyperparameters, and its marginals."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import TypeVar

import numpy as np
from scipy.special import logsumexp

from fingermodel.diagnosis.posterior.hyper import GROUPS, OTHER_SCATTER, Node
from fingermodel.diagnosis.posterior.optimum import Optimum
from fingermodel.diagnosis.session_model.candidates import NOTHING, Candidate, Explanation
from fingermodel.diagnosis.settings import EVIDENCE_POWER

K = TypeVar("K", bound=Hashable)
# Error of a form from which on what acts is no longer mostly by the law that it is named after.
_MOSTLY = 0.5


def weighed(log_posterior: float, log_prior: float) -> float:
    """Log of a hypothesis' probability, up to a constant: its prior times its evidence to a power."""
    return log_prior + EVIDENCE_POWER * (log_posterior - log_prior)


def summed(each: Iterable[tuple[K, float]]) -> dict[K, float]:
    """Sum of the probabilities of each key, the most probable first."""
    out: dict[K, float] = {}
    for key, p in each:
        out[key] = out.get(key, 0.0) + p
    return dict(sorted(out.items(), key=lambda item: -item[1]))


def _by_structure(fit: Optimum, nodes: Mapping[Node, float]) -> tuple[float, dict[Node, float]]:
    """Log weight of an explanation, up to a constant, and of each of its nodes; both weighed.

    What is smooth, and what carries it, is part of the hypothesis, and its prior counts in full.
    """
    groups: dict[tuple[str, ...], list[Node]] = {}
    for node in nodes:
        groups.setdefault(tuple(fit.hyper.smooth_blocks(node)), []).append(node)
    out: dict[Node, float] = {}
    for some in groups.values():
        whole = float(logsumexp([nodes[node] for node in some]))
        less = whole - weighed(whole, fit.log_prior + fit.hyper.log_prior_of_smooth(some[0]))
        out |= {node: nodes[node] - less for node in some}
    return float(logsumexp(list(out.values()))), out


@dataclass(frozen=True, eq=False)
class Entry:
    """One explanation at one node of the hyperparameters."""

    explanation: Explanation  # what acts
    fit: Optimum | None  # its optimum; None for one that was only promised
    node: Node | None  # of the hyperparameters; None for one that was only promised
    # Candidates that act by their name: no error of form above `FORM_NAMED`, and nothing unknown beside them that is
    # larger, of what neither anatomy nor budget could do as well.
    named: frozenset[str]
    # What acts that no name describes [N]: something smooth, an error of form above `FORM_NAMED`, or a known thing
    # outside the catalogue.
    beyond_newton: float
    probability: float  # of it

    @property
    def outside(self) -> bool:
        """Whether a known thing outside the catalogue is among what acts."""
        return any(m.candidate.outside for m in self.explanation.members)

    @property
    def known(self) -> tuple[Candidate, ...]:
        """Known things outside the catalogue that act, more by their law than by an error of it."""
        members = self.explanation.members
        if self.fit is not None and self.node is not None:
            members = tuple(m for m, error in self.fit.off_in_form(self.node).items() if error < _MOSTLY)
        return tuple(m.candidate for m in members if m.candidate.outside)

    @property
    def unnamed(self) -> bool:
        """Whether something acts, and nothing of it by its name."""
        return not self.named and (self.beyond_newton > 0.0 or self.outside)


@dataclass(frozen=True)
class Promise:
    """What the session linearised about another explanation's optimum promises an explanation that was not fitted."""

    log_posterior: float  # of it
    log_prior: float  # of it, and of what is smooth where the promise was made
    named: frozenset[str]  # candidates that act by their name, as of an `Entry`
    beyond_newton: float  # what acts besides where the promise was made, as of an `Entry`

    @classmethod
    def of(cls, explanation: Explanation, host: Optimum, log_posterior: float, log_prior: float) -> Promise:
        """At a host's most probable node: something smooth acts there, and the host's errors of form as it has them."""
        has = set(host.explanation.members)
        known, beyond = host.named(host.best)
        if not has <= set(explanation.members):
            has, known, beyond = set(), frozenset(), host.hyper.smooth_newton(host.best)
        new = frozenset(m.candidate.name for m in explanation.members if m not in has and not m.candidate.outside)
        smooth = host.hyper.log_prior_of_smooth(host.best)
        return cls(log_posterior, log_prior + smooth, known | new, beyond)


@dataclass(frozen=True, eq=False)
class Posterior:
    """The posterior of one session."""

    fits: dict[Explanation, Optimum]  # the optimum of each explanation that was fitted
    entries: tuple[Entry, ...]  # every explanation at every node that matters
    # Log of the probability of each explanation, up to a constant: prior times evidence to a power.
    weights: dict[Explanation, float]
    log_norm: float  # log of the sum of all of them

    @classmethod
    def of(
        cls,
        fits: dict[Explanation, Optimum],
        promised: Mapping[Explanation, Promise] = MappingProxyType({}),
        nodes: Mapping[Explanation, Mapping[Node, float]] | None = None,
    ) -> Posterior:
        """Normalise what was fitted and what the rest promises.

        Args:
            fits: by explanation.
            promised: to explanations that were not fitted.
            nodes: log joint of each fit's nodes, where it is asked under other assumptions than it was fitted under.
        """
        of_fits = {e: _by_structure(fit, fit.nodes if nodes is None else nodes[e]) for e, fit in fits.items()}
        weights = {e: weight for e, (weight, _) in of_fits.items()}
        weights |= {e: weighed(p.log_posterior, p.log_prior) for e, p in promised.items()}
        total, entries = float(logsumexp(list(weights.values()))), []
        for explanation, fit in fits.items():
            for node, value in of_fits[explanation][1].items():
                named, beyond = fit.named(node)
                entries.append(Entry(explanation, fit, node, named, beyond, float(np.exp(value - total))))
        for e, p in promised.items():
            entries.append(Entry(e, None, None, p.named, p.beyond_newton, float(np.exp(weights[e] - total))))
        return cls(fits, tuple(entries), weights, total)

    def probability(self, holds: Callable[[Entry], bool]) -> float:
        """Of all entries for which something holds."""
        return min(float(sum(e.probability for e in self.entries if holds(e))), 1.0)

    @property
    def nothing(self) -> Optimum:
        """The base model."""
        return self.fits[NOTHING]

    @cached_property
    def leader(self) -> Optimum:
        """The most probable explanation that was fitted."""
        return max(self.fits.values(), key=self.weight)

    def weight(self, fit: Optimum) -> float:
        """Log of the probability of a fit's explanation, up to a constant."""
        return self.weights[fit.explanation]

    @cached_property
    def inclusion(self) -> dict[str, float]:
        """Probability that each candidate acts by its name; the most probable first."""
        by_name = summed((name, e.probability) for e in self.entries for name in e.named)
        return {name: min(p, 1.0) for name, p in by_name.items()}

    @cached_property
    def p_nothing(self) -> float:
        """That no effect acts, and nothing smooth."""
        return self.probability(lambda e: not e.explanation.size and e.beyond_newton == 0.0)

    @cached_property
    def p_beyond(self) -> float:
        """That something acts which no name of the catalogue describes, alone or beside others."""
        return self.probability(lambda e: e.beyond_newton > 0.0 or e.outside)

    @cached_property
    def beyond_newton(self) -> float:
        """Expected size of it if it acts [N]."""
        total = self.probability(lambda e: e.beyond_newton > 0.0)
        return float(sum(e.probability * e.beyond_newton for e in self.entries)) / total if total > 1e-12 else 0.0

    @cached_property
    def carriers(self) -> dict[str, float]:
        """How probable it is that one tendon, rotation or posture alone has what is smooth, if anything is.

        The likeliest first. The rest of the probability is that several of them have.
        """
        known = [(e.fit.hyper, e.node, e.probability) for e in self.entries if e.fit and e.node]
        carried = summed((hyper.carrier(node), p) for hyper, node, p in known if hyper.smooth_blocks(node))
        total = sum(carried.values())
        return {name: p / total for name, p in carried.items() if name}

    def of_names(self, names: Iterable[str]) -> float:
        """Probability that all of some candidates act by their name."""
        wanted = frozenset(names)
        return self.probability(lambda e: wanted <= e.named)

    def of_any(self, names: Iterable[str]) -> float:
        """Probability that one or more of some candidates act by their name."""
        wanted = frozenset(names)
        return self.probability(lambda e: bool(wanted & e.named))

    def of_explanations(self) -> dict[tuple[str, ...] | None, float]:
        """By the names that act and nothing unknown beside them; None is whatever has something unknown or outside."""
        none: dict[tuple[str, ...] | None, float] = {(): 0.0, None: 0.0}
        return none | summed((None if e.unnamed else e.explanation.names, e.probability) for e in self.entries)

    def best_fit(self, names: Sequence[str]) -> Optimum | None:
        """The most probable fit of exactly these names."""
        chosen = [f for e, f in self.fits.items() if set(e.names) == set(names)]
        return max(chosen, key=lambda f: f.log_posterior, default=None)

    def hyperparameter(self, axis: int) -> tuple[float, float]:
        """Mean and standard deviation of what an axis is of, such as `SCATTER` or `BUDGET`, whatever acts."""
        grid = self.nothing.hyper.axes[axis]
        known = [(e.probability, e.node[axis]) for e in self.entries if e.node]
        weight, at = np.array([p for p, _ in known]), np.array([k for _, k in known])
        mean = float(weight @ grid.values[at] / weight.sum())
        variance = weight @ ((grid.values[at] - mean) ** 2 + grid.within[at] ** 2) / weight.sum()
        return mean, float(np.sqrt(variance))

    @property
    def other_scatter(self) -> dict[str, tuple[float, float]]:
        """By case of components, directions and angles; by group of a weight and a mounting: mean and sd.

        None of what the fitted readings cannot show: of that the prior alone would speak.
        """
        fit = self.nothing
        hidden = set(GROUPS) - fit.session.groups_shown
        hidden |= {kind for kind, axis in OTHER_SCATTER.items() if len(fit.hyper.axes[axis].values) == 1}
        return {kind: self.hyperparameter(axis) for kind, axis in OTHER_SCATTER.items() if kind not in hidden}
