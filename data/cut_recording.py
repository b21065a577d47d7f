"""Six load cases of DEV-02 as a lab's program has them: pound-forces, newton metres, decimal commas.

    python data/cut_recording.py

writes `recordings/rig.csv` and `recordings/notes.txt`, which the tutorial "From your CSV to a verdict" uses. The
readings are those of the session, cut out case by case; time goes on without the pauses.
"""

from __future__ import annotations

import csv
import gzip
from pathlib import Path

import yaml

HERE = Path(__file__).resolve().parent
SOURCE = HERE / "sessions" / "DEV-02"
CASES = ("c055", "c056", "c057", "c058", "c094", "c093")
LBF_N = 4.4482216152605
GUARD_S, STEP_S = 0.6, 0.04
AXES = ("Fx (lbf)", "Fy (lbf)", "Fz (lbf)", "Tx (N-m)", "Ty (N-m)", "Tz (N-m)")


def main() -> None:
    """Write the two files."""
    document = yaml.safe_load((SOURCE / "session.yaml").read_text("utf-8"))
    cases = [next(c for c in document["cases"] if c["id"] == name) for name in CASES]
    windows: list[tuple[float, float]] = []
    for begin, end in (case[key] for case in cases for key in ("unloaded_s", "loaded_s")):
        if (begin, end) not in windows:
            windows.append((begin, end))
    with gzip.open(SOURCE / "readings.csv.gz", "rt", encoding="utf-8") as stream:
        readings = [[float(x) for x in row[:7]] for row in list(csv.reader(stream))[1:]]
    lines = ["Rig 3;left hand", ";".join(["Time (ms)", *AXES])]
    for begin, end in windows:
        for _, *wrench in (r for r in readings if begin - GUARD_S <= r[0] <= end + GUARD_S):
            values = [x / LBF_N for x in wrench[:3]] + [x / 1000.0 for x in wrench[3:]]
            time_ms = 1000.0 * STEP_S * (len(lines) - 2)
            lines.append(";".join([f"{time_ms:.0f}", *(f"{x:.6f}" for x in values)]).replace(".", ","))
    notes, before = [], ("", "")
    for case in cases:
        hung = " + ".join(f"{tendon} {mass:g}" for tendon, mass in case["masses_g"].items() if mass)
        place = (case["posture"], case["location"])
        # What a line leaves out is as in the line before.
        notes.append(", ".join([hung, *(now for now, was in zip(place, before, strict=True) if now != was)]))
        before = place
    target = HERE / "recordings"
    target.mkdir(exist_ok=True)
    (target / "rig.csv").write_text("\n".join(lines) + "\n", "utf-8")
    (target / "notes.txt").write_text("\n".join(notes) + "\n", "utf-8")


if __name__ == "__main__":
    main()
