"""Bad cases: how often a case is one, how far its reading may then be off, and what taking it for one gains.

Slips explain such a reading, against one that may be anything.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.special import betainc, expit

from fingermodel.arrays import Floats, Ints, Mask
from fingermodel.diagnosis.session_model.reading_changes import ReadingChanges
from fingermodel.diagnosis.session_model.slips import LONGEST_MM, Slip
from fingermodel.diagnosis.settings import AMOUNT, FORM, LEVER_MM, P_BAD, SLIP_SHARES

# How far the force of a bad case may be off [N].
BAD_N = 1.5
# Noise has a long tail: so many cases are off by some hundredths of a newton, and nobody made a slip [N].
_P_TAIL, _TAIL_N = 0.02, 0.05
# Log odds of a case to be bad, before its reading.
LOG_PRIOR_ODDS = float(np.log(P_BAD / (1.0 - P_BAD)))


def bad_size(moment: Mask, reading: Floats, pulled_N: Floats, usual_N: float) -> Floats:
    """How far each reading of a bad case may be off [N, N mm].

    What reads more than any usual load can make may be off by as much as it reads. What was entered to pull more than
    that may be off by as much as it was entered to pull: a zero too many.

    Args:
        moment: (n,) whether the reading is a moment.
        reading: (n,) [N, N mm].
        pulled_N: (n,) sum of the tensions of its case, as entered.
        usual_N: such a sum of the session's heavy cases.
    """
    # Tip and bone together carry what is pulled, and neither more than twice that.
    most, lever = 2.0 * usual_N, np.where(moment, LEVER_MM, 1.0)
    read = np.where(np.abs(reading) > most * np.where(moment, LONGEST_MM, 1.0), np.abs(reading), 0.0)
    entered = np.where(pulled_N > most, pulled_N * lever, 0.0)
    return np.maximum(np.maximum(read, entered), BAD_N * lever)


@dataclass(frozen=True, eq=False)
class Apart:
    """One case's readings against what the rest of the session predicts of them."""

    case: int  # its index
    rows: Ints  # (L,) components of the wrench, 0 to 5
    away: Floats  # (L,) reading less prediction [N, N mm]
    covariance: Floats  # (L, L) of it, the case taken for a sound one
    anything: float  # log evidence gained by a reading that may be anything
    tail: float  # the same by one that noise may have put some hundredths of a newton off

    @classmethod
    def of(cls, case: int, rows: Ints, size: Floats, precision: Floats, score: Floats, bad: bool) -> Apart:
        """From the readings' block of the session's precision.

        Args:
            case: its index.
            rows: (L,) components of the wrench, 0 to 5.
            size: (L,) how far each may be off in a bad case [N, N mm].
            precision: (L, L) block of the inverse covariance of all readings.
            score: (L,) of the precision times what all readings are away from their prediction.
            bad: whether that covariance lets the case be anything already.
        """
        covariance = np.asarray(np.linalg.inv(precision), dtype=np.float64)
        away = covariance @ score
        if bad:
            values, vectors = np.linalg.eigh(covariance - np.diag(size**2))
            covariance = np.asarray((vectors * np.maximum(values, 1e-6)) @ vectors.T, dtype=np.float64)
            precision = np.asarray(np.linalg.inv(covariance), dtype=np.float64)
        tail = _TAIL_N * np.where(rows < 3, 1.0, LEVER_MM)
        gains = [float(gain_if_bad(off[:, None] * precision * off, off * (precision @ away))) for off in (size, tail)]
        return cls(case, rows, away, covariance, *gains)

    @cached_property
    def misfit(self) -> float:
        """Chi-square of the readings."""
        return float(self.away @ np.linalg.solve(self.covariance, self.away))


def gain_if_bad(information: Floats, score: Floats) -> Floats:
    """Log evidence (…) gained by letting readings be off, by N(0, 1) weights of information (…, L, L), score (…, L)."""
    inner = information + np.eye(information.shape[-1])
    solved = np.linalg.solve(inner, score[..., None])[..., 0]
    return 0.5 * (score * solved).sum(axis=-1) - 0.5 * np.linalg.slogdet(inner)[1]


def chance_of(bad: Ints | int, cases: int) -> Floats:
    """Probability that so many cases or more of all are bad."""
    # The binomial's tail; `scipy.stats`, which has it by name, takes half a second to import.
    least = np.clip(bad, 1, None)
    return np.where(np.asarray(bad) < 1, 1.0, betainc(least, np.maximum(cases - least + 1.0, 1e-300), P_BAD))


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
            open_Nmm = np.array([slip.open_Nmm for of, slip in pairs if of == case])
            gains[own], misfits[own], _ = _gains(one, changes[own][:, one.rows], scatter, open_Nmm)
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
            found, (chi,), (grown,) = _gains(apart, amount * column[None, :], scatter, np.zeros(1))
            # What is lost by not having said beforehand how much it would be.
            spread = max(float(column @ np.linalg.solve(grown, column)), 0.0) * AMOUNT**2
            gain = float(found[0]) - 0.5 * (amount / AMOUNT) ** 2 - 0.5 * float(np.log1p(spread))
            value = float(f"{grams * (1.0 + amount):.2g}")
            words = f"{muscle} bore about {value:g} g, not {grams:g} g"
            share = SLIP_SHARES["amount"] / len(loaded)
            slip = Slip("amount", words, {**loaded, muscle: value}, o.postures[case], tension, case, share=share)
            yield slip, float(np.log(share)) + gain, float(chi)


def _gains(apart: Apart, changes: Floats, scatter: float, open_Nmm: Floats) -> tuple[Floats, Floats, Floats]:
    """Log evidence (k,) gained by changes (k, L) of the prediction, chi-squares (k,) left, and covariances (k, L, L).

    The prediction of another load is as uncertain as the form of an effect, and scatters as the loads do. Moments may
    be anything up to some size (k,).
    """
    moment = apart.rows >= 3
    sizes = np.where(
        moment, (changes[:, moment] ** 2).sum(axis=1)[:, None], (changes[:, ~moment] ** 2).sum(axis=1)[:, None]
    )
    variance = (scatter**2 + FORM.scale**2) * sizes + moment * open_Nmm[:, None] ** 2
    grown = apart.covariance + variance[:, :, None] * np.eye(len(moment))
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
    is_slip = float(expit(LOG_PRIOR_ODDS + total - np.log(_P_TAIL) - apart.tail))
    return Explained(total - apart.anything, is_slip, tuple(order))
