"""Going on with a bench session that broke off: found in its journal, held against what is asked for, and taken up.

Its stream goes on too, as after a cable was pulled: samples are numbered on, and time goes on by as much as the wall
clock did. So one stream, one time and one readings file hold the whole session.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from daq.bench.record import STARTED, BenchRecord, BenchSetup
from daq.errors import SessionError
from daq.journal.reader import JournalReader
from daq.journal.rows import Event, Stream
from daq.recordings.plateaus import Plateau
from daq.recordings.readings import ReadingBlock
from daq.recordings.windows import Span, gather
from daq.signals.corrections import windows_of
from daq.vocabulary import shown

# Time goes on by so much at least, whatever the wall clock says.
LEAST_AWAY_S = 1.0


@dataclass(frozen=True)
class BrokenOff:
    """Latest bench session in a journal, as it broke off.

    Attributes:
        stream: that its readings belong to.
        events: of the stream.
        record: folded from them.
        next_seq: number of the next sample.
        last_s: time of the last one; utc_s: by the wall clock [s since 1970], None without a sample.
    """

    stream: Stream
    events: tuple[Event, ...]
    record: BenchRecord
    next_seq: int
    last_s: float
    utc_s: float | None

    def from_s(self, wall: Callable[[], float] = time.time) -> float:
        """Return the time at which the session goes on, if it does so now."""
        return self.last_s + max(0.0 if self.utc_s is None else wall() - self.utc_s, LEAST_AWAY_S)

    def require_same(self, setup: BenchSetup, stream: Mapping[str, Any]) -> None:
        """Make sure that the session goes on as it began.

        Args:
            setup: that is asked for.
            stream: driver, settings, clock and cell that would be read.

        Raises:
            SessionError: something is another.
        """
        began, remedy = self.record.setup, "Give what the session began with, or begin another with a new --out"
        if setup.protocol != began.protocol:
            found = f"protocol {setup.protocol.id} is not that of session {began.id}, which is to go on"
            raise SessionError(found, f"{began.protocol.id} as it was", remedy)
        was = _plain(began.as_value()) | {k: _plain(getattr(self.stream, k)) for k in stream}
        now = _plain(setup.as_value()) | _plain(stream)
        for key in sorted(set(was) | set(now)):
            # How the protocol was named does not matter where it is the same, nor how the session would be called now.
            if was.get(key) != now.get(key) and key not in ("protocol_name", "id"):
                name, old, new = _difference(key, was.get(key), now.get(key))
                raise SessionError(f"{name} is {new}", f"{old}, as session {began.id} began", remedy)

    def plateaus(self, journal: JournalReader) -> dict[Span, Plateau]:
        """Reduce anew all windows that were taken.

        Raises:
            JournalError: a chunk is damaged.
            ReadingsError: readings of a window are not there any more.
        """
        if self.record.cases:
            windows = windows_of(self.record.session())
        else:
            spans = [tuple(check[k]) for check in self.record.checks for k in ("unloaded_s", "loaded_s")]
            windows = dict.fromkeys(spans, "a known weight")
        if not windows:
            return {}
        blocks = (ReadingBlock(c.t_s, c.wrench, c.status) for c in journal.read(self.stream.id) if len(c))
        return dict(gather(blocks, windows, journal.path.name).plateaus)


def broken_off(journal: JournalReader) -> BrokenOff | None:
    """Find the bench session that was begun last, also one that was closed; None where there is none.

    Raises:
        JournalError: the journal is damaged.
    """
    begun = {e.stream for e in journal.events() if e.kind == STARTED}
    stream = next((s for s in reversed(journal.streams()) if s.id in begun), None)
    if stream is None:
        return None
    events = tuple(journal.events(stream.id))
    next_seq, last_s, utc_s = journal.next_seq(stream.id), 0.0, None
    for chunk in journal.read(stream.id, max(next_seq - 1, 0)):
        if len(chunk):
            last_s, utc_s = float(chunk.t_s[-1]), chunk.utc_s
    return BrokenOff(stream, events, BenchRecord.of(events), next_seq, last_s, utc_s)


def _plain(value: Any) -> Any:
    """Return a value as it comes out of a journal."""
    return json.loads(json.dumps(value))


def _difference(name: str, old: Any, new: Any) -> tuple[str, str, str]:
    """Return the innermost key at which two values differ, and both values."""
    if isinstance(old, Mapping) and isinstance(new, Mapping):
        key = next(k for k in sorted(set(old) | set(new)) if old.get(k) != new.get(k))
        return _difference(f"{name}.{key}", old.get(key), new.get(key))
    return name, "absent" if old is None else shown(old), "absent" if new is None else shown(new)
