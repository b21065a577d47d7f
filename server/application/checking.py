"""Usability of a session: its readings, and the demands of its finger."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from daq.checks import check
from daq.errors import InputError
from daq.findings import finding
from daq.sessions import find_session, read_session
from fingermodel.fingers.files import read_finger

if TYPE_CHECKING:
    from daq.checks import CheckReport
    from daq.findings import Finding
    from daq.sessions.models import Session


def check_whole(session: str) -> CheckReport:
    """Check a session and, where its readings are sound, what its finger asks of it.

    Raises:
        InputError: there is no such session.
    """
    find_session(session)
    report = check(session)
    return replace(report, findings=(*model_findings(session), *report.findings)) if report.ok else report


def model_findings(given: str | Session) -> list[Finding]:
    """Return faults that make a sound session unusable for its finger: joints, tendons, budget, a straight posture."""
    from fingermodel.budget import budget_of
    from fingermodel.comparison.observations import require_usable
    from fingermodel.model import Model

    session = read_session(given) if isinstance(given, str) else given
    try:
        finger = read_finger(session.finger, session.folder)
        require_usable(session, finger)
        _ = Model(finger, budget=budget_of(session.budget)).parameters
    except InputError as error:
        return [finding("error", "not_predictable", "session", error.found, error.expected, error.remedy)]
    return []
