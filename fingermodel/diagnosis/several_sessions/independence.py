"""Whether sessions are independent of each other: readings that are there twice, and sessions of one specimen."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

from daq.errors import InputError
from daq.findings import Finding
from daq.measured import MeasuredSession
from daq.sessions import Session


def require_apart(sessions: Sequence[MeasuredSession]) -> None:
    """Refuse sessions that hold the same readings: these would count as often as they are given.

    Raises:
        InputError: two have one id or mostly the same forces, or one is the average of others.
    """
    forces = [{tuple(m.wrench[:3].tolist()) for m in measured.cases} for measured in sessions]
    for (i, a), (k, b) in combinations(enumerate(s.session for s in sessions), 2):
        if a.id == b.id:
            raise InputError(
                f"two sessions are called {a.id}", "an id of its own in each", "Change it in one session.yaml"
            )
        # A copy may leave a case out or amend a window; two recordings agree in no case to the last digit.
        if 2 * len(forces[i] & forces[k]) > min(len(forces[i]), len(forces[k])):
            raise InputError(
                f"{a.id} and {b.id} hold the same forces", "each recording once", f"Leave {a.id} or {b.id} out"
            )
    for mean in (s.session for s in sessions):
        if member := next((s.session.id for s in sessions if s.session.id in mean.mean_of), None):
            raise InputError(
                f"{mean.id} is the average of {member} and others",
                "an average or its members, not both",
                f"Leave {mean.id} out",
            )


def of_one_specimen(sessions: Sequence[Session]) -> list[Finding]:
    """Return a warning for each specimen of which there are several sessions."""
    named: dict[str, list[str]] = {}
    for session in sessions:
        named.setdefault(session.specimen.id, []).append(session.id)
    law = "A shared law counts them as one." if len(named) > 1 else "No law that specimens share is looked for."
    text = "sessions of one specimen, {}: what they share may be its anatomy, which counts in each. {}"
    return [
        Finding("warning", "one_specimen", ", ".join(ids), text.format(specimen, law))
        for specimen, ids in named.items()
        if len(ids) > 1
    ]
