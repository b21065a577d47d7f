"""`fingertwin export` and `fingertwin simulate`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from daq.quoting import counted, quoted
from fingermodel.parameters import with_unit
from server.application.exchange import ENDINGS as FINGER_FORMATS
from server.application.exported_files import export_file
from server.application.simulating import simulate_session_at
from server.commands.console import answer, progress, say
from server.commands.entries import numbers
from server.commands.exchange import export_finger


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
    protocol: str,
    out: Path,
    model: str,
    effect: list[str],
    rate_hz: float,
    noise_N: float,
    repeats: int,
    seed: int,
    json: str | None,
) -> None:
    """Write a simulated session, with the truth beside it."""
    effects = numbers(effect, "--effect", "NAME.PARAMETER=NUMBER, such as hanger_mass.m0=30")
    with progress("Simulating"):
        session, truth = simulate_session_at(protocol, out, model, effects, rate_hz, noise_N, repeats, seed)
    told = {"parameters": truth["parameters"], "left_out": truth["left_out"]}
    body = {"session": str(out), "cases": len(session.cases), "rate_hz": rate_hz, "seed": seed} | told
    if answer("simulate", body, json):
        return
    say(f"{len(session.cases)} load cases at {rate_hz:g} Hz: {out}   (fingertwin compare {quoted(out)})")
    if told["parameters"]:
        acting = [f"{p['name']} {with_unit(format(p['value'], '.3g'), p['unit'])}" for p in told["parameters"]]
        say(f"Effects that act: {', '.join(acting)}.")
    if told["left_out"]:
        say(f"Left out, because the protocol has no place for it: {', '.join(told['left_out'])}.")
