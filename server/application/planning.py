"""The load cases that would best tell explanations apart, and what is predicted of them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from daq.audit import note
from daq.errors import ModelError
from fingermodel.diagnosis.next_cases.frozen import freeze, write_frozen
from fingermodel.session import Session, readings_digest
from server.application.provenance import provenance

if TYPE_CHECKING:
    from fingermodel.diagnosis.diagnose import Diagnosis
    from fingermodel.diagnosis.next_cases.next_cases import Plan


def plan_body(bench: Session, diagnosis: Diagnosis, plan: Plan) -> dict[str, Any]:
    """Return the answer, without the place of what was frozen."""
    return provenance(bench) | {
        "verdict": diagnosis.verdict.kind,
        "explanations": plan.explanations,
        "next_cases": [c.as_dict() for c in plan.cases],
        "instruments": list(plan.instruments),
        "sentence": plan.text,
    }


def freeze_plan(bench: Session, plan: Plan, out: Path | None) -> Path:
    """Write the plan's predictions down before the cases are measured."""
    document = frozen_plan(bench, plan, readings_digest(bench.measured))
    path = out or Path("models") / f"{bench.measured.session.id}-frozen-{document['sha256'][:8]}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    write_frozen(document, path)
    note(path.parent, "next --freeze", bench.measured.session.id, {"file": path.name, "sha256": document["sha256"]})
    return path


def frozen_plan(bench: Session, plan: Plan, readings_sha256: str | None) -> dict[str, Any]:
    """Return the document of the plan's predictions.

    Raises:
        ModelError: the plan has no load case.
    """
    if not plan.cases:
        raise ModelError("there is no load case to freeze", "a plan with at least one", plan.text)
    session, loaded = bench.measured.session, bench.loaded
    known = bench.observations.ids
    return freeze(plan, session.id, session.specimen.id, loaded.name, readings_sha256, known, loaded.added)
