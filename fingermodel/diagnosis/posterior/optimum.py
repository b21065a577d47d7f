"""An explanation at its optimum: its evidence over the hyperparameters, and what the linearised session says there.

What of its changes neither anatomy nor budget could make is their own part; by that, members have their name or not.
"""

from __future__ import annotations

import weakref
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.special import logsumexp

from fingermodel.arrays import Floats, Ints, Mask
from fingermodel.diagnosis.posterior.gaussian import (
    Everything,
    Freed,
    freed_by_columns,
    log_mass,
    log_mass_apart,
    screened,
)
from fingermodel.diagnosis.posterior.hyper import ACTING, CARRIER, FORMS, GROUPS, NOISE, SMOOTH, Node, Steps, log_share
from fingermodel.diagnosis.posterior.linearised import OTHERS, OWN, Linearised
from fingermodel.diagnosis.session_model.candidates import Explanation, Member
from fingermodel.diagnosis.settings import FAR, FORM_NAMED, WITHIN
from fingermodel.fitting.roots import absorbed_by

# Prior widths from its null at which a parameter begins of which nothing is known.
_AWAY = 0.5
# Units of chi-square that may be promised beyond where a fit ends.
_SETTLED = 1.0


@dataclass(frozen=True, eq=False)
class Optimum(Linearised):
    """An explanation where it explains the readings best."""

    log_prior: float  # of the explanation
    node: Node  # of the hyperparameters under which it was fitted
    # Misfit that the linearised model promises to save, and the solver did not save: at a kink, or where the model
    # bends. The evidence does not count it.
    unkept: float
    # Log posterior of the leader when it was fitted; an explanation far below needs no more than a rough one.
    leader: float = -np.inf
    # What is asked once: shares of something smooth that neither anatomy nor budget could make, by block, and names.
    _shares: dict[str, float] = field(default_factory=dict, init=False, repr=False)
    _named: dict[Node, tuple[frozenset[str], float]] = field(default_factory=dict, init=False, repr=False)

    @property
    def settled(self) -> bool:
        """Whether the fit ended where hardly anything more is promised."""
        return self.unkept <= _SETTLED

    @cached_property
    def _one_sided(self) -> Mask:
        return np.asarray(self.session.model.parameters.one_sided[self.parameters_of[OWN]])

    def freed(self, node: Node, width: float = 1.0) -> Freed:
        """The explanation's own parameters at a node, all else left open; `width` multiplies that of their priors."""
        names, own = [*self.acting(node), OWN], self.size(OWN)
        widths, places = self.widths(names, node), self.places(names)
        widths[len(widths) - own :] *= width
        if not self.steep(node):
            return self.quadratic(names, node).freed(widths, places, own)
        # By an orthogonal factor of the columns themselves, which takes some times as long.
        columns, residual = self.whitened_at(names, node)
        freed = freed_by_columns(columns * widths, residual + columns @ places, own)
        log_det = self.whitening(node).log_det + freed.log_det
        return Freed(freed.misfit, log_det, width * freed.mean, width**2 * freed.covariance)

    def log_joint(self, node: Node, width: float = 1.0) -> float:
        """Log of prior times likelihood at a node, everything linear integrated out; `width` is that of `freed`."""
        freed = self.freed(node, width)
        found = freed.log_evidence + log_mass_apart(freed.mean, freed.covariance, self._one_sided)
        return self.log_prior - 0.5 * self.unkept + self.hyper.log_prior(node) + found

    def misfit(self, node: Node) -> float:
        """Least weighted sum of squares at a node, priors' penalty included."""
        return self.freed(node).misfit

    @cached_property
    def _steps(self) -> Steps:
        # A cycle of references would keep all columns until the garbage collector runs.
        fit = weakref.proxy(self)
        return Steps(lambda node: fit.log_joint(node))  # noqa: PLW0108 - a bound method would be that cycle

    @cached_property
    def mode(self) -> Node:
        """The node to which the one that it was fitted under leads upwards."""
        best = self._climbed_from([self.node])
        if self._hopeless(best):
            return self.hyper.plainly(best)
        if best[NOISE] != self.hyper.axes[NOISE].mode and best == self.hyper.without_smooth(best):
            # What is taken for noise may be something smooth.
            best = self._steps.best([best, self._climbed_from(self.hyper.with_one_family(best))])
        return self.hyper.plainly(best)

    def _hopeless(self, node: Node) -> bool:
        """Whether a node is so far below the leader that the sum over all nodes would not come near it."""
        return self._steps.at(node) < self.leader - FAR

    def _climbed_from(self, starts: Sequence[Node]) -> Node:
        """Where the best of some nodes leads upwards."""
        start = self._steps.best(starts)
        return self._steps.climbed(start, self.hyper.sizes(start))

    @cached_property
    def of_one(self) -> Node:
        """The mode, or a better node where what is smooth is of one tendon or of one rotation alone."""
        nodes = self.hyper.with_carriers(self.mode)
        if self._hopeless(self.mode) or max(map(self._steps.at, nodes)) < self._steps.at(self.mode) - WITHIN:
            return self.mode
        return self._steps.best([self.mode, self._climbed_from(nodes)])

    @cached_property
    def promise_of_one(self) -> float:
        """Log posterior that it promises there."""
        return self.log_posterior + self._steps.at(self.of_one) - self._steps.at(self.best)

    @cached_property
    def nodes(self) -> dict[Node, float]:
        """Log joint of the nodes that matter, with exact masses of cut priors, and their share of what lies beyond."""
        mode, hyper = self.mode, self.hyper
        carried = hyper.with_carriers(mode) if mode[CARRIER] else []
        starts = list(dict.fromkeys([mode, *hyper.returned(mode), *carried]))
        known = self._steps.known if self._hopeless(mode) else self._steps.explored(starts, hyper.neighbours)
        best = max(known, key=lambda n: known[n])
        # Together or one by one makes the same difference at every node, near enough.
        further, cut = 0.0, self._one_sided
        if cut.sum() > 1:
            freed = self.freed(best)
            further = log_mass(freed.mean, freed.covariance, cut) - log_mass_apart(freed.mean, freed.covariance, cut)
        further -= log_share(known)
        return {node: value + further for node, value in known.items()}

    @cached_property
    def plain_nodes(self) -> dict[Node, float]:
        """Log joint of the nodes that matter where nothing is smooth, from the one that it was fitted under."""
        start, hyper = self.hyper.without_smooth(self.node), self.hyper
        sizes = [1 if SMOOTH <= axis <= CARRIER else size for axis, size in enumerate(hyper.sizes(start))]
        start = self._steps.climbed(start, sizes)
        return self._steps.explored([start], lambda n: [m for m in hyper.neighbours(n) if not hyper.smooth_blocks(m)])

    @cached_property
    def best(self) -> Node:
        """The most probable node."""
        return max(self.nodes, key=lambda n: self.nodes[n])

    @cached_property
    def log_posterior(self) -> float:
        """Of the explanation, hyperparameters summed; without a constant that all explanations share."""
        return float(logsumexp(list(self.nodes.values())))

    def promises(self, explanations: Sequence[Explanation], nodes: Collection[Node]) -> Floats:
        """Log evidence that the session linearised here promises explanations (S,), by the best of some nodes.

        Errors of form are those found here where an explanation has all members of this one, in whichever form; else
        none.
        """
        own = set(self.explanation.names)
        keeps = np.array([own <= set(e.names) for e in explanations], dtype=bool)
        out = np.full(len(explanations), -np.inf)
        for node in nodes:
            for kept in (False, True):
                which = np.flatnonzero(keeps == kept)
                if len(which):
                    quadratic, index = self.effects_at(node, forms=kept)
                    position = {int(p): k for k, p in enumerate(index)}
                    sets = [tuple(position[i] for i in explanations[int(k)].parameters) for k in which]
                    one_sided = self.session.model.parameters.one_sided[index]
                    value = screened(quadratic, sets, self.x[index], one_sided) + self.hyper.log_prior(node)
                    out[which] = np.maximum(out[which], value - 0.5 * self.unkept)
        return out

    def everything(self, node: Node, explanation: Explanation | None = None) -> Everything:
        """All weights at a node, with an explanation's parameters and every other effect at its null.

        Args:
            node: of the hyperparameters.
            explanation: by default the one that was fitted, with its errors of form; without them for any other.
        """
        other = explanation is not None and explanation != self.explanation
        first = [n for n in self.acting(node) if not (other and n.startswith("form"))]
        names = [*first, OWN, *([OTHERS] if other else [])]
        quadratic = self.quadratic(names, node)
        place, widths = self.places(names), self.widths(names, node)
        indices = [(n, self.parameters_of.get(n, np.zeros(0, dtype=np.intp))) for n in names]
        parameter = np.concatenate([np.concatenate([i, np.full(self.size(n) - len(i), -1)]) for n, i in indices])
        if other and explanation is not None:
            effect = np.isin(parameter, np.concatenate([self.parameters_of[OWN], self.parameters_of[OTHERS]]))
            held = effect & ~np.isin(parameter, list(explanation.parameters))
            moved = np.flatnonzero(held & (place != 0.0))
            quadratic = quadratic.at(moved, -place[moved])
            widths[held] = 0.0
        kept = np.flatnonzero(widths > 0.0)
        freed = quadratic.freed(widths, place, len(kept))
        at = np.flatnonzero(parameter[kept] >= 0)
        return Everything(
            tuple(names), freed.mean, freed.covariance, place[kept], (parameter[kept[at]].astype(np.intp), at)
        )

    def expected(self, explanation: Explanation, node: Node) -> Floats:
        """(parameters,) where the session linearised here expects another explanation's optimum."""
        found, problem = self.everything(node, explanation), self.session.problem
        x = np.where(problem.free, self.x, 0.0)
        index, at = found.parameters
        x[index] = found.mean[at]
        own = np.array(explanation.parameters, dtype=np.intp)
        # Where an effect does not act, what tells its forms apart has no slope: a fit begun at its null stays there.
        flat = own[~self.slopes[:, own].any(axis=0)]
        x[flat] = np.where(self.x[flat] == 0.0, _AWAY, self.x[flat])
        # A straight line is not to be trusted further than the priors reach.
        theta: Floats = problem.centre + problem.scale * np.clip(x, -4.0, 4.0)
        return np.clip(theta, problem.lower, problem.upper)

    def parameter_posterior(self, node: Node) -> tuple[Floats, Floats, Ints]:
        """Mean (parameters,) in their units, covariance (k, k) in prior widths, and indices (k,) of what is free."""
        found, problem = self.everything(node), self.session.problem
        index, at = found.parameters
        theta = np.where(problem.free, self.theta, problem.centre)
        theta[index] = problem.centre[index] + problem.scale[index] * found.mean[at]
        theta = np.clip(theta, problem.lower, problem.upper)
        return theta, found.covariance[np.ix_(at, at)], index

    def log_joints_of(self, residuals: Floats, node: Node) -> Floats:
        """Log of prior times likelihood (k,) at a node that other readings would have here.

        Args:
            residuals: (fitted readings, k) these readings less the model [N, N mm].
            node: of the hyperparameters.
        """
        across, left = self.marginal(node)
        changed = self.whitening(node) @ (residuals - self.residual[:, None])
        turned = np.column_stack([left, left[:, None] + changed])
        misfit = (turned**2).sum(axis=0) - ((across @ turned) ** 2).sum(axis=0)
        return self.log_joint(node) - 0.5 * (misfit[1:] - misfit[0])

    def own_shares(self, changes: Iterable[Floats]) -> list[float]:
        """Share, 0 to 1, of each change (fitted readings, k), all columns together, that no anatomy or budget makes."""
        names = [name for name in self.acting(self.best) if name in (*ACTING, *GROUPS)]
        columns = self.whitened_at(names, self.best)[0] * self.widths(names, self.best)
        (across, _), out = absorbed_by(columns), list[float]()
        whitening = self.whitening(self.best)
        for change in changes:
            new = whitening @ change
            absorbed = across @ new
            # Of the whole the tares have taken their part already.
            own, whole = float((new**2).sum() - (absorbed**2).sum()), float((whitening.of_case(change) ** 2).sum())
            out.append(float(np.sqrt(max(own / whole, 0.0))) if whole > 0.0 else 0.0)
        return out

    @cached_property
    def own_newton(self) -> dict[str, float]:
        """Own size of each member [N]: less what a bent finger or rig undoes of it."""
        rows = self.session.rows[self.session.fitted]
        shares = self.own_shares(change.reshape(-1)[rows, None] for change in self.changes)
        return {n: self.sizes_newton[n] * s for n, s in zip(self.explanation.names, shares, strict=True)}

    def own_smooth_newton(self, node: Node) -> float:
        """Own size of what is smooth at a node [N]."""
        blocks = self.hyper.smooth_blocks(node)
        if new := sorted(blocks.keys() - self._shares.keys()):
            shares = self.own_shares(self.block(name, self.session.fitted, self.slopes) for name in new)
            self._shares.update(zip(new, shares, strict=True))
        return max((size * self._shares[name] for name, size in blocks.items()), default=0.0)

    def named(self, node: Node) -> tuple[frozenset[str], float]:
        """Which members act by their name at a node, and how large what no name describes is [N].

        Held against each other is the own part of both: an effect may be large because a bent finger undoes nearly all
        of it.
        """
        # Scatter, noise and widths change the size of nothing.
        key = node[SMOOTH:]
        if key not in self._named:
            self._named[key] = self._names_at(node)
        return self._named[key]

    def off_in_form(self, node: Node) -> dict[Member, float]:
        """Error of each member's form at a node, relative; 0 of one whose form is exact."""
        errors = iter(node[FORMS:])
        return {
            m: self.hyper.form.value[next(errors)] if m.candidate.has_form else 0.0 for m in self.explanation.members
        }

    def _names_at(self, node: Node) -> tuple[frozenset[str], float]:
        sizes, own = self.sizes_newton, self.own_newton
        unknown, right = [(self.hyper.smooth_newton(node), self.own_smooth_newton(node))], list[str]()
        for member, error in self.off_in_form(node).items():
            name = member.candidate.name
            if member.candidate.outside:
                unknown.append((sizes[name], own[name]))
            elif error > FORM_NAMED:
                unknown.append((error * sizes[name], error * own[name]))
            else:
                right.append(name)
        beyond, largest = (max(each) for each in zip(*unknown, strict=True))
        # With something unknown, a bent finger and a form as wrong as a name allows might make all of an effect.
        least = {name: max(largest, FORM_NAMED * sizes[name] if largest > 0.0 else 0.0) for name in right}
        return frozenset(name for name in right if own[name] > least[name]), beyond
