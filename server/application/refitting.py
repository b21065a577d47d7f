"""A refit with the comparison before and after, and the answer that tells of it."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from fingermodel.api import refit
from fingermodel.comparing import compare
from fingermodel.comparison.comparison import Comparison
from fingermodel.session import Progress, Session
from server.application.fitted_mounts import fitted_mounts

if TYPE_CHECKING:
    from fingermodel.fitting.fit_report import Fit


def refit_compared(
    bench: Session, method: str = "map", plane: str | None = None, tell: Progress | None = None
) -> tuple[Comparison, Fit, Comparison]:
    """Refit a bench's model, with the comparison before and after of the cases that count."""
    fit = refit(bench, method, plane=plane, progress=tell)  # type: ignore[arg-type]  # refused by its value
    before, after = (compare(b).without(fit.errors.not_counted) for b in (bench, bench.at(fit)))
    return before, fit, after


def fit_body(bench: Session, fit: Fit, before: Comparison, after: Comparison) -> dict[str, Any]:
    """Return the contract's refit answer, without the model's path."""
    return {
        "method": fit.method,
        "outcome": fit.outcome,
        "message": fit.message,
        "objective": fit.objective,
        "objective_before": fit.objective_before,
        "residuals": fit.residuals,
        "reading_errors": asdict(fit.errors),
        "evaluations": fit.evaluations,
        "seconds": fit.seconds,
        "before": before.summary(),
        "after": after.summary(),
        "parameters": [asdict(p) for p in fit.parameters],
        "mounts": {
            location: mount.model_dump(exclude_none=True)
            for location, mount in fitted_mounts(bench, {p.name: p.value for p in fit.parameters}).items()
        },
        "optima": [{"objective": objective, "probability": share} for objective, share in fit.optima],
        "correlated": [{"a": a, "b": b, "r": r} for a, b, r in fit.correlated],
    }
