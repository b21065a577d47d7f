"""A new session of a lab's recordings and notebook: what the command line and the browser make it with."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from daq.errors import InputError
from daq.files import replacing
from daq.lab.drafts import Choice, cases_of, chosen
from daq.lab.files import LabFileMap, write_mapping
from daq.lab.layout import lay
from daq.lab.levels import Level, find_levels
from daq.lab.notebook import Note, read_notes
from daq.recordings.readings import ReadingBlock, write_readings
from daq.sessions import parse_session, write_session
from daq.sessions.models import Session as BenchSession
from daq.vocabulary import did_you_mean

if TYPE_CHECKING:
    from fingermodel.session import Session

READINGS, MAPPING, SESSION = "readings.parquet", "map.yaml", "session.yaml"
HEADER = ("specimen", "finger", "tension_factor", "load_cell", "gravity_m_s2", "environment", "budget")
REQUIRED = ("specimen", "finger", "tension_factor")
# A choice that is less sure is to be looked at.
SURE = 0.8
MASSES_IN_GRAMS = "masses in the notebook are grams where it states no unit"
# A reading looks like another load where that one leaves so much less of it unexplained, and its own so much.
_OFF, _BETTER = 0.6, 0.4
# Of cases and what they may rather be: so many are worked out at once.
_PAIRS = 1 << 12


@dataclass(frozen=True)
class LaidNotes:
    """Plateaus, what each is taken for, and sentences on loads that were found on none and plateaus without a line."""

    levels: tuple[Level, ...]
    choices: list[Choice]
    lost: list[str]


@dataclass(frozen=True)
class Suspect:
    """A case whose reading looks like something else: its id, what that is, and the share of it left unexplained."""

    case: str  # its id
    words: str  # what was done instead
    own: float  # of the reading, unexplained by what was entered; other: by what was done instead
    other: float


def header_of(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return specimen, finger and rig of a session or setup, for another session of the same."""
    return {key: value for key, value in document.items() if key in HEADER}


def notes_of(text: str, tendons: Sequence[str], whole: bool = True) -> tuple[Note, ...]:
    """Read a notebook that names tendons of a finger; `whole` where it has to have a load.

    Raises:
        InputError: a line that is not understood, or a tendon that the finger does not have.
    """
    notes = read_notes(text, tendons, whole)
    for note in notes:
        for name, _ in note.masses_g:
            if name not in tendons:
                raise InputError(
                    f"line {note.line} of the notebook names {name!r}",
                    f"of {' '.join(tendons)}",
                    did_you_mean(name, tendons),
                )
    return notes


def levels_of(readings: Iterable[ReadingBlock]) -> tuple[Level, ...]:
    """Find the plateaus of readings.

    Raises:
        InputError: there is none.
    """
    levels = find_levels(readings)
    if not levels:
        raise InputError(
            "the recording holds still nowhere for a second", "plateaus", "Look: fingertwin plot RECORDING"
        )
    return levels


def lay_notes(levels: tuple[Level, ...], notes: Sequence[Note]) -> LaidNotes:
    """Lay a notebook onto plateaus."""
    layout = lay(levels, notes)
    loads = (notes[i] for i in layout.not_found if notes[i].kind == "load")
    lost = [f"line {note.line} was found on no plateau: {said(note)}" for note in loads]
    unnamed = [
        "{} ({:g} to {:g} s)".format(laid.level + 1, *levels[laid.level].window_s)
        for laid in layout.plateaus
        if laid.kind == "skip" and laid.note is None
    ]
    if unnamed:
        lost.append(f"no line of the notebook names plateau {', '.join(unnamed)}: left out")
    return LaidNotes(levels, chosen(layout, notes), lost)


def said(note: Note | None) -> str:
    """Return a line of the notebook in words; nothing of none."""
    if note is None or note.kind != "load":
        return "" if note is None else note.kind
    masses = " + ".join(f"{name} {mass:g} g" for name, mass in note.masses_g)
    more = {"validation": note.role == "validation", "unloading": note.direction == "unloading", "tapped": note.tapped}
    return ", ".join([masses, note.posture, note.location, *(word for word, holds in more.items() if holds)])


def document_of(
    name: str,
    header: Mapping[str, Any],
    postures: Mapping[str, Mapping[str, float]],
    laid: LaidNotes,
    provenance: Mapping[str, Any],
) -> dict[str, Any]:
    """Return a bench-session/1 of load cases.

    Args:
        name: its id.
        header: specimen, finger and rig.
        postures: angles [deg] by name; of those that no case has, nothing is kept.
        laid: plateaus and what they are taken for.
        provenance: where it comes from.

    Raises:
        InputError: a load without a tare, no load, or a posture whose angles are not known.
    """
    cases = cases_of(laid.levels, laid.choices)
    wanted = list(dict.fromkeys(case["posture"] for case in cases))
    lacks = lacking(wanted, postures)
    if lacks:
        raise InputError(
            f"the angles of {', '.join(lacks)} are not known", "angles of each posture, in degrees, flexion positive"
        )
    head = {"format": "bench-session/1", "id": name, "readings": READINGS, **header_of(header)}
    angles = {posture: dict(postures[posture]) for posture in wanted}
    return head | {"postures_deg": angles, "cases": cases, "provenance": dict(provenance)}


def lacking(wanted: Sequence[str], postures: Mapping[str, Any]) -> list[str]:
    """Return postures whose angles are not known, each once."""
    return [name for name in dict.fromkeys(wanted) if name not in postures]


def session_of(document: Mapping[str, Any]) -> BenchSession:
    """Return the session that a document describes.

    Raises:
        InputError: its first fault.
    """
    session, faults = parse_session(document, None, SESSION)
    if session is None:
        raise faults[0]
    return session


def write_new(
    out: Path,
    session: BenchSession,
    readings: Iterable[ReadingBlock],
    mapping: LabFileMap | None,
    finger: Path | None = None,
) -> None:
    """Write a session's folder with its readings.

    Args:
        out: the folder.
        session: by that name.
        readings: of the session, block by block.
        mapping: that the next run of the rig can have.
        finger: file of a finger of the user's own, which goes along.
    """
    out.mkdir(parents=True, exist_ok=True)
    write_readings(out / READINGS, readings)
    if finger is not None:
        with replacing(out / finger.name) as temporary:
            shutil.copyfile(finger, temporary)
    if mapping is not None:
        write_mapping(out / MAPPING, mapping)
    write_session(session, out)


def suspects(bench: Session) -> list[Suspect]:
    """Return the cases whose reading looks much more like another load than like what was entered, worst first.

    The finger is taken as it is, without fitting anything, so that only what is far off is named: a reading of which
    the entry leaves most unexplained, and a slip of the pen less than half of that. Of 25 pairs of entries exchanged at
    random in five shipped sessions it named 30 of the 50 cases, and 9 of the 424 that were right.
    """
    from fingermodel.diagnosis.session_model.slips import PossibleSlips

    slips = PossibleSlips(bench.model, bench.observations)
    observations, theta = bench.observations, bench.theta
    read = np.nan_to_num(observations.wrench)[:, :3]
    entered = np.asarray(bench.model.predict(observations.inputs, theta).reading)[:, :3]
    pairs = [(case, slip) for case in range(len(observations.ids)) for slip in slips.of(case)]
    own = _unexplained(read, entered)
    best: dict[int, Suspect] = {}
    for first in range(0, len(pairs), _PAIRS):
        some = pairs[first : first + _PAIRS]
        at = [case for case, _ in some]
        left = _unexplained(read[at], entered[at] + slips.changes(some, theta)[:, :3])
        for (case, slip), share in zip(some, left, strict=True):
            if own[case] > _OFF and share < _BETTER * own[case] and (case not in best or share < best[case].other):
                best[case] = Suspect(observations.ids[case], slip.words, float(own[case]), float(share))
    return sorted(best.values(), key=lambda s: s.other - s.own)


def _unexplained(read: Any, predicted: Any) -> Any:
    """Return (n,) share of readings (n, 3) [N] that predictions leave, against the larger of the two."""
    size = np.maximum(np.linalg.norm(read, axis=1), np.linalg.norm(predicted, axis=1))
    return np.linalg.norm(read - predicted, axis=1) / np.maximum(size, 0.1)
