"""`fingertwin export` and `fingertwin simulate`."""

from __future__ import annotations

import csv
import json as json_module
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from daq.errors import InputError
from server.console import answer, progress, say
from server.workflow import compare_bench, open_bench

VECTORS = (("measured", "N"), ("measured_sd", "N"), ("predicted", "N"), ("residual", "N"))


def export_source(source: str, file_format: str, out: Path | None, model: str | None, json: str | None) -> None:
    """Write a session's cases with predictions, or a revision's parameters, as CSV or Parquet."""
    if Path(source).suffix == ".json" and Path(source).is_file():
        from fingermodel.model_files import read_revision

        revision = read_revision(Path(source))
        name, rows = revision.id, [dict(p) for p in revision.document["parameters"]]
    else:
        with progress("Reading and correcting") as tell:
            bench = open_bench(source, model, tell)
        name = bench.measured.session.id
        muscles = bench.model.finger.topology.muscles
        rows = [_case_row(c.as_dict(), muscles) for c in compare_bench(bench).cases]
    path = out or Path(f"{name}.{file_format}")
    write_rows(path, rows, file_format)
    if not answer("export", {"source": source, "file": str(path), "rows": len(rows)}, json):
        say(f"{len(rows)} rows: {path}")


def _case_row(case: dict[str, Any], muscles: Sequence[str]) -> dict[str, Any]:
    row = {key: case[key] for key in ("id", "role", "posture", "location")}
    row |= {f"mass_{m}_g": case["masses_g"].get(m, 0.0) for m in muscles}
    for name, unit in VECTORS:
        row |= {f"{name}_F{axis}_{unit}": x for axis, x in zip("xyz", case[f"{name}_{unit}"], strict=True)}
    for name in ("measured", "predicted"):
        values = case[f"{name}_Nmm"] or (None, None, None)
        row |= {f"{name}_T{axis}_Nmm": x for axis, x in zip("xyz", values, strict=True)}
    return row | {"z": case["z"]}


def write_rows(path: Path, rows: Sequence[dict[str, Any]], file_format: str) -> None:
    """Write rows of one shape under a temporary name that is then renamed."""
    if not rows:
        raise InputError("nothing to export", "at least one load case")
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(path.name + ".tmp")
    if file_format == "parquet":
        import pyarrow as pa
        import pyarrow.parquet as pq

        pq.write_table(pa.Table.from_pylist(list(rows)), temporary)
    else:
        with temporary.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, list(rows[0]))
            writer.writeheader()
            writer.writerows(rows)
    temporary.replace(path)


def simulate_rig(
    protocol: str, out: Path, model: str, rate_hz: float, noise_N: float, repeats: int, seed: int, json: str | None
) -> None:
    """Write a simulated session, with the truth beside it."""
    from daq.simulated import SimulatedCell
    from fingermodel.finger_files import read_finger
    from fingermodel.model_files import read_revision
    from fingermodel.rig import read_protocol, simulate_session

    if not rate_hz > 0 or not noise_N >= 0 or repeats < 1:
        raise InputError(
            f"rate {rate_hz:g} Hz, noise {noise_N:g} N, {repeats} repeats",
            "a rate above 0, noise of 0 or more, 1 or more",
        )
    if (out / "session.yaml").exists():
        raise InputError(f"{out} already holds a session", "a new folder", "Choose another --out")
    finger = read_revision(Path(model)).finger if Path(model).suffix == ".json" else read_finger(model)
    cell = SimulatedCell(rate_hz=rate_hz, noise_sd=(noise_N,) * 3 + (noise_N * 7.0,) * 3)
    with progress("Simulating"):
        session, truth = simulate_session(
            finger, read_protocol(protocol), out, cell=cell, seed=seed, session_id=out.resolve().name, repeats=repeats,
            finger_name=None if Path(model).suffix != ".json" else finger.document["id"],
        )  # fmt: skip
    wrenches = {name: [round(float(x), 6) for x in wrench] for name, wrench in truth.items()}
    (out / "truth.json").write_text(json_module.dumps({"id": session.id, "wrench_N_Nmm": wrenches}, indent=1) + "\n")
    body = {"session": str(out), "cases": len(session.cases), "rate_hz": rate_hz, "seed": seed}
    if not answer("simulate", body, json):
        say(f"{len(session.cases)} load cases at {rate_hz:g} Hz: {out}   (fingertwin compare {out})")
