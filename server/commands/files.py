"""`fingertwin export` and `fingertwin simulate`."""

from __future__ import annotations

import json as json_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from daq.errors import InputError
from server.console import answer, progress, say
from server.workflow import compare_bench, open_bench

if TYPE_CHECKING:
    from fingermodel.compare import Comparison


def export_source(source: str, file_format: str, out: Path | None, model: str | None, json: str | None) -> None:
    """Write a session's cases, measured and predicted, or a revision's parameters, as CSV or Parquet."""
    from daq.export import case_columns, write_columns

    if out is not None and out.suffix.lower() in (".csv", ".parquet") and out.suffix.lower() != f".{file_format}":
        raise InputError(f"--format {file_format} and {out.name}", "one of the two", "Let name and format agree")
    columns: dict[str, list[Any]]
    if Path(source).suffix == ".json" and Path(source).is_file():
        from fingermodel.model_files import read_revision

        if model is not None:
            raise InputError(f"--model {model} with a model to export", "no --model", "Leave it out")
        revision = read_revision(Path(source))
        name, rows = revision.id, revision.document["parameters"]
        columns = {key: [row[key] for row in rows] for key in rows[0]} if rows else {}
    else:
        with progress("Reading and correcting") as tell:
            bench = open_bench(source, model, tell)
        name = bench.measured.session.id
        columns = {**case_columns(bench.measured), **_predicted_columns(compare_bench(bench))}
        columns["model"] = [bench.loaded.name] * len(columns["id"])
    path = out or Path(f"{Path(name).name or 'export'}.{file_format}")
    write_columns(columns, path, file_format)
    count = len(next(iter(columns.values())))
    if not answer("export", {"source": source, "file": str(path), "rows": count}, json):
        say(f"{count} rows: {path}")


def _predicted_columns(comparison: Comparison) -> dict[str, list[Any]]:
    """Predicted force and tip moment, force residual and z of every case, in the measured cases' order."""
    columns: dict[str, list[Any]] = {}
    for i, axis in enumerate("xyz"):
        columns[f"predicted_F{axis}_N"] = [float(c.predicted_N[i]) for c in comparison.cases]
        columns[f"residual_F{axis}_N"] = [float(c.measured_N[i] - c.predicted_N[i]) for c in comparison.cases]
        columns[f"predicted_T{axis}_Nmm"] = [
            None if c.predicted_Nmm is None else float(c.predicted_Nmm[i]) for c in comparison.cases
        ]
    return columns | {"z": [c.z for c in comparison.cases]}


def simulate_rig(
    protocol: str, out: Path, model: str, rate_hz: float, noise_N: float, repeats: int, seed: int, json: str | None
) -> None:
    """Write a simulated session, with the truth beside it."""
    from daq.protocols import read_protocol
    from daq.simulated import SimulatedCell
    from fingermodel.finger_files import read_finger
    from fingermodel.model_files import read_revision
    from fingermodel.rig import simulate_session

    if not 0 < rate_hz <= 1e6 or not 0 <= noise_N <= 1e3 or repeats < 1 or seed < 0:
        raise InputError(
            f"rate {rate_hz:g} Hz, noise {noise_N:g} N, {repeats} repeats, seed {seed}",
            "a rate above 0 and up to 1e6, noise of 0 to 1000, 1 repeat or more, a seed of 0 or more",
        )
    if out.is_dir() and any(out.iterdir()):
        raise InputError(f"{out} is not empty", "a new folder", "Choose another --out")
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
