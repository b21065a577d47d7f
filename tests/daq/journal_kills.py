"""Kill a writer at random moments and see what its journal holds."""

from __future__ import annotations

import random
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from daq.journal.check import check
from daq.journal.writer import Journal, JournalReader
from tests.daq.journal_writer import made_chunk, made_count


def kill_one(path: Path, rng: random.Random) -> tuple[int, int]:
    """Start a writer, kill it, and check its stream; return samples (acknowledged, kept).

    Raises:
        AssertionError: something acknowledged is lost or doubled, or the journal is damaged.
    """
    copy = path.with_name("copy.journal")
    command = [sys.executable, "-m", "tests.daq.journal_writer", str(path), str(copy)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, bufsize=1) as child:  # noqa: S603
        assert child.stdout is not None
        stream = child.stdout.readline().strip()
        acknowledged = [0, *(int(child.stdout.readline()) for _ in range(rng.randrange(0, 60)))]
        time.sleep(rng.random() * 0.01)
        child.kill()
        # What it said before it died counts too; a line that was cut short does not.
        acknowledged += [int(line) for line in child.stdout.read().splitlines(keepends=True) if line.endswith("\n")]
    with JournalReader.open(path) as journal:
        seq = 0
        for chunk in journal.read(stream):
            expected = made_chunk(seq, made_count(seq))
            assert chunk.first_seq == seq, "a chunk is lost or doubled"
            assert np.array_equal(chunk.wrench, expected.wrench)
            assert chunk.raw == expected.raw
            seq = chunk.next_seq
        assert journal.next_seq(stream) == seq
        marks = [e.value["seq"] for e in journal.events(stream) if e.kind == "mark"]
    starts = [0]
    while starts[-1] < seq:
        starts.append(starts[-1] + made_count(starts[-1]))
    assert starts[-1] == seq
    assert acknowledged[-1] in starts[-2:], f"{acknowledged[-1]} acknowledged, {seq} kept"
    assert marks == starts[:-1][::3], "events belong to their chunks"
    if copy.exists():
        assert check(copy).faults == (), "a copy whose name is there is whole"
        copy.unlink()
    return acknowledged[-1], seq


def kill_many(path: Path, kills: int, seed: int) -> tuple[int, int]:
    """Kill as many writers, one after the other, on one journal; return samples (acknowledged, kept) of all."""
    Journal.create(path, "kills").close()
    rng = random.Random(seed)  # noqa: S311 - moments, not secrets
    acknowledged = kept = 0
    for _ in range(kills):
        one, other = kill_one(path, rng)
        acknowledged, kept = acknowledged + one, kept + other
    report = check(path)
    assert report.faults == ()
    assert sum(report.samples.values()) == kept
    assert report.pending == sum(report.chunks.values())
    return acknowledged, kept
