"""A lab's recording and notebook, of a session whose truth is known."""

from __future__ import annotations

from pathlib import Path

import yaml

from daq.recordings.readings import open_readings
from daq.sessions import plain_document, read_session

SOURCE, POSTURE = "DEV-02", "minor_flexion: MCP 40 PIP 55 DIP 35 abduction 0"


def lab_files(folder: Path) -> Path:
    """Write the first 16 cases of a recorded session as a lab has them: a CSV of its own, a notebook, and the rig."""
    session = read_session(SOURCE)
    assert session.readings_path is not None
    cases = session.cases[:16]
    assert cases[-1].loaded_s is not None
    lines = ["Rig 3;2026", "Zeit [ms];Kraft x [N];Kraft y [N];Kraft z [N];Moment x [N-m];Moment y [N-m];Moment z [N-m]"]
    for block in open_readings(session.readings_path).blocks():
        for t, row in zip(block.t_s, block.wrench, strict=True):
            if t < cases[-1].loaded_s[1] + 0.3:
                cells = [f"{1000 * t:.1f}", *(f"{x:.6f}" for x in row[:3]), *(f"{x / 1000:.9f}" for x in row[3:])]
                lines.append(";".join(cells).replace(".", ","))
    (folder / "rig.csv").write_text("\n".join(lines) + "\n", encoding="cp1252")
    notes = []
    for i, case in enumerate(cases):
        hung = " + ".join(f"{k} {v:g}" for k, v in case.masses_g.items() if v)
        notes.append(
            f"{hung}, {case.posture}, {case.location}" + (", validation" if i % 5 == 4 else ", identification")
        )
    (folder / "notes.txt").write_text("\n".join(notes), encoding="utf-8")
    document = plain_document(session)
    setup = {k: document[k] for k in ("specimen", "finger", "tension_factor", "load_cell")}
    (folder / "setup.yaml").write_text(yaml.safe_dump({"format": "bench-setup/1"} | setup), encoding="utf-8")
    return folder
