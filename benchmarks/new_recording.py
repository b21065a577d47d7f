"""Measure the memory and time in which `fingertwin new` makes a session of a long recording.

    python -m benchmarks.new_recording [--rows 1450000 14500000] [--out FILE]

A recording at 1 kHz with a plateau a minute, a tare and a load in turn, written as CSV to the temporary folder
and taken away again; each is made a session of in a fresh process.
"""

from __future__ import annotations

import argparse
import contextlib
import datetime as dt
import io
import multiprocessing
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from benchmarks.machine import commit, most_memory_bytes
from benchmarks.uplink_parts import surroundings

RATE_HZ, HOLD_S, BLOCK = 1000.0, 60.0, 200_000
MASSES_G = (300.0, 500.0, 700.0, 950.0)
# Change of the wrench [N, N mm] with the mass [g].
ARM = np.array([-0.4e-3, -1.2e-3, 0.05e-3, 1e-3, -2e-3, 10e-3])
SETUP = {
    "format": "bench-setup/1",
    "specimen": {"id": "S1", "species": "human", "digit": "third", "side": "right"},
    "finger": "an1979_middle",
    "tension_factor": 0.835,
    "load_cell": {"rate_hz": RATE_HZ, "mounts": {"tip": {"frame": "distal_phalanx"}, "bone": {"frame": "metacarpal"}}},
}


def record(folder: Path, rows: int) -> Path:
    """Write the recording, its notebook and the rig."""
    from daq.recordings.readings import ReadingBlock, write_readings

    rng = np.random.default_rng(0)

    def blocks() -> Iterator[ReadingBlock]:
        for first in range(0, rows, BLOCK):
            t_s = np.arange(first, min(first + BLOCK, rows)) / RATE_HZ
            number = (t_s // HOLD_S).astype(int)
            mass_g = np.where(number % 2 == 1, np.array(MASSES_G)[number // 2 % len(MASSES_G)], 0.0)
            noise = rng.normal(size=(len(t_s), 6)) * [0.01, 0.01, 0.01, 0.1, 0.1, 0.1]
            yield ReadingBlock(np.round(t_s, 3), np.round(mass_g[:, None] * ARM + noise, 6))

    loads = range(int(rows / RATE_HZ / HOLD_S) // 2)
    lines = [f"FDP {MASSES_G[k % len(MASSES_G)]:g}, minor_flexion, tip, identification" for k in loads]
    (folder / "notes.txt").write_text("\n".join(lines), encoding="utf-8")
    (folder / "setup.yaml").write_text(yaml.safe_dump(SETUP), encoding="utf-8")
    return write_readings(folder / "run.csv", blocks())


def make(pipe: Any, folder: Path) -> None:
    """Make a session in this process; send processor time [s] and the most memory [MB]."""
    from server.cli import app

    command = ["new", folder / "run.csv", "--notes", folder / "notes.txt", "--setup", folder / "setup.yaml", "--yes"]
    command += ["--posture", "minor_flexion: MCP 40 PIP 55 DIP 35 abduction 0", "--out", folder / "made"]
    with contextlib.redirect_stdout(io.StringIO()):
        code = app([str(c) for c in command], standalone_mode=False)
    assert code in (0, None)
    pipe.send((time.process_time(), most_memory_bytes() / 1e6))


def measured(rows: int) -> tuple[float, float, float]:
    """Size of the recording [MB], processor time [s] and the most memory [MB]."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        size = record(folder, rows).stat().st_size / 1e6
        context = multiprocessing.get_context("spawn")
        here, there = context.Pipe(duplex=False)
        process = context.Process(target=make, args=(there, folder))
        process.start()
        there.close()
        seconds, memory = here.recv()
        process.join()
    return size, seconds, memory


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, nargs="+", default=[1_450_000, 14_500_000])
    parser.add_argument("--out", type=Path, default=Path(__file__).with_suffix(".md"))
    given = parser.parse_args()
    where = surroundings()
    lines = [
        "# Sessions made of long recordings",
        "",
        f"Made by `python -m benchmarks.new_recording --rows {' '.join(map(str, given.rows))}` on "
        f"{dt.datetime.now(dt.UTC).date()}, commit {commit()}.",
        where,
        "",
        "`fingertwin new` of a CSV at 1 kHz, a plateau a minute. Until commit c582c2f all readings were held: 494 MB",
        "for 1,450,000 rows and 2036 MB for 14,500,000; the sessions had the same windows and readings.",
        "",
        "| rows | recording [MB] | processor time [s] | most memory [MB] |",
        "|---|---|---|---|",
    ]
    for rows in given.rows:
        size, seconds, memory = measured(rows)
        lines.append(f"| {rows} | {size:.0f} | {seconds:.0f} | {memory:.0f} |")
    text = "\n".join(lines) + "\n"
    given.out.write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
