"""A session's diagnosis and the answer that tells of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from fingermodel.api import diagnose
from fingermodel.diagnosis.answer.answer import answer as body_of
from fingermodel.diagnosis.answer.answer import nulls_beside
from fingermodel.diagnosis.diagnose import Diagnosis
from fingermodel.diagnosis.next_cases.frozen import Confirmation, read_frozen, score
from fingermodel.diagnosis.next_cases.next_cases import name_of, plan_next
from fingermodel.session import Session
from server.application.provenance import provenance
from server.figures import graph_objects as go
from server.figures.effect_on_finger import effect_on_finger
from server.figures.style import NothingToDrawError


def run_diagnosis(bench: Session, thorough: bool = False, tell: Any = None) -> Diagnosis:
    """Diagnose a bench; effects that its model holds already are part of the base model."""
    return diagnose(bench, thorough=thorough, progress=tell).details


def diagnosis_answer(bench: Session, diagnosis: Diagnosis, frozen: Sequence[Mapping[str, Any]] = ()) -> dict[str, Any]:
    """Return the contract's answer.

    Args:
        bench: that was diagnosed.
        diagnosis: of that bench.
        frozen: documents of predictions that were made before the cases were measured.
    """
    body = body_of(diagnosis)
    body["nulls"] = [n.as_dict() for n in diagnosis.nulls]
    body["nulls_beside"] = nulls_beside(diagnosis, bench.loaded.added)
    plan = plan_next(diagnosis)
    body["next_cases"] = [c.as_dict() for c in plan.cases]
    body["next_sentence"] = plan.text
    body["instruments"] = list(plan.instruments)
    scored = confirmation(bench, diagnosis, frozen)
    if scored is not None:
        body["confirmed"] = scored.confirmed
        body["confirmation"] = {"text": scored.text, "cases": list(scored.cases)}
    return provenance(bench) | {"held": list(bench.loaded.added)} | body


def bare_verdict(diagnosis: Diagnosis) -> dict[str, Any]:
    """Return a verdict alone, as it stands beside another one; `text` is what is said of it there."""
    verdict, probability = diagnosis.verdict, min(diagnosis.verdict.probability, 1.0)
    names = f" ({' and '.join(verdict.effects)})" if verdict.effects else ""
    text = f"{verdict.kind.replace('_', ' ')}{names}, probability {probability:.2f}"
    if diagnosis.faults:
        text = f"a fault of the whole session ({diagnosis.faults[0].words}), probability {probability:.2f}"
    elif verdict.kind == "undecided":
        text = "undecided"
    return {"verdict": verdict.kind, "effects": list(verdict.effects), "probability": probability, "text": text}


def frozen_documents(bench: Session, paths: list[Path] | None) -> list[dict[str, Any]]:
    """Read frozen predictions: those given, or those of the session's specimen in `models`."""
    if paths is not None:
        return [read_frozen(path) for path in paths]
    specimen = bench.measured.session.specimen.id
    found = [read_frozen(path) for path in sorted(Path("models").glob("*-frozen-*.json"))]
    return [document for document in found if document["specimen"] == specimen]


def confirmation(bench: Session, diagnosis: Diagnosis, frozen: Sequence[Mapping[str, Any]]) -> Confirmation | None:
    """Hold predictions frozen earlier against what has been measured since; None where there are none."""
    session, best = bench.measured.session.id, name_of(diagnosis.best)
    held = bench.loaded.added
    scores = [score(document, best, session, bench.observations, held) for document in frozen]
    told = [s for s in scores if s.confirmed is not None]
    return (told or scores)[-1] if scores else None


def drawn_effect(bench: Session, body: Mapping[str, Any]) -> go.Figure | None:
    """Draw the finger with what the verdict would add, in the case that it changes most; None where that is nothing."""
    added = body["where_after"]["added"]
    row = next((r for r in body["ranking"] if added and r["candidates"] == added), None)
    if row is None:
        return None
    try:
        return effect_on_finger(bench.at_values(row["fit"]), added)
    except NothingToDrawError:
        return None
