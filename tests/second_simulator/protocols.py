"""What is hung on which tendon, in which posture and when: three protocols of ninety-six cases."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
import yaml

from tests.second_simulator.finger import DATA, JOINTS, MUSCLES
from tests.second_simulator.situation import Case

Masses: TypeAlias = dict[str, float]
_CASES = 96
_TARE_AFTER_S = 4.6
_Role = Literal["identification", "validation"]
_I: _Role = "identification"
_V: _Role = "validation"


@dataclass(frozen=True)
class Protocol:
    """Load cases in order of time, and the postures as they are stated."""

    name: str
    postures_deg: Mapping[str, Mapping[str, int]]
    cases: tuple[Case, ...]

    @property
    def end_s(self) -> float:
        """Length of the record."""
        return max(max(c.loaded_s[1], (c.unloaded_after_s or (0.0, 0.0))[1]) for c in self.cases) + 0.1

    @property
    def fitted_postures(self) -> list[str]:
        """Those with identification cases."""
        return sorted({c.posture for c in self.cases if c.role == "identification"})


class _Load(NamedTuple):
    role: _Role
    masses_g: Masses
    direction: str | None = None
    repeat_of: str | None = None


@dataclass(frozen=True)
class _Block:
    posture: str
    location: str
    loads: Sequence[_Load]
    setting: int | None = None
    mounting: int | None = None


@dataclass(frozen=True)
class _Clock:
    """How long a tare and a load take, and whether a block ends with a second tare."""

    tare_s: float
    load_s: float
    tare_after: bool = False

    def timed(self, blocks: Sequence[_Block]) -> tuple[Case, ...]:
        """The cases of these blocks, one after another."""
        out: list[Case] = []
        now = 0.0
        for number, block in enumerate(blocks):
            tare = (round(now + 0.4, 2), round(now + self.tare_s - 0.2, 2))
            start = now + self.tare_s
            starts = [start]
            for _ in block.loads:
                starts.append(starts[-1] + self.load_s)
            now = starts.pop()
            after = (round(now + 1.6, 2), round(now + 4.4, 2)) if self.tare_after else None
            for begun, load in zip(starts, block.loads, strict=True):
                out.append(
                    Case(
                        id=f"c{len(out) + 1:03d}",
                        role=load.role,
                        posture=block.posture,
                        location=block.location,
                        masses_g=load.masses_g,
                        unloaded_s=tare,
                        loaded_s=(round(begun + 1.6, 2), round(begun + self.load_s - 0.1, 2)),
                        unloaded_after_s=after,
                        setting=block.setting,
                        mounting=block.mounting,
                        repeat_of=load.repeat_of,
                        direction=load.direction,
                        block=number,
                    )
                )
            now += _TARE_AFTER_S if self.tare_after else 0.0
        return tuple(out)


@cache
def _shipped() -> tuple[dict[str, dict[str, int]], tuple[Case, ...]]:
    text = (DATA / "sessions" / "DEV-01" / "session.yaml").read_text(encoding="utf-8")
    document: dict[str, Any] = yaml.load(text, getattr(yaml, "CSafeLoader", yaml.SafeLoader))  # noqa: S506 - safe either way
    cases: list[Case] = []
    for c in document["cases"]:
        tare = (c["unloaded_s"][0], c["unloaded_s"][1])
        block = cases[-1].block + (tare != cases[-1].unloaded_s) if cases else 0
        windows = {"unloaded_s": tare, "loaded_s": (c["loaded_s"][0], c["loaded_s"][1])}
        cases.append(Case(**{**c, **windows}, block=block))
    return document["postures_deg"], tuple(cases)


def shipped(rng: np.random.Generator) -> Protocol:
    """Five postures and two levels, tip then bone, as in the shipped development sessions."""
    postures, cases = _shipped()
    return Protocol("a", postures, cases)


def _jittered(rng: np.random.Generator, about: Mapping[str, tuple[int, int, int]]) -> dict[str, dict[str, int]]:
    """Postures that are each up to 5° from these."""
    return {
        name: {**{j: round(v + rng.uniform(-5, 5)) for j, v in zip(JOINTS, angles, strict=True)}, "abduction": 0}
        for name, angles in about.items()
    }


def own_masses(rng: np.random.Generator) -> Protocol:
    """Masses and postures of its own: three levels where weights are heavy, one posture for validation alone."""
    postures = _jittered(
        rng,
        {
            "grip": (50, 62, 30),
            "pinch": (32, 44, 22),
            "claw": (-20, 62, 44),
            "platform": (8, 72, 38),
            "rest": (22, 28, 18),
        },
    )
    postures["claw"]["MCP"] = int(rng.integers(-24, -14))
    levels: dict[str, tuple[float, ...]] = {
        "RI": (150.0, 400.0, 700.0),
        "LU": (20.0, 60.0),
        "UI": (180.0, 520.0),
        "FDP": (300.0, 600.0, 900.0),
        "FDS": (300.0, 600.0, 900.0),
        "EDC": (150.0, 450.0),
    }
    blocks: list[_Block] = []
    for posture in ("grip", "pinch", "claw", "platform"):
        loads = [_Load(_I, {m: x}) for m in MUSCLES for x in levels[m]]
        loads += [_Load(_I, {"FDP": 550.0, "LU": 180.0}), _Load(_I, {"FDP": 450.0, "FDS": 650.0})]
        loads += [_Load(_V, {"FDP": 900.0, "FDS": 900.0}), _Load(_V, {"FDS": 500.0, "EDC": 350.0})]
        blocks.append(_Block(posture, "tip", loads))
    unseen = [_Load(_V, {m: levels[m][-1]}) for m in MUSCLES]
    blocks.append(_Block("rest", "tip", [*unseen, _Load(_V, {"FDP": 700.0, "FDS": 500.0})]))
    only_here = {"grip": [{"FDS": 900.0}], "claw": [{m: levels[m][-1]} for m in ("RI", "UI", "EDC")], "platform": []}
    for posture, further in only_here.items():
        both = [{"FDP": 600.0, "FDS": 600.0}, {"FDP": 250.0, "FDS": 250.0}]
        loads = [_Load(_I, masses) for masses in [*both, *further]]
        blocks.append(_Block(posture, "bone", [*loads, _Load(_V, {"FDP": 900.0, "FDS": 900.0})]))
    return Protocol("b", postures, _Clock(4.4, 5.2).timed(blocks))


_LEVELS = {
    "RI": (250.0, 650.0),
    "LU": (20.0, 50.0),
    "UI": (200.0, 500.0),
    "FDP": (400.0, 950.0),
    "FDS": (400.0, 950.0),
    "EDC": (160.0, 400.0),
}


def both_ways(rng: np.random.Generator) -> Protocol:
    """Loading and unloading, counted settings and mountings, a tare before and after, and repeats at the end."""
    postures = _jittered(
        rng,
        {
            "major_flexion": (56, 56, 27),
            "minor_flexion": (38, 52, 33),
            "hook": (2, 66, 48),
            "hyperextension": (-21, 50, 44),
            "open": (18, 33, 17),
        },
    )
    postures["hyperextension"]["MCP"] = int(rng.integers(-25, -16))

    def up(role: _Role, **masses_g: float) -> _Load:
        return _Load(role, masses_g, "loading")

    blocks: list[_Block] = []
    for posture in ("minor_flexion", "major_flexion", "hook", "hyperextension"):
        loads = []
        for m, level in _LEVELS.items():
            loads += [up(_I, **{m: x}) for x in level]
            if m in ("RI", "FDP", "FDS"):
                loads.append(_Load(_I, {m: level[0]}, "unloading"))
        loads += [up(_I, FDP=600.0, LU=200.0), up(_V, FDP=950.0, FDS=950.0), up(_V, FDP=500.0, EDC=300.0)]
        blocks.append(_Block(posture, "tip", loads, len(blocks) + 1, 1))
    unseen = [up(_V, **{m: level[-1]}) for m, level in _LEVELS.items()]
    blocks.append(_Block("open", "tip", [*unseen, up(_V, FDP=700.0, FDS=700.0)], len(blocks) + 1, 1))
    for posture in ("minor_flexion", "hyperextension", "hook"):
        loads = [up(_I, FDP=285.0, FDS=285.0), up(_I, FDP=665.0, FDS=665.0)]
        if posture != "hook":
            loads.append(_Load(_I, {"FDP": 285.0, "FDS": 285.0}, "unloading"))
        if posture == "hyperextension":
            loads.append(up(_I, EDC=400.0))
        blocks.append(_Block(posture, "bone", [*loads, up(_V, FDP=950.0, FDS=950.0)], len(blocks) + 1, 2))
    # The first block is the one whose heavier loads are repeated, with the cell back at the tip.
    first = {tuple(x.masses_g.items()): i for i, x in enumerate(blocks[0].loads, 1) if x.direction == "loading"}
    heavy = [(m, _LEVELS[m][1]) for m in ("RI", "UI", "FDP", "FDS", "EDC")]
    repeats = [_Load(_I, {m: x}, "loading", f"c{first[((m, x),)]:03d}") for m, x in heavy]
    room = _CASES - sum(len(b.loads) for b in blocks)
    blocks.append(_Block("minor_flexion", "tip", repeats[:room], len(blocks) + 1, 3))
    return Protocol("c", postures, _Clock(4.6, 5.4, tare_after=True).timed(blocks))


PROTOCOLS = {"a": shipped, "b": own_masses, "c": both_ways}
