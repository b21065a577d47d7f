"""Records of the sampling thread: chunks of samples, and events of the stream."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

from daq.acquisition.blocks import Chunk

Kind = Literal[
    "started",
    "gap",
    "overload",
    "overload_ended",
    "damaged",
    "undecoded",
    "stale",
    "disconnected",
    "reconnected",
    "overrun",
    "ended",
]


@dataclass(frozen=True)
class StreamEvent:
    """Something that happened to a stream.

    Attributes:
        kind: what.
        at_s: when, in the stream's time [s].
        utc_s: by the wall clock [s since 1970].
        value: particulars, units in the keys.
    """

    kind: Kind
    at_s: float
    utc_s: float
    value: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Record:
    """Record of the sampling thread: a chunk with its events, or events alone.

    A chunk without samples holds bytes that made none.
    """

    chunk: Chunk | None
    events: tuple[StreamEvent, ...]
