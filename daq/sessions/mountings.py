"""The mounting of the cell that a known weight was hung on."""

from __future__ import annotations

from collections.abc import Mapping

from daq.sessions.models import Event, KnownWeight, Session

Span = tuple[float, float]


def mounting_of(weight: KnownWeight, session: Session) -> int:
    """Return how many times the cell had been moved at a known weight's mount.

    Recorded load cases and `move_cell` events about its window tell it. Averaged forces have no time: there the first
    case at the mount stands for a weight before or during the session, and the last one for a weight after it.
    """
    cases = [c for c in session.cases if c.location == weight.mount]
    timed = sorted((_middle(c.loaded_s), c.mounting) for c in cases if c.loaded_s is not None)
    if not timed:
        stated = [c.mounting for c in cases] or [0]
        return stated[-1 if weight.when == "after" else 0]
    at = _middle(weight.loaded_s)
    moves = [e.t_s for e in session.events if _moves(e, weight.mount)]
    earlier, later = [c for c in timed if c[0] <= at], [c for c in timed if c[0] > at]
    if not earlier:
        begin, first = later[0]
        return max(first - any(at < t <= begin for t in moves), 0)
    end, last = earlier[-1]
    moved = any(end < t <= at for t in moves)
    if not later:
        return last + moved
    begin, following = later[0]
    if moved or any(at < t <= begin for t in moves):
        return following if moved else last
    return last if at - end <= begin - at else following


def _middle(window: Span) -> float:
    return 0.5 * (window[0] + window[1])


def _moves(event: Event, mount: str) -> bool:
    """Whether an event put the cell at a mount, or may have: one that is noted by hand need not say where."""
    place = event.value.get("location", mount) if isinstance(event.value, Mapping) else mount
    return event.kind == "move_cell" and bool(place == mount)
