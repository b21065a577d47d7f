"""A session made of a lab's recordings and notebook: readings one after the other, and load cases from plateaus."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.checks.recording import JUMP_S
from daq.errors import InputError, ReadingsError
from daq.lab.files import LabFileMap, LabRecording, open_recording, stated_mapping
from daq.lab.layout import Layout
from daq.lab.levels import Level
from daq.lab.notebook import Note
from daq.recordings.readings import ReadingBlock, ReadingSource, open_readings, write_readings
from daq.sessions.faults import require_posture
from daq.sessions.protocols import TAPPED

Floats = NDArray[np.float64]

# Between the last reading of a file and the first one of the next [s]: a pause, and no lost readings.
APART_S = 2.0 * JUMP_S


@dataclass(frozen=True)
class Choice:
    """Meaning of a plateau: load, tare or skip; the load that hung; and its certainty (0 to 1)."""

    kind: str
    note: Note | None
    sure: float


def is_readings_file(path: Path) -> bool:
    """Return whether a file is a readings file as sessions have it, which needs no mapping."""
    try:
        open_readings(path)
    except ReadingsError:
        return False
    return True


@dataclass(frozen=True)
class Joined:
    """Recordings, one after the other, as a file of readings: gone through as often as needed, and never held whole.

    Attributes:
        path: of the file.
        notes: for the reader.
    """

    path: Path
    notes: tuple[str, ...]

    def __iter__(self) -> Iterator[ReadingBlock]:
        return open_readings(self.path).blocks()


@contextmanager
def joined(
    recordings: Sequence[Path], mapping: LabFileMap | None, seen: Callable[[int], None] | None = None
) -> Iterator[Joined]:
    """Read recordings one after the other, each beginning some seconds after the end of the one before.

    Args:
        recordings: in the order in which they were made.
        mapping: of those that are no readings files.
        seen: called with how many readings were read so far; what it raises ends the reading.

    Yields:
        Their readings, whose file is gone afterwards.

    Raises:
        InputError: one cannot be read.
    """
    sources = [_opened(path, mapping) for path in recordings]
    with TemporaryDirectory(prefix="fingertwin-", ignore_cleanup_errors=True) as folder:
        file = write_readings(Path(folder) / "joined.parquet", _one_after_the_other(sources, seen))
        notes: list[str] = []
        for source in sources:  # some of them are known once all was read
            notes += () if isinstance(source, ReadingSource) else [*source.conversions, *source.notes]
        if len(recordings) > 1:
            notes.append(f"{len(recordings)} recordings stand one after the other, {APART_S:g} s apart")
        yield Joined(file, tuple(dict.fromkeys(notes)))


def _opened(path: Path, mapping: LabFileMap | None) -> ReadingSource | LabRecording:
    """Open a recording; text is read as any program may have written it, whatever its header says."""
    try:
        own = open_readings(path)
    except ReadingsError:
        if mapping is None:
            raise
        return open_recording(path, mapping)
    return own if own.kind == "parquet" else open_recording(path, stated_mapping(own.columns))


def _one_after_the_other(
    sources: Sequence[ReadingSource | LabRecording], seen: Callable[[int], None] | None
) -> Iterator[ReadingBlock]:
    """Their readings; with a status where all have one."""
    with_status = all(source.has_status for source in sources)
    end_s, rows = -APART_S, 0
    for source in sources:
        shift_s: float | None = None
        for block in source.blocks():
            if shift_s is None:
                shift_s, own, last_s = end_s + APART_S - float(block.t_s[0]), 0, -np.inf
            if isinstance(source, ReadingSource):  # a lab's recording does so itself
                _require_rising(block.t_s, last_s, own, source)
            rows, own, last_s = rows + len(block), own + len(block), float(block.t_s[-1])
            if seen is not None:
                seen(rows)
            t_s = block.t_s + shift_s
            yield ReadingBlock(t_s, block.wrench, block.status if with_status else None)
        end_s = last_s + (shift_s or 0.0)


def _require_rising(t_s: Floats, last_s: float, before: int, source: ReadingSource) -> None:
    """Refuse times that stand still or go back: windows would be of other readings.

    Raises:
        ReadingsError: they do.
    """
    steps = np.diff(t_s, prepend=last_s)
    if steps.min() > 0.0:
        return
    at = int(np.argmin(steps > 0.0))
    raise ReadingsError(
        f"{source.path.name}: reading {before + at + 1} has the time {t_s[at]:.9g} s, and the one before it "
        f"{t_s[at - 1] if at else last_s:.9g} s",
        "a later time for each reading",
        "Remove rows that were written twice, or split the file where a second recording begins",
    )


def chosen(layout: Layout, notes: Sequence[Note]) -> list[Choice]:
    """Return the meaning of every plateau, from a layout."""
    out = []
    for laid in layout.plateaus:
        note = None if laid.note is None or laid.kind != "load" else notes[laid.note]
        out.append(Choice(laid.kind, note, laid.sure))
    return out


def cases_of(levels: Sequence[Level], choices: Sequence[Choice]) -> list[dict[str, Any]]:
    """Load cases of a session, as plain data.

    Raises:
        InputError: a load before any tare of its posture and place.
    """
    out: list[dict[str, Any]] = []
    tare: Level | None = None
    tared: tuple[str, str] | None = None
    last: dict[object, str] = {}
    for i, (level, choice) in enumerate(zip(levels, choices, strict=True)):
        if choice.kind == "tare":
            tare, tared = level, None
        note = choice.note
        if choice.kind != "load" or note is None:
            continue
        if tare is None or tared not in (None, note.block):
            raise InputError(
                f"the load at {level.window_s[0]:g} s ({note.posture}, {note.location}) has no tare before it",
                "a plateau without load in each posture, before its loads",
                "Say which one it is: its number and 'tare'",
            )
        tared = note.block
        case: dict[str, Any] = {
            "id": f"c{len(out) + 1:03d}",
            "role": note.role,
            "posture": note.posture,
            "location": note.location,
            "masses_g": dict(note.masses_g),
            "unloaded_s": list(tare.window_s),
            "loaded_s": list(level.window_s),
        }
        if after := _tare_after(i, levels, choices):
            case["unloaded_after_s"] = list(after.window_s)
        if note.direction == "unloading":
            case["direction"] = note.direction
        if note.tapped:
            case["note"] = TAPPED
        key = (note.masses_g, note.block, note.role, note.direction, note.tapped)
        if note.repeats and key in last:
            case["repeat_of"] = last[key]
        last.setdefault(key, case["id"])
        out.append(case)
    if not out:
        raise InputError("no plateau is a load", "one at least", "Give the notebook: --notes FILE")
    return out


def _tare_after(i: int, levels: Sequence[Level], choices: Sequence[Choice]) -> Level | None:
    """Return the tare right behind a load, where the same block goes on after it: nothing else was changed before."""
    own = choices[i].note
    following = next((c for c in choices[i + 1 :] if c.kind == "load"), None)
    if own is None or i + 1 >= len(levels) or choices[i + 1].kind != "tare":
        return None
    same = following is not None and following.note is not None and following.note.block == own.block
    return levels[i + 1] if same else None


def posture_of(text: str) -> tuple[str, dict[str, float]]:
    """Read `hook: MCP 0 PIP 65 DIP 50`, with or without = signs.

    Raises:
        InputError: it is no name with angles, or a session can have no such angles.
    """
    name, _, rest = text.partition(":")
    angles = dict(re.findall(r"([A-Za-z]\w*)\s*[= ]\s*([+-]?\d+(?:\.\d+)?)", rest))
    left = re.sub(r"[A-Za-z]\w*\s*[= ]\s*[+-]?\d+(?:\.\d+)?|[,;\s]", "", rest)
    if not name.strip() or not angles or left:
        raise InputError(f"posture {text!r}", "a name and angles in degrees, such as 'hook: MCP 0 PIP 65 DIP 50'")
    degrees = {k: float(v) for k, v in angles.items()}
    require_posture(name.strip(), degrees)
    return name.strip(), degrees


def still_missing(document: Mapping[str, Any]) -> list[str]:
    """Return the gaps of a session for a diagnosis, one line each."""
    cases = document["cases"]
    mounts = (document.get("load_cell") or {}).get("mounts") or {}
    out = []
    if not any(c["role"] == "validation" for c in cases):
        out.append("no case is kept from the fit: write 'validation' behind some lines of the notebook")
    if len({c["posture"] for c in cases}) < 2:
        out.append("one posture only: effects that differ by posture cannot be told apart")
    for place in ("tip", "bone"):
        if all(c["location"] != place for c in cases):
            out.append(f"nothing was read at the {place}")
        elif not (mounts.get(place) or {}).keys() & {"rotation", "rotation_deg"}:
            out.append(f"the mount at the {place} states no rotation: the cell's axes are taken for the finger's")
    if not document.get("checks"):
        out.append("no known weight was hung on the cell: its axes and scale are believed")
    if len({c["unloaded_s"][0] for c in cases}) < len({(c["posture"], c["location"]) for c in cases}):
        out.append("some tares serve several postures")
    return out
