"""`fingertwin next`: the load cases that would best tell the remaining explanations apart."""

from __future__ import annotations

from pathlib import Path

from daq.files import require_writable
from fingermodel.diagnosis.next_cases.next_cases import plan_next
from fingermodel.session import Session
from server.application.diagnosing import run_diagnosis
from server.application.planning import freeze_plan, plan_body
from server.commands.console import answer, progress, say, table
from server.commands.twin import say_first


def next_cases(
    session: str, model: str | None, effects: list[str], freeze: bool, out: Path | None, json: str | None
) -> None:
    """Diagnose a session, rank what could be measured next, and freeze what the explanations say of it."""
    if freeze:
        require_writable(out or Path("models"), folder=out is None)
    with progress("Reading and correcting") as tell:
        bench = Session.open(session, model, progress=tell, effects=effects)
    with progress("Fitting every effect") as tell:
        diagnosis = run_diagnosis(bench, False, tell)
    with progress("Weighing load cases"):
        plan = plan_next(diagnosis)
    path = freeze_plan(bench, plan, out) if freeze else None
    body = plan_body(bench, diagnosis, plan) | {"frozen": str(path) if path else None}
    if answer("next", body, json):
        return
    say_first(body)
    say(plan.text)
    table(
        "Explanations held against each other",
        ["explanation", "weight"],
        [[name, p] for name, p in plan.explanations.items()],
    )
    if plan.cases:
        rows = [
            [
                c.case.posture,
                c.case.location,
                " ".join(f"{m} {g:g}" for m, g in c.case.masses_g.items()),
                c.information_nat,
                c.expected_probability,
                " / ".join(c.separates),
            ]
            for c in plan.cases
        ]
        table("Load cases worth running", ["posture", "at", "masses [g]", "nat", "then sure", "parts"], rows)
        for instrument in plan.instruments:
            say(f"Or: {instrument}")
    if path:
        say(f"Frozen: {path}. Measure the cases with the posture set anew, then run fingertwin diagnose again.")
