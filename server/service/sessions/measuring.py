"""Measured forces of a session's load cases, as far as their readings are there."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np

from daq.checks import RecordingScan, begun_scan, warnings_of
from daq.errors import InputError, OutsideError, SessionError
from daq.findings import Finding
from daq.measured import MeasuredSession
from daq.recordings.plateaus import Plateau
from daq.recordings.windows import Span
from daq.sessions.models import LoadCase, Session, TensionEstimate
from daq.signals.corrections import assemble, windows_of
from daq.signals.tension_estimate import PUBLISHED_TENSION_FACTOR
from server.service.ingest.windows import Reduced, Windows
from server.service.sessions.records import Record
from server.service.sessions.sessions import Sessions
from server.service.sessions.turns import Turns

State = Literal["measured", "waiting", "failed", "excluded"]
_MOST_CACHED = 64


@dataclass(frozen=True)
class CaseState:
    """Progress of a load case."""

    state: State  # measured, waiting for readings, failed, or excluded
    why: str = ""  # in words, where it is not measured, or not bracketed by its second tare yet


@dataclass(frozen=True, eq=False)
class Measured:
    """A session with what is measured of it."""

    record: Record  # the session as it stands
    session: Session | None  # with its measured cases alone; None where there is none
    # Their forces; None where there are none, or `problem` says why they cannot be put together.
    measured: MeasuredSession | None
    plateaus: Mapping[Span, Plateau]  # reduced windows of those cases
    states: Mapping[str, CaseState]  # of every case
    problem: InputError | None = None  # what stands in the way of all of them
    scan: RecordingScan | None = None  # of the recording, as far as it had come; None where no window is measured

    @property
    def key(self) -> tuple[Any, ...]:
        """Tells one state of a session from every other; how far the readings of a case are makes no difference."""
        settled = tuple((i, s.state, bool(s.why)) for i, s in self.states.items() if s.state != "waiting")
        return self.record.id, self.record.version, self.record.stream, settled

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """Warnings of the check, as far as the session is measured."""
        return () if self.measured is None else warnings_of(self.measured, self.plateaus, self.scan)

    @property
    def excluded(self) -> dict[str, str]:
        """Cases that are left out, and why."""
        return {i: s.why for i, s in self.states.items() if s.state == "excluded"}

    @property
    def waits(self) -> bool:
        """True if readings are still to come."""
        return any(s.state == "waiting" or (s.state == "measured" and s.why) for s in self.states.values())

    def require(self) -> MeasuredSession:
        """Return the measured forces.

        Raises:
            InputError: there are none.
        """
        if self.problem is not None:
            raise self.problem
        if self.measured is None:
            counts = {s: sum(c.state == s for c in self.states.values()) for s in ("waiting", "failed", "excluded")}
            told = ", ".join(f"{n} {s}" for s, n in counts.items() if n) or "there is none"
            first = next((f": {i} {s.why}" for i, s in self.states.items() if s.why), "")
            raise SessionError(f"session {self.record.id} has no measured load case ({told}{first})", "at least one")
        return self.measured

    def force(self, name: str) -> dict[str, Any] | None:
        """Return measured force [N] and moment [N mm] of a case with standard uncertainties; None where it has none."""
        index = self._places.get(name)
        if self.measured is None or index is None:
            return None
        case, sd = self.measured.cases[index], np.sqrt(np.diag(self.measured.case_covariance(index)))
        return {
            "measured_N": case.wrench[:3].tolist(),
            "measured_sd_N": sd[:3].tolist(),
            "measured_Nmm": case.wrench[3:].tolist() if case.has_torque else None,
            "steady": case.steady,
        }

    @cached_property
    def _places(self) -> dict[str, int]:
        cases = () if self.measured is None else self.measured.cases
        return {case.case.id: index for index, case in enumerate(cases)}


class Measuring:
    """Measures sessions, each state of one once.

    Args:
        sessions: that are kept.
        windows: reduces their windows.
    """

    def __init__(self, sessions: Sessions, windows: Windows) -> None:
        self._sessions, self._windows = sessions, windows
        self._known: OrderedDict[str, Measured] = OrderedDict()
        self._lock, self._turns = threading.Lock(), Turns()

    def of(self, name: str) -> Measured:
        """Return what is measured of a session.

        Raises:
            ProblemError: 404 there is none.
        """
        found = self._present(name)
        if found is not None and not found.waits:
            return found
        with self._turns.of(name):
            return self._anew(name)

    def _present(self, name: str) -> Measured | None:
        """Return what was measured of a session as it stands; None where it has changed since."""
        version = self._sessions.version(name)
        with self._lock:
            found = self._known.get(name)
        return found if found is not None and found.record.version == version else None

    def _anew(self, name: str) -> Measured:
        """Measure a session, unless somebody has while its turn was awaited."""
        found = self._present(name)
        if found is not None and not found.waits:
            return found
        out = self._measure(self._sessions.read(name) if found is None else found.record)
        if found is not None and out.key == found.key:
            # The same forces; only what the rest waits for may read otherwise by now.
            out = replace(found, states=out.states)
        with self._lock:
            self._known[name] = out
            self._known.move_to_end(name)
            while len(self._known) > _MOST_CACHED:
                self._known.popitem(last=False)
        return out

    def _measure(self, record: Record) -> Measured:
        try:
            whole = record.session()
        except InputError as error:
            return Measured(record, None, None, {}, {}, error)
        if record.stream is None and self._sessions.streams(record.id):
            record = self._sessions.read(record.id)
        reduced = self._windows.reduce(record.id, record.stream, windows_of(whole.amended))
        states = {c.id: _state(c, reduced) for c in whole.amended.cases}
        done = tuple(_bracketed(c, reduced) for c in whole.cases if states[c.id].state == "measured")
        checks = tuple(w for w in whole.checks if {w.unloaded_s, w.loaded_s} <= set(reduced.plateaus))
        if not done:
            return Measured(record, None, None, {}, states)
        names = {c.id for c in done}
        amendments = tuple(a for a in whole.amendments if a.case in names)
        session = whole.model_copy(update={"cases": done, "checks": checks, "amendments": amendments})
        used = {w: reduced.plateaus[w] for w in windows_of(session.amended)}
        try:
            measured = _assembled(session, used)
        except InputError as error:
            return Measured(record, session, None, used, states, error)
        # Readings that are to come would be waited for; this one never comes.
        wanted = windows_of(whole.amended)
        outside = next((e for w, e in reduced.failed.items() if w in wanted and isinstance(e, OutsideError)), None)
        scan = self._windows.scan(record.id, record.stream, begun_scan(session)) if record.stream and used else None
        return Measured(record, measured.session, measured, used, states, outside, scan)


def _state(case: LoadCase, reduced: Reduced) -> CaseState:
    if case.excluded is not None:
        return CaseState("excluded", case.excluded)
    mine = [w for _, w in case.windows()]
    if _tare_to_come(case, reduced):
        return CaseState("measured", f"the tare after it is to come: {reduced.waiting[mine[-1]]}")
    for window in mine:
        if window in reduced.failed:
            return CaseState("failed", str(reduced.failed[window]))
    for window in mine:
        if window in reduced.waiting:
            return CaseState("waiting", reduced.waiting[window])
    return CaseState("measured")


def _tare_to_come(case: LoadCase, reduced: Reduced) -> bool:
    """Return whether a case lacks nothing but its second tare, without which it has a force all the same."""
    after = case.unloaded_after_s
    return after in reduced.waiting and {case.unloaded_s, case.loaded_s} <= set(reduced.plateaus)


def _bracketed(case: LoadCase, reduced: Reduced) -> LoadCase:
    return case.model_copy(update={"unloaded_after_s": None}) if _tare_to_come(case, reduced) else case


def _assembled(session: Session, plateaus: Mapping[Span, Plateau]) -> MeasuredSession:
    """Assemble the forces; take the published tension factor, and say so, where it cannot be estimated yet."""
    try:
        return assemble(session, plateaus)
    except SessionError as error:
        if not isinstance(session.tension_factor, TensionEstimate):
            raise
        note = f"tension factor {PUBLISHED_TENSION_FACTOR} as published, since {error.found}"
        stated = session.model_copy(update={"tension_factor": PUBLISHED_TENSION_FACTOR})
        return assemble(stated, plateaus, (note,))
