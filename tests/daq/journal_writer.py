"""A process that appends to a journal until it is killed, and says what was acknowledged."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from daq.acquisition.blocks import Chunk
from daq.journal.writer import Event, Journal


def made_chunk(first_seq: int, count: int = 700, rate_hz: float = 7000.0) -> Chunk:
    """A chunk that only its first number decides, so that whoever reads it can tell whether it is the one."""
    random = np.random.default_rng(first_seq)
    t_s = (first_seq + np.arange(count)) / rate_hz
    status = random.integers(0, 2, count)
    raw = random.bytes(36 * count)
    return Chunk(
        first_seq, t_s, random.normal(size=(count, 6)), status, status == 1, raw, [(len(raw), first_seq / rate_hz)], 1e9
    )


def made_count(first_seq: int) -> int:
    """How many samples the writer's chunk has: from a few to several pages."""
    return 1 + first_seq * 7919 % 1500


def main(path: str, copy: str) -> None:
    """Append to a new stream, with an event every third time; copy and close now and then."""
    with Journal.open(path) as journal:
        stream = journal.add_stream("made", {"rate_hz": 7000.0}, {"serial": "1"})
        print(stream, flush=True)
        seq = 0
        for i in range(1_000_000):
            events = [Event("mark", seq / 7000.0, {"seq": seq})] if i % 3 == 0 else []
            seq = journal.append(stream, made_chunk(seq, made_count(seq)), events)
            print(seq, flush=True)
            if i % 40 == 39:
                Path(copy).unlink(missing_ok=True)
                journal.copy_to(Path(copy))


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
