"""Stored readings of a window of time: as they are, or least and most of each stretch where they are too many to draw.

No more is read than the chunks of the window. Envelopes of what was looked at before are remembered: chunks that are
stored never change, they only become more.
"""

from __future__ import annotations

import math
import threading
from collections import OrderedDict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import ColumnElement, Connection, func, select

from daq.acquisition.blocks import Chunk
from daq.recordings.windows import Span
from server.service.ingest.stored import STORED, Place, chunk_of, ends_of, in_stream, known_stream, places_of
from server.service.storage.database import Database
from server.service.storage.schema import chunks
from server.service.web.problems import ProblemError
from server.service.web.workers import require_client

# (n,) envelopes: from and to which time, of how many samples, how many of them flagged, least and most of each channel.
ENVELOPE = np.dtype(
    [("from_s", "f8"), ("to_s", "f8"), ("count", "i8"), ("flagged", "i8"), ("least", "f8", (6,)), ("most", "f8", (6,))]
)
Rows = NDArray[np.void]
Floats = NDArray[np.float64]

# Chunks are remembered in groups of so many samples, in rows of so much time or so many samples.
GROUP, FINE_S, FINE_SAMPLES = 1 << 14, 0.04, 16
# Rows that are remembered: some 40 MB.
MOST_ROWS = 300_000
# Samples that one request may have read: over an hour at 7 kHz, some seconds of work.
MOST_SAMPLES = 1 << 25
_AT_ONCE = 500


@dataclass(frozen=True, eq=False)
class Samples:
    """Consecutive samples of a stream."""

    t_s: Floats  # (n,) times
    wrench: Floats  # (n, 6) in the cell's axes [N, N mm]
    flagged: NDArray[np.bool_]  # (n,) whether the cell, or its range, says that a sample is not to be trusted


@dataclass(frozen=True, eq=False)
class Window:
    """Stored readings of a window."""

    window_s: Span  # first and last time
    stream_s: Span | None  # first and last time of the stream; None where it is empty
    missing_s: list[Span]  # stretches within the window of which samples are missing
    found: Samples | Rows  # samples as they are, or envelopes of them


@dataclass(frozen=True, eq=False)
class _Group:
    """Neighbouring chunks: where they lie, and their envelopes."""

    places: tuple[Place, ...]
    rows: Rows


class Envelopes:
    """Reads windows of stored streams.

    Args:
        database: that holds them.
    """

    def __init__(self, database: Database) -> None:
        self._database = database
        self._known: OrderedDict[tuple[str, str, float, int], _Group] = OrderedDict()
        self._rows = 0
        self._lock = threading.Lock()

    def window(self, session: str, stream: str, from_s: float | None, to_s: float | None, points: int) -> Window:
        """Return a window.

        Args:
            session: that the stream belongs to.
            stream: its id.
            from_s: first time; None is the stream's.
            to_s: last time; None is the stream's.
            points: so many samples are given as they are; of more, at most so many envelopes.

        Raises:
            ProblemError: 404 there is no such stream, 422 the window is turned round, or too long to be read at once.
            DamagedError: a chunk is not as it was sent.
        """
        if from_s is not None and to_s is not None and not from_s <= to_s:
            raise ProblemError(422, f"a window from {from_s:g} to {to_s:g} s", "from_s before to_s")
        mine = in_stream(session, stream)
        with self._database.reading() as connection:
            row = known_stream(connection, session, stream)
            # One by one: each is the end of an index.
            first_s, last_s = (
                connection.execute(select(end).where(mine)).scalar()
                for end in (func.min(chunks.c.first_s), func.max(chunks.c.last_s))
            )
            if first_s is None or last_s is None:
                return Window((from_s or 0.0, to_s or 0.0), None, [], _joined([]))
            window = (first_s if from_s is None else from_s, last_s if to_s is None else to_s)
            window = (window[0], max(window))
            ends = ends_of(connection, mine, window)
            row_s = _row_s(row.held, last_s - first_s)
            if window[1] - window[0] >= 2.0 * points * row_s:
                groups = self._groups(connection, mine, (session, stream, row_s), ends)
                places = [p for g in groups for p in g.places]
                rows = np.concatenate([g.rows for g in groups]) if groups else np.empty(0, ENVELOPE)
                rows = rows[(rows["to_s"] >= window[0]) & (rows["from_s"] <= window[1])]
                if rows["count"].sum() > points:
                    found: Samples | Rows = _merged(rows, _stretches(rows["from_s"], window, points))
                    return Window(window, (first_s, last_s), _missing(places, window), found)
            places = places_of(connection, mine, ends)
            _require_few(sum(p.n for p in places))
            found = _exact(_read(connection, mine, [p.first_seq for p in places]), window, points)
        return Window(window, (first_s, last_s), _missing(places, window), found)

    def _groups(
        self, connection: Connection, mine: ColumnElement[bool], of: tuple[str, str, float], ends: tuple[int, int]
    ) -> list[_Group]:
        """Return groups of chunks between two of them, read where they are not remembered as they are now."""
        # The key's index alone answers this, as no other column is asked for.
        group = (chunks.c.first_seq // GROUP).label("place")
        low, high = ends[0] // GROUP * GROUP, ends[1] // GROUP * GROUP + GROUP
        within = mine & (chunks.c.first_seq >= low) & (chunks.c.first_seq < high)
        query = select(group, func.count()).where(within).group_by("place").order_by("place")
        counts = {int(at): int(count) for at, count in connection.execute(query)}
        with self._lock:
            known = {at: self._known.get((*of, at)) for at in counts}
        fresh = [at for at, g in known.items() if g is None or len(g.places) != counts[at]]
        listed = {at: places_of(connection, mine, (at * GROUP, at * GROUP + GROUP - 1)) for at in fresh}
        _require_few(sum(p.n for places in listed.values() for p in places))
        out = {at: g for at, g in known.items() if g is not None}
        for at, places in listed.items():
            rows = []
            for chunk in _read(connection, mine, [p.first_seq for p in places if p.n]):
                samples = _samples(chunk)
                rows.append(_enveloped(samples, starts_of(np.floor(samples.t_s / of[2]))))
            out[at] = _Group(tuple(places), np.concatenate(rows) if rows else np.empty(0, ENVELOPE))
        self._remember(of, {at: out[at] for at in fresh})
        return [out[at] for at in counts]

    def _remember(self, of: tuple[str, str, float], groups: dict[int, _Group]) -> None:
        with self._lock:
            for at, group in groups.items():
                before = self._known.pop((*of, at), None)
                self._rows += len(group.rows) - (0 if before is None else len(before.rows))
                self._known[(*of, at)] = group
            while self._rows > MOST_ROWS:
                self._rows -= len(self._known.popitem(last=False)[1].rows)


def _row_s(samples: int, span_s: float) -> float:
    """Return the length of a remembered row [s]: FINE_S, or a power of two of it that holds about FINE_SAMPLES."""
    needed_s = FINE_SAMPLES * span_s / max(samples, 1)
    return FINE_S * 2.0 ** max(round(math.log2(max(needed_s, FINE_S) / FINE_S)), 0)


def _read(connection: Connection, mine: ColumnElement[bool], wanted: Sequence[int]) -> Iterator[Chunk]:
    for at in range(0, len(wanted), _AT_ONCE):
        query = select(*STORED).where(mine & chunks.c.first_seq.in_(wanted[at : at + _AT_ONCE]))
        # A reader that stops early leaves no cursor behind.
        with connection.execute(query.order_by(chunks.c.first_seq).execution_options(yield_per=16)) as rows:
            for row in rows:
                require_client()
                yield chunk_of(row)


def _exact(read: Iterable[Chunk], window: Span, points: int) -> Samples | Rows:
    """Return a window's samples, or envelopes of equal stretches where they are too many; holds one chunk at a time."""
    few: list[Samples] = []
    rows: list[Rows] = []
    count = 0
    for chunk in read:
        samples = _within(_samples(chunk), window)
        count += len(samples.t_s)
        few = [*few, samples] if count <= points else []
        rows.append(_enveloped(samples, _stretches(samples.t_s, window, points)))
    if count <= points:
        return _joined(few)
    found = np.concatenate(rows)
    return _merged(found, _stretches(found["from_s"], window, points))


def _missing(places: Sequence[Place], window: Span) -> list[Span]:
    """Return stretches of a window between chunks that do not follow each other."""
    out = []
    for before, place in pairwise(p for p in places if p.n):
        if place.first_seq != before.first_seq + before.n:
            stretch = max(before.last_s, window[0]), min(place.first_s, window[1])
            if stretch[0] < stretch[1]:
                out.append(stretch)
    return out


def _samples(chunk: Chunk) -> Samples:
    return Samples(chunk.t_s, chunk.wrench, chunk.overload | (chunk.status != 0))


def _joined(parts: Sequence[Samples]) -> Samples:
    if not parts:
        return Samples(np.empty(0), np.empty((0, 6)), np.empty(0, dtype=bool))
    return Samples(*(np.concatenate([getattr(p, name) for p in parts]) for name in ("t_s", "wrench", "flagged")))


def _within(found: Samples, window: Span) -> Samples:
    if len(found.t_s) and window[0] <= found.t_s[0] and found.t_s[-1] <= window[1]:
        return found
    inside = (found.t_s >= window[0]) & (found.t_s <= window[1])
    return Samples(found.t_s[inside], found.wrench[inside], found.flagged[inside])


def _enveloped(samples: Samples, starts: NDArray[np.intp]) -> Rows:
    """Return one envelope of the samples from each start to the next."""
    each = {"from_s": samples.t_s, "to_s": samples.t_s, "least": samples.wrench, "most": samples.wrench}
    counts = {"count": np.ones(len(samples.t_s), np.int64), "flagged": samples.flagged.astype(np.int64)}
    return _merged(each | counts, starts)


def _merged(rows: Rows | Mapping[str, NDArray[Any]], starts: NDArray[np.intp]) -> Rows:
    """Return one envelope of the rows, or of columns by name, from each start to the next."""
    out = np.empty(len(starts), ENVELOPE)
    if len(starts):
        out["from_s"] = rows["from_s"][starts]
        out["to_s"] = rows["to_s"][np.append(starts[1:], len(rows["to_s"])) - 1]
        for name in ("count", "flagged"):
            out[name] = np.add.reduceat(rows[name], starts)
        out["least"] = np.fmin.reduceat(rows["least"], starts, axis=0)
        out["most"] = np.fmax.reduceat(rows["most"], starts, axis=0)
    return out


def _stretches(t_s: Floats, window: Span, points: int) -> NDArray[np.intp]:
    """Return the index at which each of so many equal stretches of a window begins."""
    width = (window[1] - window[0]) / points
    if not width > 0.0:
        return np.zeros(min(len(t_s), 1), dtype=np.intp)
    return starts_of(np.clip(np.floor((t_s - window[0]) / width), 0, points - 1))


def starts_of(place: Floats) -> NDArray[np.intp]:
    """Return the index at which each run of equal places begins."""
    return np.flatnonzero(np.diff(place, prepend=np.nan) != 0.0)


def _require_few(samples: int) -> None:
    if samples > MOST_SAMPLES:
        raise ProblemError(
            422,
            f"a window of {samples} samples that were not looked at before",
            f"at most {MOST_SAMPLES} at once",
            "Ask for parts of it first; what was looked at is remembered",
        )
