"""What is hung on which tendon, in which posture and when: a protocol drawn at random."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from tests.simulator.finger import MUSCLES

Rng: TypeAlias = np.random.Generator
Masses: TypeAlias = dict[str, float]
# Heaviest weight that published tests hang on each tendon, about [g].
TOP_G = {"RI": 700.0, "LU": 60.0, "UI": 550.0, "FDP": 950.0, "FDS": 950.0, "EDC": 420.0}
# Joint angles between which a posture is drawn [deg].
RANGES_DEG = {"MCP": (-22.0, 62.0), "PIP": (20.0, 78.0), "DIP": (12.0, 52.0)}
# Least and most identification cases, and most cases in all, of a small, a middle and a large protocol: programs that
# are compiled for one of a size serve all of that size.
SIZES = ((24, 28, 32), (54, 60, 64), (86, 96, 112))
_TARE_S, _HOLD_S = 4.4, 4.2


@dataclass(frozen=True)
class Case:
    """One load case; times in s since the start of the record.

    Attributes:
        id: unique in its session.
        role: identification or validation.
        posture: its name.
        location: tip or bone.
        masses_g: hung on each tendon.
        unloaded_s: window of the tare; loaded_s: of the loaded reading.
        set_s: when the posture was in place; hung_s: when the weights were hung.
        block: number of the tare that it shares with others.
        setting: how often the posture had been set before.
        repeat_of: an earlier case that this one repeats.
    """

    id: str
    role: str
    posture: str
    location: str
    masses_g: Mapping[str, float]
    unloaded_s: tuple[float, float]
    loaded_s: tuple[float, float]
    set_s: float
    hung_s: float
    block: int
    setting: int = 0
    repeat_of: str | None = None


@dataclass(frozen=True)
class Plan:
    """Load cases in order of time, the postures as stated [deg] and the rig's stated tension factor."""

    postures_deg: Mapping[str, Mapping[str, float]]
    cases: tuple[Case, ...]
    tension_factor: float

    @property
    def end_s(self) -> float:
        """Length of the record."""
        return self.cases[-1].loaded_s[1] + 0.1


@dataclass(frozen=True)
class _Load:
    role: str
    masses_g: Masses
    repeat_of: str | None = None


@dataclass
class _Block:
    posture: str
    location: str
    loads: list[_Load]
    setting: int = 0


def draw_plan(rng: Rng, tension_factor: float, sideways: bool = True) -> Plan:
    """Draw some 20 to 96 identification cases in one to six postures, 4 to 16 validation cases and perhaps repeats.

    Args:
        rng: that draws.
        tension_factor: the rig's, as stated.
        sideways: whether the finger may be held to one side.
    """
    least, most, total = SIZES[int(rng.integers(len(SIZES)))]
    wanted = int(rng.integers(least, most + 1))
    unseen = int(rng.integers(max(4, total - 15 - wanted), min(16, total - wanted) + 1))
    again, alone = rng.uniform() < 0.5, rng.uniform() < 0.4
    # Settings in all: up to four, or five to eight, one in three.
    names = [
        f"p{k + 1}"
        for k in range(int(rng.integers(5, 7) if rng.uniform() < 0.3 else rng.integers(2, 5 - again - alone)))
    ]
    levels = _levels(rng)
    repeats = int(rng.integers(2, 9)) if again else 0
    at_bone = round(wanted * rng.uniform(0.1, 0.25))
    together = float(rng.uniform(0.1, 0.4))
    blocks = _blocks(rng, names, "tip", wanted - at_bone - repeats, levels, together)
    below = [str(n) for n in rng.permutation(names)[: int(rng.integers(1, len(names) + 1))]]
    blocks += _blocks(rng, below, "bone", at_bone, levels, max(together, 0.3))
    blocks = [b for b in blocks if b.loads]
    only_seen = list(names)
    if alone:
        # A posture for cases that are never fitted.
        names.append("unseen")
        loads = _loads(rng, unseen // 2, levels, together, "validation")
        blocks.append(_Block("unseen", "tip", loads))
        unseen -= len(loads)
    for _ in range(unseen):
        block = blocks[int(rng.integers(len(blocks)))]
        block.loads += _loads(rng, 1, levels, 0.7, "validation")
    cases = list(_timed(blocks, 0.0))
    if repeats:
        name = str(rng.choice(only_seen))
        able = [c for c in cases if (c.posture, c.location, c.role) == (name, "tip", "identification")]
        chosen = [able[int(k)] for k in rng.permutation(len(able))[:repeats]]
        loads = [_Load("identification", dict(c.masses_g), c.id) for c in chosen]
        cases += _timed([_Block(name, "tip", loads, 1)], cases[-1].loaded_s[1] + 0.1, cases)
    return Plan(_postures(rng, names, sideways), tuple(cases), tension_factor)


def _postures(rng: Rng, names: Sequence[str], sideways: bool) -> dict[str, dict[str, float]]:
    """Angles by posture; in one session of four the finger is held to one side in some."""
    sideways &= rng.uniform() < 0.25
    out = {}
    for name in names:
        angles = {j: float(round(rng.uniform(*bounds))) for j, bounds in RANGES_DEG.items()}
        out[name] = {**angles, "abduction": float(round(rng.uniform(-8.0, 8.0))) * sideways}
    return out


def _levels(rng: Rng) -> dict[str, list[float]]:
    """One to three masses of each tendon [g]."""
    count, top = int(rng.integers(1, 4)), rng.uniform(0.7, 1.1)
    shares = [1.0, *sorted(rng.uniform(0.25, 0.75, count - 1), reverse=True)]
    step = {m: 5.0 if g < 100.0 else 10.0 for m, g in TOP_G.items()}
    return {m: sorted({max(round(g * top * s / step[m]), 1) * step[m] for s in shares}) for m, g in TOP_G.items()}


def _blocks(
    rng: Rng, names: Sequence[str], location: str, count: int, levels: dict[str, list[float]], together: float
) -> list[_Block]:
    """Share a number of identification cases among the postures, as evenly as it goes."""
    share = [count // len(names) + (k < count % len(names)) for k in range(len(names))]
    loads = [_loads(rng, n, levels, together, "identification") for n in share]
    return [_Block(name, location, some) for name, some in zip(names, loads, strict=True)]


def _loads(rng: Rng, count: int, levels: dict[str, list[float]], together: float, role: str) -> list[_Load]:
    """Tendons one by one, and a share of them two or three at once; none is loaded twice alike."""
    single: list[Masses] = [{m: g} for m in MUSCLES for g in levels[m]]
    waiting = [single[int(k)] for k in rng.permutation(len(single))]
    out: list[Masses] = []
    while len(out) < count:
        if waiting and rng.uniform() >= together:
            out.append(waiting.pop())
            continue
        chosen = rng.permutation(MUSCLES)[: 2 + int(rng.uniform() < 0.25)]
        masses = {str(m): float(round(rng.uniform(0.3, 0.8) * levels[str(m)][-1])) for m in chosen}
        out.append({m: masses[m] for m in MUSCLES if m in masses})
    return [_Load(role, m) for m in out]


def _timed(blocks: Sequence[_Block], start_s: float, before: Sequence[Case] = ()) -> Iterator[Case]:
    """The cases of these blocks one after another, each block with a tare of its own."""
    number, clock = len(before), start_s
    first = max((c.block for c in before), default=-1) + 1
    for k, block in enumerate(blocks):
        began, clock = clock, clock + _TARE_S
        for load in block.loads:
            number += 1
            yield Case(
                id=f"w{number:03d}",
                role=load.role,
                posture=block.posture,
                location=block.location,
                masses_g=load.masses_g,
                unloaded_s=(round(began + 0.4, 2), round(began + _TARE_S - 0.4, 2)),
                loaded_s=(round(clock + 1.6, 2), round(clock + _HOLD_S - 0.1, 2)),
                set_s=round(began, 2),
                hung_s=round(clock, 2),
                block=first + k,
                setting=block.setting,
                repeat_of=load.repeat_of,
            )
            clock += _HOLD_S
