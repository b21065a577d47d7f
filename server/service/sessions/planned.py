"""Load cases that somebody proposes to measure next: edits of a session, so that every page and bench sees them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from daq.bench.steps import worded
from daq.sessions import TENDONS
from server.service.sessions.records import Edit, Record, live_edits
from server.service.web.problems import ProblemError, not_found, shortened

# Kind of the edits that propose a case; undoing one takes the proposal back.
PLAN = "plan"
_MOST = 200


def planned_steps(record: Record) -> list[dict[str, Any]]:
    """Return the proposed load cases that are not measured yet, in the order in which they were proposed."""
    out = []
    for edit in _proposals(record):
        body = edit.body
        if _alike(record, body) > body["alike"]:
            continue
        out.append(
            {
                "id": edit.case,
                "text": f"{worded(body['masses_g'])}, {body['posture']}, {body['location']}",
                "state": "proposed",
                "why": body.get("why"),
                "edit": edit.number,
                **{k: body[k] for k in ("posture", "location", "masses_g")},
            }
        )
    return out


def proposal(record: Record, given: Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
    """Return the name of a new proposal, and what is kept of it.

    Args:
        record: of the session.
        given: posture, location, masses_g [g] and why.

    Raises:
        ProblemError: 409 the session has no record, or too many proposals; 422 it could not be measured with it.
    """
    record.require_document()
    known = record.postures_deg
    if given["posture"] not in known:
        raise ProblemError(422, f"posture {shortened(given['posture'])!r}", f"one of {', '.join(known)}"[:500])
    strange = [m for m in given["masses_g"] if m not in TENDONS]
    if strange:
        raise ProblemError(422, f"tendon {shortened(strange[0])!r}", f"one of {' '.join(TENDONS)}")
    if len(planned_steps(record)) >= _MOST:
        raise ProblemError(409, f"{_MOST} proposed load cases", "fewer", "Measure some, or take some back")
    names = {c["id"] for c in record.cases} | {e.case for e in record.edits}
    number = sum(e.kind == PLAN for e in record.edits) + 1
    while (name := f"next-{number}") in names:
        number += 1
    return name, dict(given) | {"alike": _alike(record, given)}


def edit_of(record: Record, name: str) -> int:
    """Return the number of the edit that proposed a case.

    Raises:
        ProblemError: 404 no such proposal is in force.
    """
    for edit in _proposals(record):
        if edit.case == name:
            return edit.number
    raise not_found("proposed load case", name, f"/api/v1/sessions/{record.id}/checklist")


def _proposals(record: Record) -> Sequence[Edit]:
    return [e for e in live_edits(record.edits) if e.kind == PLAN]


def _alike(record: Record, wanted: Mapping[str, Any]) -> int:
    """Count the session's cases with the same load at the same place."""

    def hung(masses: Any) -> dict[str, float]:
        return {str(m): float(g) for m, g in (masses or {}).items() if g}

    return sum(
        c.get("posture") == wanted["posture"]
        and c.get("location") == wanted["location"]
        and hung(c.get("masses_g")) == hung(wanted["masses_g"])
        for c in record.amended_cases
    )
