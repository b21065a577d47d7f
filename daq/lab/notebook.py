"""Notebook of the bench, line by line: `FDP 950, hook, tip`."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from daq.errors import InputError

_TIMES = re.compile(r"[x\u00d7]\s*(\d+)", re.IGNORECASE)
# What a word of its own says.
_WORDS: dict[str, dict[str, Any]] = {
    "tip": {"location": "tip"}, "bone": {"location": "bone"},
    "identification": {"role": "identification"}, "validation": {"role": "validation"},
    "loading": {"direction": "loading"}, "unloading": {"direction": "unloading"}, "tapped": {"tapped": True},
}  # fmt: skip
_TARE, _SKIPPED, _AGAIN = ("tare", "zero", "unloaded"), ("-", "skip", "left out"), ("again", "repeat")
_HEADINGS = {
    "tendon": "tendon", "muscle": "tendon", "mass": "mass", "mass_g": "mass", "g": "mass", "posture": "posture",
    "location": "location", "place": "location", "role": "role", "direction": "direction",
}  # fmt: skip
_MOST = 10_000


@dataclass(frozen=True)
class Note:
    """One line.

    Attributes:
        kind: load, tare, or skip for a plateau that is to be left out.
        masses_g: mass on each tendon [g].
        posture: its name; location: tip or bone; role: identification or validation.
        repeats: the line before is done once more.
        direction: loading or unloading, by the last motion of the weights; tapped: the rig was, before the reading.
        line: its number.
    """

    kind: str
    line: int
    masses_g: tuple[tuple[str, float], ...] = ()
    posture: str = ""
    location: str = ""
    role: str = "identification"
    repeats: bool = False
    direction: str = "loading"
    tapped: bool = False

    @property
    def block(self) -> tuple[str, str]:
        """Conditions that have to stay for a tare to hold."""
        return self.posture, self.location


def read_notes(text: str, tendons: Iterable[str] = (), whole: bool = True) -> tuple[Note, ...]:
    """Read a notebook, typed or as CSV; what a line leaves out is as in the line before.

    `again`, `unloading` and `tapped` hold for their own line.

    Args:
        text: `FDP 950, hook, tip` in each line, or CSV with a heading of tendon, mass, posture, location, role,
            direction.
        tendons: of the finger, by which columns of masses are known.
        whole: there has to be a load in it.

    Raises:
        InputError: a line that is not understood, or what no line before it says.
    """
    lines = [(number, line.strip()) for number, line in enumerate(text.splitlines(), 1)]
    lines = [(number, line) for number, line in lines if line and not line.startswith("#")]
    if not lines:
        raise InputError("the notebook is empty", "lines such as 'FDP 950, hook, tip'")
    heading = _heading(lines[0][1], set(tendons))
    if heading:
        lines = [(number, _as_typed(line, lines[0][1], heading)) for number, line in lines[1:]]
    known = {t.lower(): t for t in tendons}
    notes: list[Note] = []
    for number, line in lines:
        notes += _note(number, line, notes, known)
        if len(notes) > _MOST:
            raise InputError(f"line {number} of the notebook leads to more than {_MOST} plateaus", "fewer repeats")
    if whole and not any(note.kind == "load" for note in notes):
        raise InputError("the notebook names no load", "lines such as 'FDP 950, hook, tip'")
    return tuple(notes)


def _heading(line: str, tendons: set[str]) -> list[str]:
    """Return the meaning of each column of a CSV; nothing where the line is no heading."""
    cells = [c.strip() for c in _cells(line)]
    kinds = [c if c in tendons else _HEADINGS.get(c.lower(), "") for c in cells]
    return kinds if len(cells) > 1 and all(kinds) else []


def _cells(line: str, like: str = "") -> list[str]:
    mark = next((m for m in "\t;" if m in (like or line)), ",")
    return next(csv.reader([line], delimiter=mark), [])


def _as_typed(line: str, heading_line: str, heading: list[str]) -> str:
    """Return a row of a CSV as somebody would have typed it."""
    cells: Mapping[str, str] = {k: c.strip() for k, c in zip(heading, _cells(line, heading_line), strict=False)}
    masses = [f"{k} {c}" for k, c in cells.items() if k not in _HEADINGS.values() and c and float_or(c)]
    if cells.get("tendon"):
        masses.append(f"{cells['tendon']} {cells.get('mass', '')}".strip())
    return ", ".join([" + ".join(masses), *(cells.get(k, "") for k in ("posture", "location", "role", "direction"))])


def float_or(text: str) -> float:
    """Return a number with point or comma, 0 where it is none."""
    try:
        return float(text.replace(",", "."))
    except ValueError:
        return 0.0


def _note(number: int, line: str, before: list[Note], known: Mapping[str, str]) -> list[Note]:
    loads = [n for n in before if n.kind == "load"]
    last = loads[-1] if loads else None
    word = line.lower().strip(" .")
    if word in _TARE or word in _SKIPPED:
        return [Note("tare" if word in _TARE else "skip", number)]
    times = 1
    masses: dict[str, float] = {}
    own: dict[str, Any] = {"line": number, "repeats": False, "direction": "loading", "tapped": False}
    note = replace(last, **own) if last else Note("load", number)
    again = False
    # A comma within a number parts nothing.
    for field in (f.strip() for f in re.split(r"[;\t]|,(?!\d)", line)):
        lower = field.lower()
        if not field:
            continue
        if match := _TIMES.fullmatch(field):
            times = _repeats(match[1], number)
        elif lower in _AGAIN:
            again = True
        elif lower in _WORDS:
            note = replace(note, **_WORDS[lower])
        elif found := _masses(field, known):
            masses |= found
        elif re.fullmatch(r"[A-Za-z][\w -]*", field) and lower.split()[0] not in known:
            note = replace(note, posture=field)
        else:
            raise InputError(f"line {number} of the notebook has {field!r}", "tendon and mass, posture, tip or bone")
    if masses:
        note = replace(note, masses_g=tuple(masses.items()))
    said = {"a mass": note.masses_g, "a posture": note.posture, "tip or bone": note.location}
    lacks = [what for what, value in said.items() if not value]
    if lacks:
        raise InputError(
            f"line {number} of the notebook, {line[:40]!r}, lacks {lacks[0]}", "as in 'FDP 950, hook, tip'"
        )
    first = replace(note, repeats=again)
    return [first, *[replace(note, repeats=True)] * (times - 1)]


def _repeats(text: str, number: int) -> int:
    if int(text) > _MOST:
        raise InputError(f"line {number} of the notebook is repeated {text} times", "fewer repeats")
    return int(text)


def _masses(field: str, known: Mapping[str, str]) -> dict[str, float]:
    """Return masses of a field such as `FDP 300 + FDS 0.2 kg`; none where it is not one."""
    out: dict[str, float] = {}
    for part in re.split(r"\s*\+\s*", field):
        match = re.fullmatch(r"([A-Za-z]\w*?)\s*[:= ]\s*(\d+(?:[.,]\d+)?)\s*(kg|g)?", part)
        if match is None:
            return {}
        factor = 1000.0 if match[3] == "kg" else 1.0
        out[known.get(match[1].lower(), match[1])] = float(match[2].replace(",", ".")) * factor
    return out
