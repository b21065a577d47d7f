"""Protocol between a bench and the service: addresses, headers, answers."""

from __future__ import annotations

import datetime as dt
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from email.utils import parsedate_to_datetime
from urllib.parse import quote

from daq.errors import InputError

API = "/api/v1"
COUNT, SHA256, EPOCH = "X-Fingertwin-Count", "X-Fingertwin-SHA256", "X-Fingertwin-Epoch"
# Goes into addresses and names of files that are exported.
SESSION_ID = r"^[A-Za-z0-9][A-Za-z0-9._-]{0,99}$"
# Longer than this nobody is asked to wait: a mistaken header must not stop the uplink for good.
MOST_WAIT_S = 3600.0

Range = tuple[int, int]


def require_session_id(name: str, remedy: str = "") -> None:
    """Refuse a name that a service does not take for a session.

    Raises:
        InputError: it is one.
    """
    if not re.fullmatch(SESSION_ID, name):
        raise InputError(
            f"session name {name!r}", "letters, digits and . _ -, at most 100, a letter or digit first", remedy
        )


def session_path(session: str) -> str:
    """Return the address of a session, below the service's."""
    return f"{API}/sessions/{quote(session, safe='')}"


def stream_path(session: str, stream: str) -> str:
    """Return the address of a stream: PUT describes it; `/cursor` and `/chunks/{first_seq}` lie below."""
    return f"{session_path(session)}/streams/{quote(stream, safe='')}"


def events_path(session: str, epoch: str) -> str:
    """Return the address of a journal's events: `/cursor` and `/{number}` lie below.

    An epoch is one history, within which the number of an event never comes to mean another.
    """
    return f"{session_path(session)}/events/{quote(epoch, safe='')}"


@dataclass(frozen=True)
class Cursor:
    """The service's cursor of a stream.

    Attributes:
        next_seq: number of the sample after the last that is stored; 0 where none is.
        missing: (from, to) below it, `to` excluded, in order.
        ended: whether an empty chunk has ended the stream.
        epoch: of the journal that last wrote to it; None where none has.
    """

    next_seq: int
    missing: tuple[Range, ...] = ()
    ended: bool = False
    epoch: str | None = None

    @classmethod
    def of_answer(cls, value: object) -> Cursor:
        """Make a cursor of the service's JSON.

        Raises:
            ValueError: it is none of this kind.
        """
        if not isinstance(value, Mapping):
            raise ValueError("no object")
        next_seq, missing = _number(value.get("next_seq")), value.get("missing")
        if not isinstance(missing, list):
            raise ValueError("no list of what is missing")
        ranges, end = [], 0
        for pair in missing:
            if not isinstance(pair, list) or len(pair) != 2:
                raise ValueError("no range")
            begin, stop = _number(pair[0]), _number(pair[1])
            if not end <= begin < stop <= next_seq:
                raise ValueError("no range below next_seq")
            ranges.append((begin, stop))
            end = stop
        epoch = value.get("epoch")
        return cls(next_seq, tuple(ranges), value.get("ended") is True, epoch if isinstance(epoch, str) else None)

    def holds(self, begin: int, end: int) -> bool:
        """Return whether these samples are stored; of none (an empty chunk) whether it has ended the stream."""
        if begin == end:
            return self.ended
        return end <= self.next_seq and all(stop <= begin or end <= start for start, stop in self.missing)


def _number(value: object) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise ValueError("no number of a sample")
    return value


def without(ranges: Sequence[Range], gone: Sequence[Range]) -> list[Range]:
    """Return the parts of ranges outside of others."""
    out = list(ranges)
    for begin, end in gone:
        cut = []
        for start, stop in out:
            cut += [(a, b) for a, b in ((start, min(stop, begin)), (max(start, end), stop)) if a < b]
        out = cut
    return out


def retry_after_s(headers: Mapping[str, str], wall_s: float) -> float | None:
    """Return how long the service asks to be left alone [s]; None where it does not say.

    Args:
        headers: of its answer.
        wall_s: wall clock here [s since 1970], for a date without one of the service's own beside it.
    """
    asked = headers.get("Retry-After", "").strip()
    if asked.isdecimal():
        return min(float(asked), MOST_WAIT_S)
    until_s = _date_s(asked)
    if until_s is None:
        return None
    # By the service's own clock, where it tells it: the one here may be wrong.
    now_s = _date_s(headers.get("Date", ""))
    return min(max(until_s - (wall_s if now_s is None else now_s), 0.0), MOST_WAIT_S)


def _date_s(text: str) -> float | None:
    with suppress(ValueError, OverflowError):
        date = parsedate_to_datetime(text)
        return (date if date.tzinfo else date.replace(tzinfo=dt.UTC)).timestamp()
    return None
