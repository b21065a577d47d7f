"""The spread between the specimens that a session is the mean of."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from fingermodel import comparing
from fingermodel.comparison.comparison import Comparison
from fingermodel.session import Session
from server.figures.arrows import Spread, spread_between


def spread_of(session: Session, comparison: Comparison) -> Mapping[str, Spread] | None:
    """Return the standard deviation between the specimens that a session is the mean of, where it says which."""
    members = session.measured.session.mean_of
    if not members:
        return None
    folder = session.measured.session.folder
    own = [folder.parent / m for m in members] if folder else []
    paths = [p if p.is_dir() else Path(m) for p, m in zip(own, members, strict=False)]
    return spread_between(comparison, [comparing.compare(Session.open(p, catalogue=False)) for p in paths])
