"""`fingertwin export` and `fingertwin simulate`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from daq.quoting import quoted
from server.application.exchange import ENDINGS as FINGER_FORMATS
from server.application.exported_files import export_file
from server.application.simulating import simulate_session_at
from server.commands.console import answer, progress, say
from server.commands.exchange import export_finger
from server.figures.comparison_words import counted


def export_source(source: str, file_format: str, out: Path | None, model: str | None, json: str | None) -> None:
    """Write a session's cases, measured and predicted, its readings, a revision's parameters, or a finger."""
    if file_format in FINGER_FORMATS:
        export_finger(source, file_format, out, model, json)
        return
    with progress("Reading and correcting") as tell:
        body: dict[str, Any] = {"source": source} | export_file(source, file_format, out, model, tell)
    if answer("export", body, json):
        return
    rows = f"{counted(body['rows'], 'row')}: " if body["rows"] is not None else ""
    say(f"{rows}{body['file']}")
    if file_format == "supplement":
        kinds = ", ".join(f"{n} {kind}" for kind, n in body["replaced"].items()) or "nothing"
        say(f"Replaced: {kinds}. Names that nothing marks as such stay: read its notes before you publish it.")


def simulate_rig(
    protocol: str, out: Path, model: str, rate_hz: float, noise_N: float, repeats: int, seed: int, json: str | None
) -> None:
    """Write a simulated session, with the truth beside it."""
    with progress("Simulating"):
        session = simulate_session_at(protocol, out, model, rate_hz, noise_N, repeats, seed)
    body = {"session": str(out), "cases": len(session.cases), "rate_hz": rate_hz, "seed": seed}
    if not answer("simulate", body, json):
        say(f"{len(session.cases)} load cases at {rate_hz:g} Hz: {out}   (fingertwin compare {quoted(out)})")
