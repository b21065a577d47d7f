"""Bad cases: how often a case is one, how far its reading may then be off, and what taking it for one gains."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import betainc

from fingermodel.arrays import Floats, Ints, Mask
from fingermodel.diagnosis.settings import LEVER_MM, P_BAD

# How far the force of a bad case may be off [N].
BAD_N = 1.5
# Noise has a long tail: so many cases are off by some hundredths of a newton, and nobody made a slip [N].
P_TAIL, _TAIL_N = 0.02, 0.05
# No lever in a finger is longer [mm].
_LONGEST_MM = 10.0 * LEVER_MM
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
    read = np.where(np.abs(reading) > most * np.where(moment, _LONGEST_MM, 1.0), np.abs(reading), 0.0)
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
