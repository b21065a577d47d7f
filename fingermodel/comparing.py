"""Compare a session with its model; the compiler of arrays is loaded with the first comparison."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fingermodel.session import Session, require_session

if TYPE_CHECKING:
    from fingermodel.comparison.comparison import Comparison

__all__ = ["compare"]


def compare(session: Session) -> Comparison:
    """Compare the measured forces of a session with those that its model predicts.

    Args:
        session: with the model that predicts.

    Raises:
        InputError: it is no session.

    Example:
        >>> from fingermodel import Session, compare
        >>> comparison = compare(Session.open("DEV-02"))
        >>> round(comparison.rmse_N("validation/tip"), 2)
        0.26
        >>> comparison.cases[0].residual_N.shape
        (3,)
    """
    from fingermodel.comparison import comparison

    require_session(session)
    return comparison.compare(session.model, session.observations, session.theta)
