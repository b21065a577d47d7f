"""`fingertwin next`: the load cases that would best tell the remaining explanations apart."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from daq.audit import note
from server.application.workflow import Bench, open_bench, readings_digest
from server.commands.console import answer, progress, say, table
from server.commands.diagnosis import run_diagnosis
from server.commands.twin import provenance, say_first

if TYPE_CHECKING:
    from fingermodel.diagnosis.diagnose import Diagnosis
    from fingermodel.diagnosis.next_cases.next_cases import Plan


def next_cases(
    session: str, model: str | None, effects: list[str], freeze: bool, out: Path | None, json: str | None
) -> None:
    """Diagnose a session, rank what could be measured next, and freeze what the explanations say of it."""
    from fingermodel.diagnosis.next_cases.next_cases import plan_next

    with progress("Reading and correcting") as tell:
        bench = open_bench(session, model, tell, catalogue=True, effects=effects)
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


def plan_body(bench: Bench, diagnosis: Diagnosis, plan: Plan) -> dict[str, Any]:
    """The answer, without the place of what was frozen."""
    return provenance(bench) | {
        "verdict": diagnosis.verdict.kind,
        "explanations": plan.explanations,
        "next_cases": [c.as_dict() for c in plan.cases],
        "instruments": list(plan.instruments),
        "sentence": plan.text,
    }


def freeze_plan(bench: Bench, plan: Plan, out: Path | None) -> Path:
    """Write the plan's predictions down before the cases are measured."""
    from fingermodel.diagnosis.next_cases.frozen import write_frozen

    document = frozen_plan(bench, plan, readings_digest(bench.measured))
    path = out or Path("models") / f"{bench.measured.session.id}-frozen-{document['sha256'][:8]}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    write_frozen(document, path)
    note(path.parent, "next --freeze", bench.measured.session.id, {"file": path.name, "sha256": document["sha256"]})
    return path


def frozen_plan(bench: Bench, plan: Plan, readings_sha256: str | None) -> dict[str, Any]:
    """Return the document of the plan's predictions.

    Raises:
        ModelError: the plan has no load case.
    """
    from daq.errors import ModelError
    from fingermodel.diagnosis.next_cases.frozen import freeze

    if not plan.cases:
        raise ModelError("there is no load case to freeze", "a plan with at least one", plan.text)
    session = bench.measured.session
    return freeze(plan, session.id, session.specimen.id, bench.loaded.name, readings_sha256, bench.observations.ids)
