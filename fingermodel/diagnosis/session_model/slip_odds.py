"""How well slips explain the readings of bad cases, against readings that may be anything."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.special import expit

from fingermodel.arrays import Floats
from fingermodel.diagnosis.session_model.bad_cases import LOG_PRIOR_ODDS, P_TAIL, Apart
from fingermodel.diagnosis.session_model.reading_changes import ReadingChanges
from fingermodel.diagnosis.session_model.slips import Slip
from fingermodel.diagnosis.settings import AMOUNT, FORM, SLIP_SHARES


@dataclass(frozen=True)
class Explained:
    """How probable each slip is, given that the case is bad."""

    gain: float  # log evidence gained over a bad case of which nothing is known
    is_slip: float  # probability that the case stands apart by a slip, and not by the tail of the noise
    # With their probability and chi-square, the most probable first; one whose `kind` is amount among them.
    slips: tuple[tuple[Slip, float, float], ...]

    @property
    def partner(self) -> int | None:
        """The case that this one is more probably exchanged with than not."""
        total: dict[int, float] = {}
        for slip, probability, _ in self.slips:
            if slip.partner is not None:
                total[slip.partner] = total.get(slip.partner, 0.0) + probability
        return next((case for case, probability in total.items() if probability >= 0.5), None)


@dataclass(frozen=True, eq=False)
class SlipsAbout:
    """Slips whose readings are predicted about one parameter vector; each is predicted once, when it is asked for."""

    changes: ReadingChanges  # of a session's readings
    theta: Floats  # (parameters,)
    _known: dict[Slip, Floats] = field(default_factory=dict, repr=False)

    def explain(self, apart: Mapping[int, Apart], scatter: float) -> dict[int, Explained]:
        """Weigh every slip of some cases against a reading that may be anything.

        Args:
            apart: the cases, by index; a case may be exchanged with any of these only.
            scatter: of the tensions from case to case, relative.
        """
        if not apart:
            return {}
        pairs = [
            (case, slip)
            for case in apart
            for slip in self.changes.slips.of(case)
            if slip.partner is None or slip.partner in apart
        ]
        changes, owners = self._changes(pairs), np.array([case for case, _ in pairs], dtype=np.intp)
        gains, misfits = np.empty(len(pairs)), np.empty(len(pairs))
        for case, one in apart.items():
            own = owners == case
            gains[own], misfits[own], _ = _gains(one, changes[own][:, one.rows], scatter)
        weighed = list(zip(pairs, gains.tolist(), misfits.tolist(), strict=True))
        found: dict[int, list[tuple[Slip, float, float]]] = {case: [] for case in apart}
        for (case, slip), gain, chi in weighed:
            if slip.partner is None:
                found[case].append((slip, float(np.log(slip.share)) + gain, chi))
        for case in apart:
            found[case] += self._amounts(apart[case], scatter)
        # Whatever else may have happened to a case, by itself: of two that are exchanged this is no longer to be paid.
        alone = {
            case: float(np.logaddexp(0.0, LOG_PRIOR_ODDS + _all_together(apart[case], slips)))
            for case, slips in found.items()
        }
        swapped = {(case, s.partner, s.like == case): g for (case, s), g, _ in weighed if s.partner is not None}
        for (case, slip), gain, chi in weighed:
            if slip.partner is not None:
                both = gain + swapped[slip.partner, case, slip.like == case] - alone[slip.partner]
                found[case].append((slip, float(np.log(slip.share)) + both, chi))
        return {case: _weighed(apart[case], slips) for case, slips in found.items()}

    def _changes(self, pairs: Sequence[tuple[int, Slip]]) -> Floats:
        """(k, 6) reading under each slip less that under the entry [N, N mm]."""
        new = [(case, slip) for case, slip in pairs if slip not in self._known]
        self._known.update(zip((slip for _, slip in new), self.changes.slips.changes(new, self.theta), strict=True))
        return np.array([self._known[slip] for _, slip in pairs]).reshape(-1, 6)

    @cached_property
    def _along(self) -> Floats:
        """(cases, 6, muscles) change of every reading by the logarithm of each tension."""
        return self.changes.by_tension(self.theta)

    def _amounts(self, apart: Apart, scatter: float) -> Iterator[tuple[Slip, float, float]]:
        """Another load on a tendon that was loaded, whatever it was: a weight that slipped, stuck or was another."""
        o, case = self.changes.observations, apart.case
        muscles, tension = self.changes.model.finger.topology.muscles, np.asarray(o.inputs.tension)[case]
        loaded = {m: g for m, g in o.masses_g[case].items() if g > 0.0}
        for muscle, grams in loaded.items():
            column = self._along[case][apart.rows, muscles.index(muscle)]
            solved = np.linalg.solve(apart.covariance, column)
            amount = float(solved @ apart.away) / (float(column @ solved) + AMOUNT**-2)
            if amount <= -1.0 or not column.any():
                continue
            found, (chi,), (grown,) = _gains(apart, amount * column[None, :], scatter)
            # What is lost by not having said beforehand how much it would be.
            spread = max(float(column @ np.linalg.solve(grown, column)), 0.0) * AMOUNT**2
            gain = float(found[0]) - 0.5 * (amount / AMOUNT) ** 2 - 0.5 * float(np.log1p(spread))
            value = float(f"{grams * (1.0 + amount):.2g}")
            words = f"{muscle} bore about {value:g} g, not {grams:g} g"
            share = SLIP_SHARES["amount"] / len(loaded)
            slip = Slip("amount", words, {**loaded, muscle: value}, o.postures[case], tension, case, share=share)
            yield slip, float(np.log(share)) + gain, float(chi)


def _gains(apart: Apart, changes: Floats, scatter: float) -> tuple[Floats, Floats, Floats]:
    """Log evidence (k,) gained by changes (k, L) of the prediction, chi-squares (k,) left, and covariances (k, L, L).

    The prediction of another load is as uncertain as the form of an effect, and scatters as the loads do.
    """
    moment = apart.rows >= 3
    sizes = np.where(
        moment, (changes[:, moment] ** 2).sum(axis=1)[:, None], (changes[:, ~moment] ** 2).sum(axis=1)[:, None]
    )
    grown = apart.covariance + (scatter**2 + FORM.scale**2) * sizes[:, :, None] * np.eye(len(moment))
    left = apart.away - changes
    after = (left * np.linalg.solve(grown, left[..., None])[..., 0]).sum(axis=1)
    determinants = np.linalg.slogdet(apart.covariance)[1] - np.linalg.slogdet(grown)[1]
    return 0.5 * (apart.misfit - after + determinants), after, grown


def _all_together(apart: Apart, slips: Sequence[tuple[Slip, float, float]]) -> float:
    """Log evidence gained over a sound case by a bad one, whatever has happened to it."""
    logs = [float(np.log(SLIP_SHARES["anything"])) + apart.anything, *(log for _, log, _ in slips)]
    return float(np.logaddexp.reduce(logs))


def _weighed(apart: Apart, slips: Sequence[tuple[Slip, float, float]]) -> Explained:
    total = _all_together(apart, slips)
    order = sorted(((s, float(np.exp(log - total)), chi) for s, log, chi in slips), key=lambda e: -e[1])
    is_slip = float(expit(LOG_PRIOR_ODDS + total - np.log(P_TAIL) - apart.tail))
    return Explained(total - apart.anything, is_slip, tuple(order))
