"""A refit with the comparison before and after, and the answer that tells of it."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from fingermodel.comparison.comparison import Comparison, compare
from server.application.workflow import Bench, Progress, compare_bench, refit_bench

if TYPE_CHECKING:
    from fingermodel.fitting.fit_report import Fit


def refit_compared(
    bench: Bench, method: str = "map", plane: str | None = None, tell: Progress | None = None
) -> tuple[Comparison, Fit, Comparison]:
    """Refit a bench's model, with the comparison before and after."""
    before = compare_bench(bench)
    fit = refit_bench(bench, method, plane, progress=tell)
    return before, fit, compare(bench.model, bench.observations, fit.theta)


def fit_body(fit: Fit, before: Comparison, after: Comparison) -> dict[str, Any]:
    """Return the contract's refit answer, without the model's path."""
    return {
        "method": fit.method,
        "outcome": fit.outcome,
        "message": fit.message,
        "objective": fit.objective,
        "objective_before": fit.objective_before,
        "residuals": fit.residuals,
        "evaluations": fit.evaluations,
        "seconds": fit.seconds,
        "before": before.summary(),
        "after": after.summary(),
        "parameters": [asdict(p) for p in fit.parameters],
        "optima": [{"objective": objective, "probability": share} for objective, share in fit.optima],
        "correlated": [{"a": a, "b": b, "r": r} for a, b, r in fit.correlated],
    }
