"""Notebook of the bench, line by line: `FDP 950, hook, tip`."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import Any

from daq.errors import InputError

_TIMES = re.compile(r"[x\u00d7]\s*(\d+)", re.IGNORECASE)
# What a word of its own says.
_WORDS: dict[str, dict[str, Any]] = {
    "tip": {"location": "tip"}, "bone": {"location": "bone"},
    "identification": {"role": "identification"}, "validation": {"role": "validation"},
    "loading": {"direction": "loading"}, "unloading": {"direction": "unloading"}, "tapped": {"tapped": True},
    "tare": {"kind": "tare"}, "zero": {"kind": "tare"}, "unloaded": {"kind": "tare"},
    "skip": {"kind": "skip"}, "left out": {"kind": "skip"}, "again": {"repeats": True}, "repeat": {"repeats": True},
}  # fmt: skip
# What stands where a mass would.
_INSTEAD = tuple(word for word, meaning in _WORDS.items() if meaning.keys() & {"kind", "repeats"})
# As a line of its own only: a cell may hold it where there is nothing to say.
_DASH = {"-": "skip"}
_HEADINGS = {
    "tendon": "tendon", "muscle": "tendon", "mass": "mass", "mass_g": "mass", "g": "mass", "posture": "posture",
    "location": "location", "place": "location", "role": "role", "direction": "direction",
}  # fmt: skip
_OF_WORDS = ("posture", "location", "role", "direction")
_MOST = 10_000
# On each tendon [g], as they were named.
Masses = list[tuple[str, float]]


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

    `tare`, `skip`, `again`, `unloading` and `tapped` hold for their own line. A row of a CSV says what hung: masses are
    never as in the row before, but by `again`.

    Args:
        text: `FDP 950, hook, tip` in each line, or CSV with a heading of tendon, mass, posture, location, role,
            direction, or a column of masses for each tendon.
        tendons: of the finger, by which columns of masses are known.
        whole: there has to be a load in it.

    Raises:
        InputError: a line that is not understood, or what no line before it says.
    """
    lines = [(number, line.strip()) for number, line in enumerate(text.splitlines(), 1)]
    lines = [(number, line) for number, line in lines if line.strip(",;\t ") and not line.startswith("#")]
    if not lines:
        raise InputError("the notebook is empty", "lines such as 'FDP 950, hook, tip'")
    known = {t.lower(): t for t in tendons}
    heading = _heading(lines[0][1], set(tendons))
    if twice := _twice(heading):
        raise InputError(f"line {lines[0][0]} of the notebook has two columns of {twice}", "one of each")
    notes: list[Note] = []
    said = Note("load", 0)
    for number, line in lines[1:] if heading else lines:
        cells = _cells(line, lines[0][1])
        hung, words = _row(number, cells, heading, known) if heading else _typed(line, known)
        said, times = _said(number, line, hung, words, said, known)
        first = said if said.kind == "load" else Note(said.kind, number)
        notes += [first, *[replace(first, repeats=True)] * (times - 1)]
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


def _typed(line: str, known: Mapping[str, str]) -> tuple[Masses, list[str]]:
    """Return the masses [g] of a typed line, and its words."""
    line = line.strip(" .")
    # A comma within a number parts nothing.
    fields = [f.strip() for f in re.split(r"[;\t]|,(?!\d)", _DASH.get(line, line))]
    hung: Masses = []
    words = []
    for field in filter(None, fields):
        found = _masses(field, known)
        hung += found
        words += [] if found else [field]
    return hung, words


def _row(
    number: int, cells: Sequence[str], heading: Sequence[str], known: Mapping[str, str]
) -> tuple[Masses, list[str]]:
    """Return the masses [g] of a row of a CSV, and its words.

    Raises:
        InputError: a cell that is no mass where one stands, or a row without any that does not say why.
    """
    row = {column: cell.strip() for column, cell in zip_longest(heading, cells, fillvalue="") if cell.strip()}
    if "" in row:
        raise InputError(
            f"line {number} of the notebook has {row['']!r} behind its last column",
            f"{len(heading)} cells, as in its heading",
            "Put a number with a decimal comma in quotes",
        )
    worded = [column for column, cell in row.items() if column in _OF_WORDS or cell.lower() in _INSTEAD]
    words = [row.pop(column) for column in worded]
    pair = " ".join(row.pop(column) for column in ("tendon", "mass") if column in row)
    loads = [(column, cell, f"{column} {cell}") for column, cell in row.items()]
    loads += [("tendon", pair, pair)] if pair else []
    hung: Masses = []
    for column, cell, text in loads:
        found = _masses(text, known)
        if not found:
            raise InputError(
                f"line {number} of the notebook, column {column}, has {cell!r}",
                "a tendon with a mass such as 950, 950 g or 0.95 kg",
                "Leave the cell empty where nothing hung",
            )
        hung += found
    if row and not any(mass for _, mass in hung):
        return [], [*words, "tare"]
    if not hung and not any(word.lower() in _INSTEAD for word in words):
        raise InputError(
            f"line {number} of the notebook, {', '.join(words)!r}, names no mass",
            "a mass on a tendon, or 'again' for the load before",
            "Where nothing hung write 0, or 'tare'",
        )
    return [(tendon, mass) for tendon, mass in hung if mass or not row], words


def _said(
    number: int, line: str, hung: Masses, words: Iterable[str], before: Note, known: Mapping[str, str]
) -> tuple[Note, int]:
    """Return what a line says, with what it leaves out as it was before, and how often it was done."""
    own: dict[str, Any] = {"times": 1, "kind": "load", "repeats": False, "direction": "loading", "tapped": False}
    by: dict[str, str] = {}
    for word in words:
        for key, value in _meaning(number, word, known).items():
            if key in by:
                raise InputError(f"line {number} of the notebook has {by[key]!r} and {word!r}", "one of them")
            by[key], own[key] = word, value
    if twice := _twice(tendon for tendon, _ in hung):
        raise InputError(f"line {number} of the notebook, {line[:40]!r}, names {twice} twice", "one mass on a tendon")
    if hung:
        own["masses_g"] = tuple(hung)
    times = own.pop("times")
    note = replace(before, line=number, **own)
    if note.kind == "tare" and hung:
        raise InputError(f"line {number} of the notebook, {line[:40]!r}, is a tare with a mass", "one of them")
    stated = {"a mass": note.masses_g, "a posture": note.posture, "tip or bone": note.location}
    lacks = [what for what, value in stated.items() if not value]
    if note.kind == "load" and lacks:
        raise InputError(
            f"line {number} of the notebook, {line[:40]!r}, lacks {lacks[0]}", "as in 'FDP 950, hook, tip'"
        )
    return note, times


def _twice(names: Iterable[str]) -> str:
    """Return the first name that is there before; nothing where each is there once."""
    counts = Counter(names)
    return next((name for name, count in counts.items() if count > 1), "")


def _meaning(number: int, word: str, known: Mapping[str, str]) -> dict[str, Any]:
    """Return what a word says of a load."""
    if match := _TIMES.fullmatch(word):
        return {"times": _repeats(match[1], number)}
    if meaning := _WORDS.get(word.lower()):
        return meaning
    if re.fullmatch(r"[A-Za-z][\w -]*", word) and word.lower().split()[0] not in known:
        return {"posture": word}
    raise InputError(f"line {number} of the notebook has {word!r}", "tendon and mass, posture, tip or bone")


def _repeats(text: str, number: int) -> int:
    if int(text) > _MOST:
        raise InputError(f"line {number} of the notebook is repeated {text} times", "fewer repeats")
    return int(text)


def _masses(field: str, known: Mapping[str, str]) -> Masses:
    """Return the masses [g] of a field such as `FDP 300 + FDS 0.2 kg`; none where it is not one."""
    out: Masses = []
    for part in re.split(r"\s*\+\s*", field):
        match = re.fullmatch(r"([A-Za-z]\w*?)\s*[:= ]\s*(\d+(?:[.,]\d+)?)\s*(kg|g)?", part)
        if match is None:
            return []
        factor = 1000.0 if match[3] == "kg" else 1.0
        out.append((known.get(match[1].lower(), match[1]), float(match[2].replace(",", ".")) * factor))
    return out
