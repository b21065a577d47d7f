"""A long recording through the corrections: how much faster than real time, and in how much memory.

Every measurement is a fresh process, started from one that is itself small: `python -m benchmarks.corrections FOLDER`.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from importlib import import_module
from pathlib import Path

from benchmarks.machine import OWN_SHARE, most_memory_bytes, repeat, table, wait_until_quiet

RATE_HZ = 1000.0
# An hour and some ten minutes of the published protocol, which takes four.
HOURS = {"an hour": 3600.0, "ten minutes": 600.0}
FORMATS = {"Parquet": "readings.parquet", "CSV": "readings.csv"}
REPETITIONS = 3
TARGET = 1000.0


def main() -> None:
    """Time them and print the table; with a folder as argument, measure that one session and print it as JSON."""
    if len(sys.argv) > 1:
        print(json.dumps(_measure(Path(sys.argv[1]), write=sys.argv[2:])))
        return
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for name, file in FORMATS.items():
            for length, seconds in HOURS.items():
                session = Path(folder) / f"{name}-{seconds:g}"
                made = _child(session, file, str(seconds))
                wait_until_quiet()
                runs = _undisturbed(session)
                rows.append(_row(f"{name}, {length}", made, runs, session / file))
                (session / file).unlink()
    table(
        f"Corrections: {RATE_HZ:g} Hz × 6 through `daq.signals.corrections` (target: {TARGET:,.0f} × real time)",
        [
            "",
            "recorded [s]",
            "file [MB]",
            "best [s]",
            "median [s]",
            "× real time",
            "memory [MB]",
            "of it, modules",
            "of the core",
        ],
        rows,
        "Memory is the most that the process ever held, the modules what it held before it opened the recording. "
        "The recordings are the simulated rig's, with its protocol repeated.",
    )


def _undisturbed(session: Path) -> list[dict[str, float]]:
    """Repeat until enough runs had the core to themselves, or there were twice as many."""
    runs: list[dict[str, float]] = []
    while len(runs) < 2 * REPETITIONS and sum(run["share"] > OWN_SHARE for run in runs) < REPETITIONS:
        runs.append(_child(session))
    return sorted(runs, key=lambda run: -run["share"])[:REPETITIONS]


def _child(session: Path, *arguments: str) -> dict[str, float]:
    command = [sys.executable, "-m", "benchmarks.corrections", str(session), *arguments]
    answer = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
    numbers: dict[str, float] = json.loads(answer)
    return numbers


def _measure(folder: Path, write: list[str]) -> dict[str, float]:
    if write:
        return _simulate(folder, write[0], float(write[1]))
    # Loaded by the first reading in any case, and no part of what grows with a recording.
    for module in ("pyarrow.csv", "pyarrow.parquet", "scipy.fft", "scipy.special"):
        import_module(module)

    from daq.sessions import read_session
    from daq.signals.corrections import measure

    session = read_session(folder)
    before = most_memory_bytes()
    timing = repeat(lambda: measure(session), 1, patience_s=0.0)
    return {"seconds": timing.least, "share": timing.own_share, "before": before, "most": most_memory_bytes()}


def _simulate(folder: Path, file: str, seconds: float) -> dict[str, float]:
    from daq.sessions.protocols import plan, read_protocol
    from daq.standins.simulated import SimulatedCell
    from fingermodel.fingers.files import read_finger
    from fingermodel.rig import simulate_session

    protocol = read_protocol("synek2019")
    once = plan(protocol)[1]
    repeats = max(round(seconds / once), 1)
    cell = SimulatedCell(rate_hz=RATE_HZ)
    finger = read_finger("an1979_middle")
    simulate_session(finger, protocol, folder, cell=cell, repeats=repeats, readings_name=file)
    return {"recorded": repeats * once}


def _row(name: str, made: dict[str, float], runs: list[dict[str, float]], file: Path) -> list[str]:
    runs = sorted(runs, key=lambda run: run["seconds"])
    best, median = runs[0], runs[len(runs) // 2]
    return [
        name,
        f"{made['recorded']:.0f}",
        f"{file.stat().st_size / 1e6:.0f}",
        f"{best['seconds']:.2f}",
        f"{median['seconds']:.2f}",
        f"{made['recorded'] / best['seconds']:,.0f}",
        f"{max(run['most'] for run in runs) / 1e6:.0f}",
        f"{max(run['before'] for run in runs) / 1e6:.0f}",
        f"{best['share']:.0%}",
    ]


if __name__ == "__main__":
    main()
