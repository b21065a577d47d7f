"""What of an explanation's changes neither anatomy nor budget could make, and which of its members have their name."""

from __future__ import annotations

import weakref
from collections.abc import Iterable
from functools import cached_property

import numpy as np
from scipy.linalg import solve_triangular

from fingermodel.arrays import Floats
from fingermodel.diagnosis.posterior.hyper import ACTING, FORMS, GROUPS, SMOOTH, Node
from fingermodel.diagnosis.posterior.linearised import Linearised
from fingermodel.diagnosis.settings import FORM_NAMED
from fingermodel.fitting.roots import root_of_one_plus


class OwnPart:
    """Sizes of all that acts, less what a bent finger or rig undoes of it.

    Args:
        fit: a linearised session.
        node: of the hyperparameters, under which readings are weighed.
    """

    def __init__(self, fit: Linearised, node: Node) -> None:
        # The fit refers to this. A cycle of references would keep its arrays until the garbage collector runs.
        self._fit: Linearised = weakref.proxy(fit)
        self._node = node
        self._shares: dict[str, float] = {}
        self._named: dict[Node, tuple[frozenset[str], float]] = {}

    def shares(self, changes: Iterable[Floats]) -> list[float]:
        """How much of each of some changes neither anatomy nor budget could make: shares between 0 and 1.

        Args:
            changes: (fitted readings, k) each; of several columns they are those of all together.
        """
        fit = self._fit
        names = [name for name in fit.acting(self._node) if name in (*ACTING, *GROUPS)]
        columns = fit.whitened_at(names, self._node)[0] * fit.widths(names, self._node)
        root, out = root_of_one_plus(columns.T @ columns), list[float]()
        whitening = fit.whitening(self._node)
        for change in changes:
            new = whitening @ change
            absorbed = solve_triangular(root, columns.T @ new, lower=True, check_finite=False)
            # Of the whole the tares have taken their part already.
            own, whole = float((new**2).sum() - (absorbed**2).sum()), float((whitening.of_case(change) ** 2).sum())
            out.append(float(np.sqrt(max(own / whole, 0.0))) if whole > 0.0 else 0.0)
        return out

    @cached_property
    def newton(self) -> dict[str, float]:
        """Own size of each member [N]."""
        fit = self._fit
        rows = fit.session.rows[fit.session.fitted]
        shares = self.shares(change.reshape(-1)[rows, None] for change in fit.changes)
        return {n: fit.sizes_newton[n] * s for n, s in zip(fit.explanation.names, shares, strict=True)}

    def smooth_newton(self, node: Node) -> float:
        """Own size of what is smooth at a node [N]."""
        fit = self._fit
        blocks = fit.hyper.smooth_blocks(node)
        if new := sorted(blocks.keys() - self._shares.keys()):
            shares = self.shares(fit.block(name, fit.session.fitted, fit.slopes) for name in new)
            self._shares |= dict(zip(new, shares, strict=True))
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

    def _names_at(self, node: Node) -> tuple[frozenset[str], float]:
        fit, sizes, own = self._fit, self._fit.sizes_newton, self.newton
        unknown, right = [(fit.hyper.smooth_newton(node), self.smooth_newton(node))], list[str]()
        errors = iter(node[FORMS:])
        for member in fit.explanation.members:
            name = member.candidate.name
            error = fit.hyper.form.value[next(errors)] if member.candidate.has_form else 0.0
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
