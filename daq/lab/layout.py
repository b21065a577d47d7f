"""Lay a notebook onto the plateaus of a recording, in order: with tares, and what was forgotten or never read.

No line lies on two plateaus: a load that nobody wrote down is left out.

Of all ways to lay it, that of least cost is taken. A load costs what its force lies off the force per mass that the
same load has elsewhere; a tare, what it lies off the tare before; to leave out a plateau or a line costs more than one
load that fits badly, and less than many. The second-best way that says something else of a plateau tells how sure
the first is.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from daq.lab.levels import Level
from daq.lab.notebook import Note
from daq.recordings.plateaus import TOLERANCE

Floats = NDArray[np.float64]

_LEFT_OUT, _NOT_FOUND = 3.0, 3.5
# What it costs that a tare or what was left out makes no plateau, or that a tap or an unloading makes none of its own.
_UNSEEN, _TAP, _UNLOADED = 0.3, 0.7, 0.9
# Force per mass before other loads tell it [N/g]; and its spread, as a share, where they do.
_FIRST_N_PER_G, _SPREAD = 2e-3, 0.12
_MOST_OFF, _MOST_TARE = 1.5, 6.0
# What a load costs that changes nothing, where its mass should.
_UNCHANGED = 2.9
# What a load costs that follows another one, where tares stand between them.
_SKIPPED_TARE = 1.0
# How sure a plateau is at most, where another one beside it has no line.
_DOUBTFUL = 0.5
# So many ways are followed; of the best of them also those that leave lines out.
_KEPT, _LEAVING_OUT = 60, 15
# Pairs of plateaus whose distance is kept, for ways that look back alike.
_REMEMBERED = 1 << 16
# So large a share of a weight's force friction may change; a change by it costs one, and any at most so much.
_FRICTION, _MOST_MOVED = 0.2, 4.0
# Levels are the same within so many tolerances; a tare is looked for between loads from there on.
_SAME = 1.0


@dataclass(frozen=True)
class Laid:
    """Meaning of one plateau, as laid.

    Attributes:
        level: index of the plateau.
        kind: load, tare or skip.
        note: index of the line, None of a tare that no line names and of what is left out.
        tare: index of the plateau that is the load's tare, None for others.
        sure: from 0 to 1.
    """

    level: int
    kind: str
    note: int | None
    tare: int | None
    sure: float


@dataclass(frozen=True)
class Layout:
    """Meanings of all plateaus in order, and the indices of lines that were found on none."""

    plateaus: tuple[Laid, ...]
    not_found: tuple[int, ...]


class _Choice(NamedTuple):
    """Choice for one plateau."""

    kind: str
    line: int
    tare: int


class _Past(NamedTuple):
    """Choices so far, the last one first."""

    choice: _Choice
    before: _Past | None


@dataclass(frozen=True)
class _State:
    """A way to lay the first plateaus: the next line, the tare that holds, for which block, the cost, and the past."""

    line: int
    tare: int
    block: tuple[str, str]
    cost: float
    past: _Past | None


@dataclass(frozen=True)
class _Known:
    """Force per mass of a load, its spread as a share, and whether its direction is known too."""

    per_g: Floats
    spread: float
    directed: bool


def lay(levels: Sequence[Level], notes: Sequence[Note]) -> Layout:
    """Lay notes onto plateaus."""
    means = np.array([level.plateau.mean for level in levels])
    # Some unload after every load, others once for a posture: the habit that fits better is taken.
    ways = min((_settled(means, notes, between) for between in (False, True)), key=lambda found: found[0][0])
    best_cost, best = ways[0]
    plateaus = []
    for i, choice in enumerate(best):
        other = min((cost for cost, way in ways[1:] if way[i][:2] != choice[:2]), default=math.inf)
        line = choice.line if choice.line >= 0 else None
        tare = choice.tare if choice.kind == "load" else None
        sure = round(1.0 - math.exp(-max(other - best_cost, 0.0)), 2)
        plateaus.append(Laid(i, choice.kind, line, tare, sure))
    found = {laid.note for laid in plateaus}
    lost = tuple(i for i in range(len(notes)) if i not in found)
    return Layout(tuple(_doubted(plateaus, notes, lost)), lost)


def _doubted(plateaus: Sequence[Laid], notes: Sequence[Note], lost: Sequence[int]) -> list[Laid]:
    """Mark as doubtful the blocks whose plateaus and lines differ in number: forces alone tell the odd one."""
    stretch = 0
    at: list[int] = []
    before: tuple[str, str] | None = None
    for laid in plateaus:
        if laid.kind == "load" and laid.note is not None and notes[laid.note].block != before:
            stretch, before = stretch + 1, notes[laid.note].block
        at.append(stretch)
    later = list(at)
    ahead = stretch
    for i in range(len(at) - 1, -1, -1):
        later[i] = ahead = at[i] if plateaus[i].kind == "load" else ahead
    doubtful = set[int]()
    for i, laid in enumerate(plateaus):
        useless = laid.kind == "tare" and i + 1 < len(plateaus) and plateaus[i + 1].kind == "tare"
        if (laid.kind == "skip" and laid.note is None) or useless:
            doubtful |= {at[i], later[i], later[i] + 1}
    lines = {laid.note: at[i] for i, laid in enumerate(plateaus) if laid.note is not None}
    for line in (i for i in lost if notes[i].kind == "load" and not _only_moved(notes[i])):
        doubtful |= {lines[near] for near in (line - 1, line + 1) if near in lines}
    # Of two motions of the same weights one plateau may be either, or both.
    either = {near for line in lost for near in (line - 1, line + 1) if _same_but_moved(notes, line, near)}
    return [
        replace(laid, sure=min(laid.sure, _DOUBTFUL)) if at[i] in doubtful or laid.note in either else laid
        for i, laid in enumerate(plateaus)
    ]


def _same_but_moved(notes: Sequence[Note], line: int, near: int) -> bool:
    if not 0 <= near < len(notes):
        return False
    a, b = notes[line], notes[near]
    return _only_moved(a) and _only_moved(b) and (a.masses_g, a.block) == (b.masses_g, b.block)


def _settled(means: Floats, notes: Sequence[Note], between: bool) -> list[tuple[float, list[_Choice]]]:
    """Return the cheapest ways, when loads are known by those that were laid before."""
    known: dict[object, _Known] = {}
    ways: list[tuple[float, list[_Choice]]] = []
    for _ in range(3):
        ways = _ways(means, notes, known, between)
        known = _learned(means, notes, ways[0][1])
    return ways


def _ways(
    means: Floats, notes: Sequence[Note], known: Mapping[object, _Known], between: bool
) -> list[tuple[float, list[_Choice]]]:
    """Return the cheapest ways, best first; `between` says whether tares stand between the loads of a block."""

    # Only of plateaus that a way looks back to: of thousands there are millions of pairs.
    @lru_cache(_REMEMBERED)
    def distance(level: int, other: int) -> float:
        return float((np.abs(means[level] - means[other]) / TOLERANCE).max())

    @lru_cache(_REMEMBERED)
    def off(level: int, tare: int, line: int) -> float:
        return _off_load((means[level] - means[tare])[:3], distance(level, tare), notes[line], known)

    lost = _lost(notes)
    states = [_State(0, -1, ("", ""), 0.0, None)]
    for level in range(len(means)):
        after: dict[tuple[int, int], list[_State]] = {}
        for state in _with_lines_left_out(states, lost):
            for choice, cost, block in _choices(level, state, distance, notes, off, between):
                line = state.line + (choice.line == state.line)
                new = _State(line, choice.tare, block, state.cost + cost, _Past(choice, state.past))
                after.setdefault((line, choice.tare), []).append(new)
        # Of ways that go on alike, two: the second tells how sure the first is.
        kept = [s for group in after.values() for s in sorted(group, key=lambda s: s.cost)[:2]]
        states = sorted(kept, key=lambda s: s.cost)[:_KEPT]
    ways = [(s.cost + sum(lost[s.line :]), _unrolled(s.past)) for s in states]
    return sorted(ways, key=lambda way: way[0])


def _with_lines_left_out(states: Sequence[_State], lost: Sequence[float]) -> list[_State]:
    out = list(states)
    for state in states[:_LEAVING_OUT]:
        out += [
            replace(state, line=state.line + more, cost=state.cost + sum(lost[state.line : state.line + more]))
            for more in (1, 2, 3)
            if state.line + more <= len(lost) and (more < 3 or sum(lost[state.line : state.line + more]) < _NOT_FOUND)
        ]
    return sorted(out, key=lambda s: s.cost)


def _lost(notes: Sequence[Note]) -> list[float]:
    """Return the cost of each line's being found on no plateau."""
    return [
        _UNSEEN if n.kind != "load" else _TAP if n.tapped else _UNLOADED if _only_moved(n) else _NOT_FOUND
        for n in notes
    ]


def _only_moved(note: Note) -> bool:
    """Return whether what hangs may be what hung before: then it need not make a plateau of its own."""
    return note.tapped or note.direction == "unloading"


def _unrolled(past: _Past | None) -> list[_Choice]:
    out: list[_Choice] = []
    while past is not None:
        out.append(past.choice)
        past = past.before
    return out[::-1]


def _choices(
    level: int,
    state: _State,
    distance: Callable[[int, int], float],
    notes: Sequence[Note],
    off_load: Callable[[int, int, int], float],
    between: bool,
) -> Iterator[tuple[_Choice, float, tuple[str, str]]]:
    """Yield the possible meanings of a plateau, their costs, and the block whose tare holds from then on."""
    line, tare, block = state.line, state.tare, state.block
    note = notes[line] if line < len(notes) else None
    yield _Choice("skip", -1, tare), _LEFT_OUT, block
    if note is not None and note.kind != "load":
        held = level if note.kind == "tare" else tare
        yield _Choice(note.kind, line, held), 0.0, ("", "") if note.kind == "tare" else block
    ahead = next((n for n in notes[line:] if n.kind == "load"), None)
    wanted = block if ahead is None else ahead.block
    # Of a new block nothing is known of the tare; of the same one it lies where it lay.
    off = distance(level, tare) if tare >= 0 and wanted == block else 0.0
    last = state.past.choice.kind if state.past is not None else ""
    # A tare that no load follows, or against the habit, is a plateau left out.
    unusual = last == "tare" or (not between and tare >= 0 and wanted == block and ahead is not None)
    cost = min(max(off - _SAME, 0.0), _MOST_TARE) + (1.5 * _LEFT_OUT if unusual else 0.05)
    # A block begins with its tare rather than with something left out.
    cost += 1.0 if last == "skip" and wanted != block else 0.0
    yield _Choice("tare", -1, level), cost, wanted
    skipped = _SKIPPED_TARE if between and last == "load" else 0.0
    if tare < 0:
        return
    if note is not None and note.kind == "load" and block in (note.block, ("", "")):
        hung = _hung_before(level, state, notes)
        if hung is None:
            cost = off_load(level, tare, line)
        else:  # friction alone changes what the same weights do
            own, moved = distance(level, tare), distance(level, hung)
            cost = min(moved / max(_FRICTION * own, _SAME), _MOST_MOVED)
        yield _Choice("load", line, tare), cost + skipped, note.block


def _hung_before(level: int, state: _State, notes: Sequence[Note]) -> int | None:
    """Return the plateau at which the very weights hung that a line moves; None where it moves none, or not these."""
    past, note = state.past, notes[state.line]
    while past is not None and _only_moved(note):
        level -= 1
        if past.choice.kind == "load":
            return level if notes[past.choice.line].masses_g == note.masses_g else None
        past = past.before
    return None


def _off_load(force: Floats, distance: float, note: Note, known: Mapping[object, _Known]) -> float:
    """Return the cost of taking a change of force (3,) [N] for a line's load; `distance` in tolerances."""
    mass = sum(m for _, m in note.masses_g)
    if mass <= 0.0:
        return min(distance, _MOST_OFF)
    size = float(np.linalg.norm(force))
    found = known.get(_key(note)) or known.get(note.location) or _Known(np.array([_FIRST_N_PER_G, 0, 0]), 0.8, False)
    if distance <= _SAME / 2.0 or size == 0.0:
        wanted = mass * float(np.linalg.norm(found.per_g)) / float(TOLERANCE[0])
        return _UNCHANGED if wanted > 3.0 * _SAME else _MOST_OFF
    if found.directed:
        off = float(np.linalg.norm(force / mass - found.per_g)) / (found.spread * float(np.linalg.norm(found.per_g)))
    else:
        off = abs(math.log(size / (mass * float(np.linalg.norm(found.per_g))))) / found.spread
    return min(0.5 * off**2, _MOST_OFF)


def _key(note: Note) -> object:
    return (tuple(name for name, _ in note.masses_g), note.posture, note.location, note.direction, note.tapped)


def _learned(means: Floats, notes: Sequence[Note], way: Sequence[_Choice]) -> dict[object, _Known]:
    """Return the force per mass of every load that was found twice, and of each location on the whole."""
    per_g: dict[object, list[Floats]] = {}
    for level, choice in enumerate(way):
        if choice.kind == "load":
            note = notes[choice.line]
            mass = sum(m for _, m in note.masses_g)
            if mass > 0.0:
                found = (means[level] - means[choice.tare])[:3] / mass
                per_g.setdefault(_key(note), []).append(found)
                per_g.setdefault(note.location, []).append(found)
    out: dict[object, _Known] = {}
    for key, values in per_g.items():
        if isinstance(key, str):
            sizes = np.linalg.norm(values, axis=1)
            spread = max(float(np.std(np.log(np.maximum(sizes, 1e-9)))), _SPREAD)
            out[key] = _Known(np.array([float(np.median(sizes)), 0.0, 0.0]), spread, False)
        elif len(values) > 1:
            out[key] = _Known(np.median(values, axis=0), _SPREAD, True)
    return out
