"""Load cases behind each point of a figure, so that a click on it can lead to them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from fingermodel.comparison.comparison import muscles_of

Points = str | list[Any] | None


@dataclass(frozen=True)
class Told:
    """Load case as figures may refer to it."""

    id: str  # of the case
    role: str  # of the case
    location: str  # of the cell
    muscles: str  # that are loaded, such as `FDP+FDS`
    posture: str  # its name


def told_of(documents: Sequence[Mapping[str, Any]]) -> list[Told]:
    """Return what labels may name of the cases of a session's document."""
    return [
        Told(str(c["id"]), str(c.get("role")), str(c.get("location")), muscles_of(c.get("masses_g") or {}),
             str(c.get("posture")))
        for c in documents
    ]  # fmt: skip


def cases_of(figure: Mapping[str, Any], known: Sequence[Told]) -> list[Points]:
    """Return, trace by trace, the cases of its points, as each trace's `meta` states them.

    Stated is `case`, one id for all of it; `cases`, an id for each point; or `select`, for each point what its cases
    have in common.

    Args:
        figure: its plain data.
        known: cases that may be named.

    Returns:
        of each trace the id of the one case that all of it stands for, or a list with an id, a list of ids or null for
        each point (of a map for each row a list of those), or null where it stands for none.
    """
    ids = {c.id for c in known}

    def found(stated: Any) -> Any:
        if isinstance(stated, list):
            return [found(one) for one in stated]
        if isinstance(stated, dict):
            return [c.id for c in known if all(getattr(c, key) == value for key, value in stated.items())] or None
        return stated if stated in ids else None

    metas = (trace.get("meta") for trace in figure["data"])
    return [
        found(meta.get("case") or meta.get("cases") or meta.get("select")) if isinstance(meta, dict) else None
        for meta in metas
    ]
