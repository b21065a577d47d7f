"""Provenance of an answer: session, model, corrections, readings, software."""

from __future__ import annotations

import datetime as dt
import hashlib
import json
from collections.abc import Mapping
from importlib.metadata import version
from typing import Any

from daq.findings import warning_line
from daq.sessions.amendments import amended_lines, listed
from fingermodel.session import Session


def provenance(session: Session) -> dict[str, Any]:
    """Say which session, model and corrections an answer came from."""
    measured = session.measured
    return {
        "session": measured.session.id,
        "model": session.loaded.name,
        "residuals_after": session.loaded.fitted,
        "outdated": session.loaded.outdated,
        "measured_sha256": measured.sha256,
        "tension_factor": measured.tension_factor,
        "tension_factor_source": measured.tension_factor_source,
        "budget": session.model.budget.name,
        "judged_in": session.model.finger.judged_in,
        "notes": [*measured.notes, *session.loaded.notes],
        "warnings": [f.as_warning() for f in session.findings],
        "amendments": listed(measured.session),
        "excluded": {c.id: c.excluded for c in measured.session.cases if c.excluded is not None},
    }


def told_first(answer: Mapping[str, Any]) -> list[str]:
    """Say what has to be known before an answer: warnings of the check, and what was amended or left out."""
    amendments = answer.get("amendments") or ()
    told = {row["case"] for row in amendments if "excluded" in row["now"]}
    left_out = {case: why for case, why in (answer.get("excluded") or {}).items() if case not in told}
    return [
        *map(warning_line, answer.get("warnings") or ()),
        *amended_lines(amendments),
        *(f"Left out {case}: {why}" for case, why in left_out.items()),
    ]


def origin_of(session: Session, readings_sha256: str | None) -> dict[str, str | None]:
    """Return what a report says of where its numbers come from: when, by what, of which readings and which model."""
    finger, table = session.model.finger, session.model.parameters
    moved = {name: float(session.theta[i]) for name, i in table.index.items() if session.theta[i] != table.initial[i]}
    content = json.dumps({"finger": finger.document, "parameters": moved}, sort_keys=True, default=str)
    return {
        "session": session.measured.session.id,
        "specimen": session.measured.session.specimen.id,
        "finger": finger.id,
        "model": session.loaded.name,
        "made": dt.datetime.now(dt.UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "software": f"fingertwin {version('fingertwin')}",
        "readings_sha256": readings_sha256,
        "model_sha256": hashlib.sha256(content.encode()).hexdigest(),
    }
