"""Recordings and a notebook that were sent: looked at, laid onto each other, made a session.

Every step is sent the files again. So the service holds nothing for somebody who goes away in between.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from daq.checks import measure_and_check
from daq.documents import validated
from daq.errors import InputError, ReadingsError
from daq.lab.drafts import Choice, Joined, is_readings_file, joined, still_missing
from daq.lab.files import AXES, WANTED, Increment, LabFileMap, Taken
from daq.lab.names import stated_unit
from daq.lab.notebook import Note
from daq.lab.opened import NOT_FOR_A_SERVICE, OLD_EXCEL, open_channels
from daq.lab.proposals import Ground, ground_of, grounds, propose_channels, propose_mapping
from daq.lab.traces import read_traces, traces_of
from daq.recordings.readings import first_bytes
from daq.sessions import read_session, read_yaml
from daq.sessions.models import Session as BenchSession
from daq.units import COMMON
from fingermodel.fingers.files import read_finger
from fingermodel.session import Session
from server.application.new_session import (
    MASSES_IN_GRAMS,
    LaidNotes,
    document_of,
    lay_notes,
    levels_of,
    notes_of,
    said,
    session_of,
    suspects,
    write_new,
)
from server.figures.traces import traces_figure
from server.service.figures.answer import Theme, on_page, shown
from server.service.figures.fingers import known_finger
from server.service.schemas.recordings import NewFromRecordings
from server.service.services import Services
from server.service.uploads.importing import (
    MOST_ROWS,
    keep_session,
    require_plain,
    require_unpacked,
    too_large,
    write_files,
)
from server.service.web.problems import ProblemError, shortened
from server.service.web.workers import require_client

SCHEMA = "fingertwin/recordings/1"
# Of a recording unpacked, whose text becomes up to four times as many bytes of numbers.
MOST_UNPACKED = 1 << 27
_MAPPINGS, _CALIBRATIONS = (".yaml", ".yml"), (".cal",)
Sent = Sequence[tuple[str, str]]


@dataclass(frozen=True)
class Held:
    """Files that were sent, for as long as they are looked at."""

    folder: Path  # in which they lie
    recordings: tuple[Path, ...]  # in the order in which they were sent
    mapping: LabFileMap | None  # which channel is which, sent with them or in the request; None where there is none yet

    @property
    def foreign(self) -> Path | None:
        """The first recording that needs a mapping; None where every one is a readings file."""
        return next((path for path in self.recordings if not is_readings_file(path)), None)


@contextmanager
def held(files: Sent, mapping: Mapping[str, Any] | None) -> Iterator[Held]:
    """Lay files into a folder of their own.

    Raises:
        InputError: the mapping is none.
        ProblemError: 413 they are too large unpacked; 422 a name that cannot be, or no recording among them.
    """
    with TemporaryDirectory(prefix="fingertwin-", ignore_cleanup_errors=True) as temporary:
        folder = Path(temporary)
        write_files(folder, files)
        paths = [folder / name for name, _ in files]
        recordings = tuple(p for p in paths if p.suffix.lower() not in (*_MAPPINGS, *_CALIBRATIONS))
        if not recordings:
            raise ProblemError(422, "no recording among the files", "CSV, TDMS, LVM, Parquet, Excel or readings")
        for path in recordings:
            start = first_bytes(path, 32, "a recording")
            if start.startswith(NOT_FOR_A_SERVICE):
                kind = "an .xls" if start.startswith(OLD_EXCEL) else "an HDF5 or C3D"
                raise ProblemError(
                    422,
                    f"{path.name} is {kind} file, which a service does not open",
                    "CSV, TDMS, LVM, Parquet, Excel (.xlsx) or readings",
                    "Make the session on the command line: fingertwin new RECORDING… --out DIR",
                )
            require_unpacked(path, MOST_UNPACKED)
        raw: Any = mapping
        if mapping is None:
            sent = [p for p in paths if p.suffix.lower() in _MAPPINGS]
            raw = read_yaml(sent[0], sent[0].name) if sent else None
            require_plain(raw, sent[0].name if sent else "")
        known = None if raw is None else validated(LabFileMap, raw, "the mapping", WANTED, ReadingsError)
        yield Held(folder, recordings, _within(known, folder, {p.name for p in paths}))


def _within(mapping: LabFileMap | None, folder: Path, names: set[str]) -> LabFileMap | None:
    """Return the mapping with its calibration among the files: nothing outside of the folder is looked at."""
    if mapping is None or mapping.calibration is None:
        return mapping
    name = mapping.calibration
    if name not in names:
        raise ProblemError(
            422, f"the calibration {shortened(name)}, which is not among the files", "the cell's .cal beside them"
        )
    return mapping.model_copy(update={"calibration": str(folder / name)})


def look(files: Sent, mapping: Mapping[str, Any] | None, theme: Theme) -> dict[str, Any]:
    """Return the contents of recordings, and the proposed mapping of channels.

    Raises:
        InputError: one cannot be read, or the mapping does not fit.
        ProblemError: the files cannot be taken.
    """
    with held(files, mapping) as given:
        rows = []
        for path in given.recordings:
            require_client()
            traces = read_traces(path)
            figure = shown(path.name, traces_figure(traces, path.name), "", {"theme": theme})
            channels = [{"name": c.name, "unit": stated_unit(c) or None} for c in open_channels(path).channels]
            rows.append(
                {
                    "name": path.name,
                    "readings": traces.readings,
                    "plateaus": len(traces.plateaus),
                    "time_unit": traces.unit,
                }
                | {"channels": channels, "recording_notes": list(traces.notes), "figure": on_page(figure, theme)}
            )
        proposed = None if given.foreign is None else _proposed(given.foreign, given)
        units = {kind: list(COMMON[kind]) for kind in ("time", "force", "torque", "voltage")}
        return {"schema": SCHEMA, "recordings": rows, "proposal": proposed, "units": units}


def _proposed(path: Path, given: Held) -> dict[str, Any]:
    """Return a mapping, line by line with how sure each is; of a saved one what it says."""
    saved = given.mapping
    if saved is None:
        calibration = next((p for p in sorted(given.folder.iterdir()) if p.suffix.lower() in _CALIBRATIONS), None)
        try:
            found = propose_mapping(path, None if calibration is None else str(calibration))
        except ReadingsError as error:
            # Nothing tells which is which, or when: whoever knows says it by hand.
            return {"mapping": None, "lines": _partly(path), "doubts": [str(error)], "saved": False}
    else:
        found = saved
        for taken in found.channels.values():
            open_channels(path).readable(taken.channel)
    rests = grounds(path, found)
    if saved is not None and saved.confirmed:
        rests = dict.fromkeys(rests, Ground(1.0, "as the saved mapping says"))
    places: dict[str, Taken | Increment] = {"t": found.time, **found.channels}
    lines = [_line_of(key, place, rests[key]) for key, place in places.items()]
    return {"mapping": _plain(found), "lines": lines, "doubts": list(found.doubts), "saved": saved is not None}


def _partly(path: Path) -> list[dict[str, Any]]:
    """Return the known lines of a mapping that cannot be proposed in full."""
    source = open_channels(path)
    channels = propose_channels(source, []) or {}
    lines = [_line_of("t", None, Ground(0.0, "no channel is a time, and no step is stated"))]
    if not channels:
        return lines + [_line_of(key, None, Ground(0.0, "the names and units tell nothing")) for key in AXES]
    return lines + [_line_of(key, taken, ground_of(source, key, taken)) for key, taken in channels.items()]


def _line_of(key: str, place: Taken | Increment | None, ground: Ground) -> dict[str, Any]:
    known = {} if place is None else place.model_dump()
    line = {"is": key, "channel": None, "unit": None, "increment_s": None} | known
    return line | {"sure": ground.sure, "why": ground.why}


def _plain(mapping: LabFileMap) -> dict[str, Any]:
    """Return a mapping as it is sent and saved: its calibration by name."""
    plain = mapping.model_dump(mode="json", exclude_none=True)
    if mapping.calibration is not None:
        plain["calibration"] = Path(mapping.calibration).name
    return plain


def lay(files: Sent, mapping: Mapping[str, Any] | None, notes: str, finger: str, theme: Theme) -> dict[str, Any]:
    """Return plateaus of recordings in newtons, and what each is taken for by a notebook.

    Args:
        files: that were sent.
        mapping: confirmed, of those that are no readings files.
        notes: the notebook; nothing where there is none yet.
        finger: whose tendons it names.
        theme: of the page.

    Raises:
        InputError: a recording, the mapping or the notebook cannot be used.
        ProblemError: the files or the finger cannot be taken.
    """
    tendons = read_finger(known_finger(finger)).topology.muscles
    lines = notes_of(notes, tendons) if notes.strip() else ()
    with held(files, mapping) as given, _joined(given) as readings:
        laid = lay_notes(levels_of(readings), lines)
        traces = traces_of(readings, [level.window_s for level in laid.levels])
        figure = traces_figure(traces, "Plateaus", "each in the colour of what it is taken for")
        drawn = shown("plateaus", figure, "", {"theme": theme})
        rows = _rows(laid, lines)
        body: dict[str, Any] = {"schema": SCHEMA, "tendons": list(tendons), "plateaus": rows}
        body |= {"lines": [_line(note) for note in lines], "lost": laid.lost}
        return body | {"laid_notes": [*readings.notes, MASSES_IN_GRAMS], "figure": on_page(drawn, theme)}


def _joined(given: Held) -> AbstractContextManager[Joined]:
    if given.mapping is None and given.foreign is not None:
        raise InputError(f"which channel of {given.foreign.name} is which is not known", "a mapping")

    def seen(rows: int) -> None:
        require_client()
        if rows > MOST_ROWS:
            raise too_large(f"more than {MOST_ROWS} rows", MOST_UNPACKED)

    return joined(given.recordings, given.mapping, seen)


def _rows(laid: LaidNotes, lines: Sequence[Note]) -> list[dict[str, Any]]:
    rows, tare = [], None
    for level, choice in zip(laid.levels, laid.choices, strict=True):
        mean = level.plateau.mean
        if choice.kind == "tare":
            tare = mean
        change = None if tare is None or choice.kind != "load" else float(np.linalg.norm((mean - tare)[:3]))
        at = next((i for i, note in enumerate(lines) if note is choice.note), None)
        rows.append(
            {"window_s": list(level.window_s), "mean_N": mean[:3].tolist(), "change_N": change, "kind": choice.kind}
            | {"line": at, "sure": choice.sure, "steady": level.plateau.steady}
        )
    return rows


def _line(note: Note) -> dict[str, Any]:
    return vars(note) | {"said": said(note), "masses_g": dict(note.masses_g)}


def draft(body: NewFromRecordings) -> dict[str, Any]:
    """Return the faults of a draft session, the gaps for a diagnosis, and cases that resemble another load.

    Raises:
        InputError: it cannot be used.
        ProblemError: the files cannot be taken.
    """

    def judged(session: BenchSession, document: Mapping[str, Any]) -> dict[str, Any]:
        measured, findings = measure_and_check(session)
        told: dict[str, Any] = {
            "schema": SCHEMA,
            "cases": len(document["cases"]),
            "findings": [{"level": f.level, "where": f.where, "text": f.text} for f in findings],
            "missing": still_missing(document),
        }
        try:
            found = suspects(Session.of(measured, catalogue=False))
        except InputError as error:
            return told | {"looked_at": str(error), "suspects": []}
        return told | {"looked_at": None, "suspects": [vars(s) for s in found]}

    return _made(body, judged)


def keep(parts: Services, body: NewFromRecordings) -> tuple[str, bool]:
    """Make the session and keep it; what it returns and raises as of `import_folder`."""
    return _made(body, lambda session, _: keep_session(parts, session, None))


def _made(body: NewFromRecordings, use: Callable[[BenchSession, Mapping[str, Any]], Any]) -> Any:
    finger = known_finger(body.header.finger)
    with held(body.sent, body.mapping) as given, _joined(given) as readings:
        laid = LaidNotes(levels_of(readings), _choices(body), [])
        if len(laid.levels) != len(laid.choices):
            raise ProblemError(
                422,
                f"{len(laid.choices)} choices for {len(laid.levels)} plateaus",
                "one for each plateau",
                "Lay the notebook onto the plateaus again",
            )
        provenance: dict[str, Any] = {"made_by": "fingertwin, in the browser"}
        provenance["recordings"] = [path.name for path in given.recordings]
        if given.mapping is not None:
            provenance["mapping"] = _plain(given.mapping)
        header = body.header.model_dump(exclude_none=True) | {"finger": finger}
        document = document_of(body.id, header, body.postures_deg, laid, provenance)
        folder = given.folder / "made"
        # The mapping is kept with the session's provenance: a folder's would name a file that is gone.
        write_new(folder, session_of(document), readings, None)
        return use(read_session(folder), document)


def _choices(body: NewFromRecordings) -> list[Choice]:
    out = []
    for line, choice in enumerate(body.choices, 1):
        note = None
        if choice.kind == "load":
            masses = tuple(choice.masses_g.items())
            given = choice.model_dump(exclude={"kind", "masses_g"})
            note = Note("load", line, masses, **given)
        out.append(Choice(choice.kind, note, 1.0))
    return out
