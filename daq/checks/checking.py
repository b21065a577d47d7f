"""Validate a session: its description, its recording, its windows, its tares and its known weights.

Everything that can be found is collected; the first fault stops nothing but what depends on it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from daq.cells import CellSpec, cell_spec
from daq.checks.cases import (
    creep_findings,
    force_findings,
    plateau_findings,
    saturated,
    sign_findings,
    tare_findings,
    tension_findings,
)
from daq.checks.description import session_findings
from daq.checks.recording import RecordingScan, recording_findings, unknown_range
from daq.checks.weights import weight_findings
from daq.checks.windows import overlap_findings, tare_life_findings, window_findings
from daq.errors import InputError, ReadingsError, SessionError
from daq.findings import CheckReport, Finding, finding, report
from daq.measured import MeasuredSession
from daq.recordings.plateaus import Plateau
from daq.recordings.readings import ReadingSource, open_readings
from daq.recordings.windows import Recording, Span, gather
from daq.sessions import find_session, parse_session, session_data
from daq.sessions.models import Session
from daq.signals.corrections import assemble, gathered, windows_of

__all__ = ["CheckReport", "Finding", "begun_scan", "check", "measure_and_check", "warnings_of"]

Progress = Callable[[float], None]


def check(session: Session | str | Path, progress: Progress | None = None) -> CheckReport:
    """Validate a session.

    Args:
        session: as read, or its folder, `session.yaml` or the name of a shipped one.
        progress: is told the share of the recording that has been read.

    Returns:
        everything that was found. Bad input is a finding, not an exception.
    """
    if isinstance(session, Session):
        return _report(session, progress)
    try:
        file = find_session(session)
        data = session_data(file)
    except SessionError as error:
        return report(str(session), [Finding("error", "session", str(session), str(error))], {})
    name = f"{file.parent.name}/{file.name}"
    parsed, faults = parse_session(data, file.parent, name)
    if parsed is not None:
        return _report(parsed, progress)
    findings = [Finding("error", "session", file.name, str(f)) for f in faults]
    facts: dict[str, Any] = {}
    readings = data.get("readings") if isinstance(data, dict) else None
    if isinstance(readings, str) and (file.parent / readings).is_file():
        # The recording can be looked at even where the description is at fault.
        scan, _ = _scan(file.parent / readings, None, None, findings, progress)
        findings += recording_findings(scan, readings, None, None)
        facts["recording"] = scan.facts() if scan.rows else None
    return report(str(data.get("id", file.parent.name)) if isinstance(data, dict) else name, findings, facts)


def measure_and_check(
    session: Session, progress: Progress | None = None
) -> tuple[MeasuredSession, tuple[Finding, ...]]:
    """Correct a session, and check it by the way: its recording is read once.

    Args:
        session: as read from its folder.
        progress: is told the share of the recording that has been read, 0 to 1.

    Returns:
        What `corrections.measure` returns, and what is to be looked at (errors and warnings).

    Raises:
        ReadingsError, SessionError: as `corrections.measure`.
    """
    session = session.amended
    scan = begun_scan(session)
    plateaus, notes = gathered(session, progress, scan.watch)
    measured = assemble(session, plateaus, notes)
    return measured, warnings_of(measured, plateaus, scan)


def begun_scan(session: Session) -> RecordingScan:
    """Return a scan that has still to be shown the session's recording."""
    return RecordingScan.by(_spec(session), _rate_hz(session))


def warnings_of(
    measured: MeasuredSession, plateaus: Mapping[Span, Plateau], scan: RecordingScan | None
) -> tuple[Finding, ...]:
    """Return errors and warnings of a session.

    Args:
        measured: the session.
        plateaus: its reduced windows.
        scan: of its recording; None where it has none.
    """
    session = measured.session.amended
    recording = _of_recording(session, scan or RecordingScan(), plateaus, _spec(session))
    findings = [*_of_description(session), *recording, *_of_measured(measured, {})]
    found = report(session.id, findings, {})
    return (*found.errors, *found.warnings)


def _report(session: Session, progress: Progress | None) -> CheckReport:
    session = session.amended
    findings = _of_description(session)
    facts: dict[str, Any] = {
        "cases": len(session.cases),
        "excluded": sum(c.excluded is not None for c in session.cases),
        "recording": None,
        "tares": None,
        "known_weights": [],
    }
    recording: Recording | None = None
    path = session.readings_path
    if path is not None:
        spec = _spec(session)
        scan, recording = _scan(path, session, spec, findings, progress)
        findings += _of_recording(session, scan, recording.plateaus, spec)
        facts["recording"] = scan.facts() if scan.rows else None
    elif windows_of(session):
        findings.append(finding("error", "readings", "readings", "the folder of the readings is not known"))
    measured = _measured(session, recording, findings)
    if measured is not None:
        findings += _of_measured(measured, facts)
    return report(session.id, findings, facts)


def _of_description(session: Session) -> list[Finding]:
    return [*session_findings(session), *overlap_findings(session), *tare_life_findings(session)]


def _of_recording(
    session: Session, scan: RecordingScan, plateaus: Mapping[Span, Plateau], spec: CellSpec | None
) -> list[Finding]:
    name = Path(session.readings or "readings").name
    apart = bool(plateaus) and not any(saturated(p, spec) for p in plateaus.values())
    return [
        *recording_findings(scan, name, _rate_hz(session), spec, apart=apart),
        *([unknown_range()] if spec is None and scan.rows else []),
        *window_findings(session, scan),
        *plateau_findings(session, plateaus, spec),
    ]


def _of_measured(measured: MeasuredSession, facts: dict[str, Any]) -> list[Finding]:
    """Return findings in tares, signs, forces, friction and known weights; numbers go to `facts`."""
    tares, facts["tares"] = tare_findings(measured)
    weights, facts["known_weights"] = weight_findings(measured.checks)
    cases = [*sign_findings(measured), *force_findings(measured), *tension_findings(measured)]
    return [*creep_findings(measured), *tares, *cases, *weights]


def _spec(session: Session) -> CellSpec | None:
    cell = session.load_cell
    return None if cell is None else cell_spec(cell.model) or cell_spec(f"{cell.model or ''} {cell.calibration or ''}")


def _rate_hz(session: Session | None) -> float | None:
    """Rate of the readings that a session states."""
    return session.load_cell.rate_hz if session is not None and session.load_cell is not None else None


def _scan(
    path: Path, session: Session | None, spec: CellSpec | None, findings: list[Finding], progress: Progress | None
) -> tuple[RecordingScan, Recording]:
    """Stream the recording once, gathering windows and looking at the whole; faults become findings."""
    scan = RecordingScan.by(spec, _rate_hz(session))
    windows = windows_of(session) if session is not None else {}

    def note_fault(error: ReadingsError) -> None:
        where = str(error).split(" [", maxsplit=1)[0] if " lies outside " in str(error) else path.name
        findings.append(Finding("error", _code(error), where, str(error)))

    try:
        source: ReadingSource = open_readings(path)
    except ReadingsError as error:
        note_fault(error)
        return scan, Recording(0, np.nan, np.nan, {})
    findings += [finding("note", "conversion", path.name, c) for c in source.conversions]
    findings += [finding("note", "columns", path.name, n) for n in source.notes]
    return scan, gather(scan.watch(source.blocks()), windows, path.name, progress, note_fault)


def _code(error: ReadingsError) -> str:
    text = str(error)
    for phrase, code in (
        ("lies outside", "window_outside"),
        ("holds", "window_empty"),
        ("time goes from", "time_order"),
        ("lacks column", "missing_column"),
        ("twice", "duplicate_column"),
        ("states no unit", "no_unit"),
        ("not a unit", "unknown_unit"),
        ("torn", "damaged_file"),
    ):
        if phrase in text:
            return code
    return "readings"


def _measured(session: Session, recording: Recording | None, findings: list[Finding]) -> MeasuredSession | None:
    """Correct the cases whose windows could be read; None where none is left."""
    plateaus = recording.plateaus if recording is not None else {}
    cases = tuple(c for c in session.cases if all(w in plateaus for _, w in c.windows()))
    weights = tuple(c for c in session.checks if c.unloaded_s in plateaus and c.loaded_s in plateaus)
    if not cases:
        return None
    try:
        return assemble(session.model_copy(update={"cases": cases, "checks": weights}), plateaus)
    except InputError as error:
        findings.append(Finding("error", "corrections", "cases", str(error)))
        return None
