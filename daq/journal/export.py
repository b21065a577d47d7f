"""A stream of a journal as a readings file, with its events as JSON beside it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from daq.errors import JournalError
from daq.files import replacing
from daq.journal.check import require_complete
from daq.journal.reader import JournalReader
from daq.journal.rows import as_utc
from daq.quoting import quoted
from daq.recordings.readings import ReadingBlock, write_readings

SCHEMA = "fingertwin/journal-events/1"


@dataclass(frozen=True)
class Exported:
    """Files and rows written by an export."""

    stream: str
    readings: Path
    events: Path
    samples: int


def export(path: str | Path, out: str | Path, stream: str | None = None) -> Exported:
    """Write a stream's readings as CSV, gzipped CSV or Parquet, by the ending, and its events and the bench's as JSON.

    Args:
        path: of the journal; it may be written meanwhile.
        out: of the readings; the events go to the same name with `.events.json`.
        stream: its id or the beginning of it; may be left out where there is one.

    Raises:
        JournalError: there is no such stream, a chunk is damaged, or readings were lost that no recovery has noted.
        ReadingsError: the ending is none of these.
    """
    target = Path(out)
    samples = 0
    require_complete(Path(path))
    with JournalReader.open(path) as journal:
        streams = [s for s in journal.streams() if s.id.startswith(stream or "")]
        if len(streams) != 1:
            ids = " ".join(s.id[:12] for s in streams or journal.streams()) or "(it has none)"
            found = f"{len(streams) or 'no'} streams" + (f" called {stream}" if stream else "")
            one_of_them = f"fingertwin journal export {quoted(path)} --stream ID"
            remedy = f"Write one as a recording with {one_of_them}; ID is one of {ids}"
            raise JournalError(f"{found} in {journal.path.name}", "one", remedy)
        one = streams[0]

        def blocks() -> Iterator[ReadingBlock]:
            nonlocal samples
            for chunk in journal.read(one.id):
                samples += len(chunk)
                if len(chunk):
                    yield ReadingBlock(chunk.t_s, chunk.wrench, chunk.status)

        write_readings(target, blocks())
        events = [e for e in journal.events() if e.stream in (None, one.id)]
        document = {
            "schema": SCHEMA,
            "bench": journal.bench,
            "stream": one.id,
            "driver": one.driver,
            "settings": one.settings,
            "cell": one.cell,
            "started_utc": one.started_utc,
            "clock": one.clock,
            "events": [{"kind": e.kind, "at_s": e.at_s, "utc": as_utc(e.utc_s), "stream": e.stream, "value": e.value}
                       for e in events],
        }  # fmt: skip
    beside = target.with_name(target.name + ".events.json")
    with replacing(beside) as temporary:
        temporary.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    return Exported(one.id, target, beside, samples)
