"""From residuals that should vanish to an answer: chi-square, verdict, and the figures of its sentence."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from scipy.linalg import cho_solve
from scipy.special import chdtrc

from fingermodel.arrays import Floats, Mask
from fingermodel.comparison.observations import Observations
from fingermodel.fitting.roots import root_of

Verdict = Literal["holds", "violated", "not_tested"]


VIOLATED_BELOW = 1e-3
# Where no reading states its noise, its size is log-normal by this factor: multiples of its variance, with weights.
_NOISE_FACTOR = 2.0
_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(21)
_SIZES, _SHARES = _NOISE_FACTOR ** (2.0 * _NODES), _WEIGHTS / _WEIGHTS.sum()


@dataclass(frozen=True)
class Test:
    """One chi-square test."""

    what: str  # was tested
    statistic: float  # chi-square
    freedom: int  # its degrees of freedom
    p_value: float  # of it; where the noise is assumed, averaged over its size


@dataclass(frozen=True)
class Estimate:
    """What a pattern contributes to some residuals."""

    test: Test  # of whether it is zero
    value: Floats  # (patterns,) best estimate
    sd: Floats  # (patterns,) of it
    share: float  # of the residuals' chi-square that the patterns take up


@dataclass(frozen=True, eq=False)
class Residuals:
    """What should vanish."""

    value: Floats  # (k,) [N or N mm]
    covariance: Floats  # (k, k) by noise and budget
    noise: Floats  # (k, k) by noise alone
    noise_assumed: bool  # whether the readings state no uncertainty

    @cached_property
    def _factor(self) -> Floats:
        return root_of(self.covariance)

    @cached_property
    def _solved(self) -> Floats:
        return cho_solve((self._factor, True), self.value)

    @property
    def chi2(self) -> float:
        """Chi-square of all of them."""
        return float(self.value @ self._solved)

    def worst(self, width: int = 3) -> tuple[int, float]:
        """Which `width` of them in a row stand out most from their uncertainty, and how large these are."""
        value = self.value.reshape(-1, width)
        at = np.arange(len(self.value)).reshape(-1, width)
        blocks = self.covariance[at[:, :, None], at[:, None, :]]
        z2 = np.einsum("ka,ka->k", value, np.linalg.solve(blocks, value[:, :, None])[..., 0])
        k = int(np.argmax(z2))
        return k, float(np.linalg.norm(value[k]))

    @property
    def rms(self) -> float:
        """Root of their mean square."""
        return float(np.sqrt(np.mean(self.value**2)))

    @property
    def unexplained(self) -> Floats:
        """(k,) what the most probable budget errors leave of them."""
        return self.noise @ self._solved

    def all(self, what: str) -> Test:
        """Test whether they vanish together."""
        return self._test(what, self.chi2, len(self.value))

    def part(self, what: str, rows: Mask) -> Test:
        """Test whether some of them vanish."""
        value, covariance = self.value[rows], self.covariance[np.ix_(rows, rows)]
        return self._test(what, float(value @ np.linalg.solve(covariance, value)), int(rows.sum()))

    def along(self, what: str, patterns: Floats) -> Estimate:
        """Test whether they contain some patterns (k, patterns)."""
        solved = cho_solve((self._factor, True), patterns)
        information, score = patterns.T @ solved, patterns.T @ self._solved
        covariance = np.linalg.pinv(information, hermitian=True)
        value = covariance @ score
        statistic = float(score @ value)
        test = self._test(what, statistic, int(np.linalg.matrix_rank(information, hermitian=True)))
        sd = self._widened * np.sqrt(np.diag(covariance))
        return Estimate(test, value, sd, statistic / max(self.chi2, 1e-300))

    def factor(self, pattern: Floats) -> tuple[float, float]:
        """How much of a pattern (k,) they contain, and its standard deviation.

        By least squares with the noise alone. Errors in proportion to the readings would make the smaller ones seem the
        surer, and the factor too small (Peelle's puzzle); they count in its standard deviation.
        """
        by_noise = cho_solve((root_of(self.noise), True), pattern)
        weight = by_noise / float(pattern @ by_noise)
        return float(weight @ self.value), self._widened * float(np.sqrt(weight @ self.covariance @ weight))

    @property
    def _widened(self) -> float:
        """By how much noise of unknown size widens a standard deviation."""
        return float(np.sqrt(_SIZES @ _SHARES)) if self.noise_assumed else 1.0

    def _test(self, what: str, statistic: float, freedom: int) -> Test:
        if freedom == 0:
            # A pattern that the loads do not show at all.
            return Test(what, 0.0, 0, 1.0)
        if self.noise_assumed:
            p = float(chdtrc(freedom, statistic / _SIZES) @ _SHARES)
        else:
            p = float(chdtrc(freedom, statistic))
        return Test(what, statistic, freedom, p)


@dataclass(frozen=True)
class Null:
    """One test that needs no model of the tendons."""

    name: str  # balance, fds_no_dip_torque, superposition, load_levels, repeats or moments_closure
    verdict: Verdict  # violated where the p-value is below 0.001
    text: str  # what was found, in one sentence
    statistic: float | None  # chi-square of the most telling of its parts
    p_value: float | None  # of the whole test
    cases: tuple[str, ...]  # ids that it used

    def as_dict(self) -> dict[str, Any]:
        """Return the answer's object."""
        return asdict(self) | {"cases": list(self.cases)}


def not_tested(name: str, reason: str) -> Null:
    """The answer where the session's load cases do not allow the test."""
    return Null(name, "not_tested", reason, None, None, ())


def concluded(
    observations: Observations, name: str, parts: Sequence[Test], holds: str, violated: str, cases: Iterable[int]
) -> Null:
    """The answer from a test's parts: Bonferroni's p-value, and the sentence that goes with it.

    Args:
        observations: of the session.
        name: of the test.
        parts: that were tried.
        holds: what to say where nothing stands out.
        violated: what to say where something does.
        cases: indices of those that were used.
    """
    telling = min(parts, key=lambda t: t.p_value)
    p = min(1.0, telling.p_value * len(parts))
    bad = p < VIOLATED_BELOW
    text = violated if bad else holds
    if observations.noise_assumed:
        text = f"{text.removesuffix('.')}; the noise is assumed, not stated."
    ids = tuple(observations.ids[i] for i in sorted(set(cases)))
    return Null(name, "violated" if bad else "holds", text, telling.statistic, p, ids)


def figure(value: float) -> str:
    """A number in two significant digits, with a proper minus sign and no exponent."""
    if abs(value) < 5e-5:
        return "0"
    value = float(f"{value:.1e}")
    decimals = max(0, 1 - int(np.floor(np.log10(abs(value)))))
    return f"{value:z.{min(decimals, 4)}f}".replace("-", "\N{MINUS SIGN}")


def pm(value: float, sd: float, decimals: int = 1) -> str:
    """A number with its standard uncertainty: `−0.3 ± 0.2`."""
    return f"{value:z.{decimals}f} ± {sd:.{decimals}f}".replace("-", "\N{MINUS SIGN}")


def vector(value: Floats) -> str:
    """A vector in two decimals: `(0.35, −0.10, 0.42)`."""
    return f"({', '.join(f'{x:z.2f}' for x in value)})".replace("-", "\N{MINUS SIGN}")


def count(n: int, one: str, many: str | None = None) -> str:
    """How many of something: `1 case`, `3 cases`."""
    return f"{n} {one if n == 1 else many or one + 's'}"
