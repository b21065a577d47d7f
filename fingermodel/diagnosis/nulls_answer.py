"""What a test that needs no model found: its verdict, and the words and figures of its sentence."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from fingermodel.diagnosis.nulls_budget import Readings, Residuals, Test

Floats = NDArray[np.float64]
Verdict = Literal["holds", "violated", "not_tested"]

VIOLATED_BELOW = 1e-3


@dataclass(frozen=True)
class Null:
    """One test that needs no model of the tendons.

    Attributes:
        name: balance, fds_no_dip_torque, superposition, load_levels, repeats or moments_closure.
        verdict: violated where the p-value is below 0.001.
        text: what was found, in one sentence.
        statistic: chi-square of the most telling of its parts.
        p_value: of the whole test.
        cases: ids that it used.
    """

    name: str
    verdict: Verdict
    text: str
    statistic: float | None
    p_value: float | None
    cases: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """Return the answer's object."""
        return asdict(self) | {"cases": list(self.cases)}


def not_tested(name: str, reason: str) -> Null:
    """The answer where the session's load cases do not allow the test."""
    return Null(name, "not_tested", reason, None, None, ())


def concluded(r: Readings, name: str, parts: Sequence[Test], holds: str, violated: str, cases: Iterable[int]) -> Null:
    """The answer from a test's parts: Bonferroni's p-value, and the sentence that goes with it.

    Args:
        r: the session.
        name: of the test.
        parts: that were tried.
        holds: what to say where nothing stands out.
        violated: what to say where something does.
        cases: that were used.
    """
    telling = min(parts, key=lambda t: t.p_value)
    p = min(1.0, telling.p_value * len(parts))
    bad = p < VIOLATED_BELOW
    text = violated if bad else holds
    if r.observations.noise_assumed:
        text = f"{text.removesuffix('.')}; the noise is assumed, not stated."
    return Null(name, "violated" if bad else "holds", text, telling.statistic, p, r.ids(cases))


def worst(r: Readings, residual: Residuals, cases: Sequence[int], *, mount: bool = True) -> str:
    """The case whose force stands out most: `FDP 950 g in hook at the tip (0.31 N)`."""
    k, size = residual.worst()
    return f"{r.name(cases[k], mount=mount)} ({figure(size)} N)"


def figure(value: float) -> str:
    """A number in two significant digits, with a proper minus sign and no exponent."""
    if value == 0.0 or not np.isfinite(value):
        return "0"
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
