"""Measure the memory and time in which a long recording is drawn, and a session is made of it.

    python -m benchmarks.new_recording [--rows 1450000 14500000] [--out FILE]

A recording at 1 kHz with a plateau a minute, a tare and a load in turn, written to the temporary folder as a lab's
text (semicolons, lbf and N m) and taken away again; `fingertwin plot` and `new` each run in a fresh process.
"""

from __future__ import annotations

import argparse
import contextlib
import datetime as dt
import io
import multiprocessing
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import yaml
from pyarrow import csv

from benchmarks.machine import commit, most_memory_bytes
from benchmarks.uplink_parts import surroundings

RATE_HZ, HOLD_S, BLOCK = 1000.0, 60.0, 200_000
MASSES_G = (300.0, 500.0, 700.0, 950.0)
# Change of the wrench [N, N mm] with the mass [g].
ARM = np.array([-0.4e-3, -1.2e-3, 0.05e-3, 1e-3, -2e-3, 10e-3])
HEADINGS = ["Time (s)", *(f"F{axis} (lbf)" for axis in "xyz"), *(f"T{axis} (N m)" for axis in "xyz")]
# In N and N mm.
UNITS = np.array([4.4482216152605] * 3 + [1000.0] * 3)
SETUP = {
    "format": "bench-setup/1",
    "specimen": {"id": "S1", "species": "human", "digit": "third", "side": "right"},
    "finger": "an1979_middle",
    "tension_factor": 0.835,
    "load_cell": {"rate_hz": RATE_HZ, "mounts": {"tip": {"frame": "distal_phalanx"}, "bone": {"frame": "metacarpal"}}},
}


def record(folder: Path, rows: int) -> Path:
    """Write the recording, its notebook and the rig."""
    rng = np.random.default_rng(0)
    options = csv.WriteOptions(include_header=False, delimiter=";")
    with (folder / "run.csv").open("wb") as stream:
        stream.write((";".join(HEADINGS) + "\n").encode())
        for first in range(0, rows, BLOCK):
            t_s = np.arange(first, min(first + BLOCK, rows)) / RATE_HZ
            number = (t_s // HOLD_S).astype(int)
            mass_g = np.where(number % 2 == 1, np.array(MASSES_G)[number // 2 % len(MASSES_G)], 0.0)
            noise = rng.normal(size=(len(t_s), 6)) * [0.01, 0.01, 0.01, 0.1, 0.1, 0.1]
            values = np.round((mass_g[:, None] * ARM + noise) / UNITS, 6)
            csv.write_csv(pa.table([np.round(t_s, 3), *values.T], names=HEADINGS), stream, options)
    loads = range(int(rows / RATE_HZ / HOLD_S) // 2)
    lines = [f"FDP {MASSES_G[k % len(MASSES_G)]:g}, minor_flexion, tip, identification" for k in loads]
    (folder / "notes.txt").write_text("\n".join(lines), encoding="utf-8")
    (folder / "setup.yaml").write_text(yaml.safe_dump(SETUP), encoding="utf-8")
    return folder / "run.csv"


def run(pipe: Any, command: Sequence[str]) -> None:
    """Run a command in this process; send processor time [s] and the most memory [MB]."""
    from server.cli import app

    with contextlib.redirect_stdout(io.StringIO()):
        code = app(list(command), standalone_mode=False)
    assert code in (0, None)
    pipe.send((time.process_time(), most_memory_bytes() / 1e6))


def measured(rows: int) -> list[tuple[str, float, float, float]]:
    """Of each command: its name, size of the recording [MB], processor time [s] and the most memory [MB]."""
    out = []
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        file = record(folder, rows)
        size = file.stat().st_size / 1e6
        new = ["new", file, "--notes", folder / "notes.txt", "--setup", folder / "setup.yaml", "--yes"]
        new += ["--posture", "minor_flexion: MCP 40 PIP 55 DIP 35 abduction 0", "--out", folder / "made"]
        context = multiprocessing.get_context("spawn")
        for command in (["plot", file, "--out", folder / "run.html"], new):
            here, there = context.Pipe(duplex=False)
            process = context.Process(target=run, args=(there, [str(c) for c in command]))
            process.start()
            there.close()
            out.append((str(command[0]), size, *here.recv()))
            process.join()
    return out


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
        "`fingertwin plot` and `new` of a lab's text at 1 kHz (semicolons, lbf and N m), a plateau a minute.",
        "",
        "| rows | recording [MB] | command | processor time [s] | most memory [MB] |",
        "|---|---|---|---|---|",
    ]
    for rows in given.rows:
        for name, size, seconds, memory in measured(rows):
            lines.append(f"| {rows} | {size:.0f} | {name} | {seconds:.0f} | {memory:.0f} |")
    text = "\n".join(lines) + "\n"
    given.out.write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
