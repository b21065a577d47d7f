"""Amendments: what a load case really was, kept beside the session; what was entered stays as it is.

They lie in `amendments.yaml` in the session's folder, or under `amendments` in a copy of its description.
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import yaml

from daq.errors import InputError, SessionError
from daq.files import replacing
from daq.sessions import AMENDMENTS_FILE, AMENDMENTS_FORMAT
from daq.sessions.models import Amendment, LoadCase, Session
from daq.vocabulary import TENDONS, did_you_mean


def amendment(
    session: Session,
    case: str,
    why: str,
    *,
    tendons: Mapping[str, str] | None = None,
    masses_g: Mapping[str, float] | None = None,
    posture: str | None = None,
    exclude: bool = False,
    by: str | None = None,
) -> Amendment:
    """Say what a case really was.

    Args:
        session: as read; earlier amendments of the case are heeded.
        case: its id.
        why: how it is known.
        tendons: the tendon that bore the weight, by the one that was entered; two that both bore one are exchanged.
        masses_g: what really hung [g], by tendon; 0 for nothing. Other tendons keep what was entered.
        posture: that was really set.
        exclude: whether to leave the case out.
        by: who says so.

    Raises:
        SessionError: no such case, tendon or posture, or nothing that changes.
    """
    entry = case_of(session.amended, case)
    if not why.strip():
        raise SessionError("an amendment without a reason", "why, in some words")
    masses = dict(entry.masses_g)
    for entered, true in (tendons or {}).items():
        masses = _moved(masses, entered, true, case)
    for tendon, grams in (masses_g or {}).items():
        masses[tendon] = float(grams)
    masses = {tendon: grams for tendon, grams in masses.items() if grams > 0.0}
    for tendon in masses:
        if tendon not in TENDONS:
            hint = did_you_mean(tendon, TENDONS)
            raise SessionError(f"tendon {tendon!r}", f"one of {' '.join(TENDONS)}", hint)
    if posture is not None and posture not in session.postures_deg:
        hint = did_you_mean(posture, session.postures_deg)
        raise SessionError(f"posture {posture!r}", f"one of {' '.join(session.postures_deg)}", hint)
    changes: dict[str, Any] = {}
    if masses != entry.masses_g:
        changes["masses_g"] = masses
    if posture is not None and posture != entry.posture:
        changes["posture"] = posture
    if exclude and entry.excluded is None:
        changes["excluded"] = why
    if not changes:
        raise SessionError(f"case {case} is so already", "something that differs from what is entered")
    at = datetime.now(UTC).isoformat(timespec="seconds")
    return Amendment(case=case, why=why, at=at, by=by, **changes)


def exchanged(session: Session, case: str, other: str, why: str, by: str | None = None) -> tuple[Amendment, Amendment]:
    """Say that two cases were entered in each other's place: their weights and postures."""
    a, b = case_of(session.amended, case), case_of(session.amended, other)
    if (a.masses_g, a.posture) == (b.masses_g, b.posture):
        raise SessionError(f"cases {case} and {other} have the same entry", "two that differ")
    at = datetime.now(UTC).isoformat(timespec="seconds")
    pair = ((case, b, other), (other, a, case))
    first, second = (
        Amendment(
            case=one, masses_g=dict(to.masses_g), posture=to.posture, why=f"exchanged with {of}: {why}", at=at, by=by
        )
        for one, to, of in pair
    )
    return first, second


def case_of(session: Session, name: str) -> LoadCase:
    """Return a load case by its id.

    Raises:
        SessionError: there is none.
    """
    for case in session.cases:
        if case.id == name:
            return case
    hint = did_you_mean(name, [c.id for c in session.cases])
    raise SessionError(f"no case {name} in {session.id}", "the id of a load case", hint)


def write_amendments(folder: Path, amendments: tuple[Amendment, ...]) -> Path:
    """Write the amendments of the session in a folder; without any, the file goes.

    Raises:
        InputError: the folder cannot be written to.
    """
    file = folder / AMENDMENTS_FILE
    try:
        if not amendments:
            file.unlink(missing_ok=True)
            return file
        listed = [a.model_dump(mode="json", exclude_none=True) for a in amendments]
        with replacing(file) as temporary:
            temporary.write_text(
                yaml.safe_dump(
                    {"format": AMENDMENTS_FORMAT, "amendments": listed}, sort_keys=False, allow_unicode=True
                ),
                encoding="utf-8",
            )
    except OSError as error:
        raise InputError(f"{file} cannot be written ({error.strerror})", "a folder that may be written to") from error
    return file


def listed(session: Session) -> list[dict[str, Any]]:
    """Return the amendments with the original entries, for answers, exports and pages."""
    entries = {c.id: c for c in session.entered.cases}
    return [
        {
            "case": a.case,
            "words": words(a),
            "why": a.why,
            "at": a.at,
            "by": a.by,
            "entered": {name: getattr(entries[a.case], name) for name in a.changes},
            "now": a.changes,
        }
        for a in session.amendments
    ]


def words(amended: Amendment) -> str:
    """Describe the load that a case is taken for."""
    parts = []
    if amended.masses_g is not None:
        hung = " and ".join(f"{tendon} {grams:g} g" for tendon, grams in amended.masses_g.items())
        parts.append(f"{hung or 'no weight'} hung")
    if amended.posture is not None:
        parts.append(f"the posture was {amended.posture}")
    if amended.excluded is not None:
        parts.append("left out")
    return ", ".join(parts)


def _moved(masses: Mapping[str, float], entered: str, true: str, case: str) -> dict[str, float]:
    """Return masses with one tendon's weight on another; where both bore one, exchanged."""
    if entered not in masses:
        found = " and ".join(masses) or "no tendon"
        raise SessionError(f"case {case} loads {found}, not {entered}", "the tendon that was entered")
    exchange = {entered: true, true: entered} if true in masses else {entered: true}
    return {exchange.get(tendon, tendon): grams for tendon, grams in masses.items()}
