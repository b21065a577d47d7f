"""Where a search begins: the base model and all candidates at once, fitted beside the cases taken for bad."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fingermodel.arrays import Floats
from fingermodel.diagnosis.posterior.fitting import Fitter
from fingermodel.diagnosis.posterior.hyper import Hyperparameters, Node
from fingermodel.diagnosis.posterior.optimum import Optimum
from fingermodel.diagnosis.session_model.candidates import NOTHING, Candidate, Candidates, Explanation, Member
from fingermodel.diagnosis.session_model.session import Session

# One slip after another: the case that is bad, or the two that were exchanged.
Slipped = tuple[frozenset[int], ...]

# Share of the work that is left by every fit, as far as anybody knows: most searches take some 14.
_LEFT_PER_FIT = 0.87


def bad_in(slips: Slipped) -> frozenset[int]:
    """Cases that are bad by some slips."""
    return frozenset().union(*slips)


@dataclass(frozen=True, eq=False)
class Beginning:
    """Two fits beside some cases that are taken for bad."""

    slips: Slipped  # one after another: the case that is bad, or the two that were exchanged
    fitter: Fitter  # for further fits; scatter changes a reading as it does the finger that all candidates fit
    every: Optimum  # all candidates at once
    nothing: Optimum  # the base model
    beginner: Beginner  # that made it, and counts fits

    @property
    def bad(self) -> frozenset[int]:
        """Cases that are taken for bad."""
        return bad_in(self.slips)

    @property
    def plain(self) -> Node:
        """Where a refit counts: scatter and noise as the readings have them with all candidates free."""
        return self.fitter.hyper.as_stated(self.every.best)


class Beginner:
    """Makes beginnings of one session.

    Args:
        session: to search.
        candidates: that may act.
        start: (parameters,) of an earlier fit of the base model, tried besides the priors' centre.
        progress: is told the share done.

    Attributes:
        made: fits so far.
    """

    def __init__(
        self,
        session: Session,
        candidates: Candidates,
        start: Floats | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> None:
        self.session, self.hyper = session, Hyperparameters.of(session)
        self._candidates, self._start, self._progress, self.made = candidates, start, progress, 0
        self._about_centre = Fitter(session, candidates, self.hyper)

    def count_fit(self) -> None:
        """Count one more fit."""
        self.made += 1
        if self._progress:
            self._progress(1.0 - _LEFT_PER_FIT**self.made)

    @cached_property
    def _every(self) -> Explanation:
        parameters = sorted({i for c in self._candidates.all for form in c.forms for i in form})
        all_of_them = Candidate("all candidates", "", (tuple(parameters),), 1.0)
        return Explanation((Member(all_of_them),))

    def unfitted(self, node: Node) -> Optimum:
        """The session linearised about the priors' centre, with all candidates free at a node."""
        return self._about_centre.linearised(self._every, self.session.problem.centre, node, frozenset(), 0.0)

    def beside(self, slips: Slipped) -> Beginning:
        """Fit all candidates at once, and the base model from there and from the priors' centre."""
        problem, explanation = self.session.problem, self._every
        node, bad = self.hyper.usual, bad_in(slips)
        fitter, begin = self._about_centre.begun(explanation, node, bad)
        every = fitter.fit(explanation, begin, node, bad, 0.0)
        starts = [problem.centre, np.where(problem.free, every.theta, problem.centre)]
        found = []
        for start in [*starts, *([] if self._start is None else [self._start])]:
            found.append(fitter.fit(NOTHING, start, every.mode, bad))
            self.count_fit()
        base = max(found, key=lambda fit: fit.log_posterior)
        if every.misfit(base.best) + every.unkept > base.misfit(base.best) + base.unkept:
            # With more free it fits no worse: the solver went astray.
            again = fitter.fit(explanation, base.theta, base.best, bad, 0.0)
            every = max(every, again, key=lambda fit: fit.log_posterior)
        return Beginning(slips, fitter, every, base, self)
