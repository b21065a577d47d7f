"""Blinding while a bench is running: no prediction of a validation case is shown."""

from __future__ import annotations

from fingermodel.comparison.comparison import Comparison
from server.service.sessions.measuring import Measured
from server.service.web.problems import ProblemError

HIDDEN = "The prediction is hidden until the session is closed."


def blinded(measured: Measured) -> frozenset[str]:
    """Return ids of the cases of a session whose predictions may not be seen yet."""
    if measured.record.closed:
        return frozenset()
    return frozenset(str(c["id"]) for c in measured.record.cases if c.get("role") == "validation")


def seen(measured: Measured, comparison: Comparison) -> Comparison:
    """Return a comparison without the cases that may not be seen yet."""
    if measured.record.closed:
        return comparison
    return Comparison(tuple(c for c in comparison.cases if c.role != "validation"), comparison.noise_assumed)


def require_closed(measured: Measured) -> None:
    """Refuse what would tell of validation cases.

    Raises:
        ProblemError: 409 the session's bench is still running.
    """
    if not measured.record.closed:
        raise ProblemError(
            409,
            f"session {measured.record.id} is still running",
            "a session that its bench has closed",
            "Close it at the bench",
        )
