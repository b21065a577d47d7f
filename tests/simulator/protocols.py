"""What is hung on which tendon, in which posture and when."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import yaml

from tests.simulator.finger import DATA
from tests.simulator.situation import Case


@dataclass(frozen=True)
class Protocol:
    """Load cases in order of time.

    Attributes:
        postures_deg: joint angles by posture and rotation, flexion positive.
        cases: of every block.
        tension_factor: that the rig is said to have.
        end_s: when the protocol ends; further cases may follow.
    """

    postures_deg: dict[str, dict[str, float]]
    cases: tuple[Case, ...]
    tension_factor: float
    end_s: float

    @property
    def last_s(self) -> float:
        """Length of the record."""
        return max(self.end_s, self.cases[-1].loaded_s[1] + 0.1)

    def with_further(self, further: Sequence[tuple[str, str, Mapping[str, float]]]) -> Protocol:
        """The same with identification cases after its end: (posture, location, masses), each in a posture set anew."""
        cases, clock = list(self.cases), self.end_s + 1.0
        for posture, location, masses in further:
            same = [c for c in cases if c.posture == posture]
            start, clock = clock, clock + _TARE_S
            cases.append(
                Case(
                    id=f"f{len(cases) - len(self.cases) + 1:02d}",
                    role="identification",
                    posture=posture,
                    location=location,
                    masses_g=dict(masses),
                    unloaded_s=(start + 0.5, clock - 0.5),
                    loaded_s=(clock + 2.0, clock + _HOLD_S - 0.5),
                    block_start_s=start,
                    load_start_s=clock,
                    setting=1 + max(c.setting for c in same),
                    mounting=max(c.mounting for c in cases if c.location == location),
                )
            )
            clock += _HOLD_S
        return replace(self, cases=tuple(cases))


@cache
def dev() -> Protocol:
    """The ninety-six cases of the shipped development sessions: five postures, two load levels, tip then bone."""
    text = (DATA / "sessions" / "DEV-02" / "session.yaml").read_text(encoding="utf-8")
    document = yaml.load(text, getattr(yaml, "CSafeLoader", yaml.SafeLoader))  # noqa: S506 - safe either way
    cases = tuple(
        Case(
            id=c["id"],
            role=c["role"],
            posture=c["posture"],
            location=c["location"],
            masses_g=c["masses_g"],
            unloaded_s=(c["unloaded_s"][0], c["unloaded_s"][1]),
            loaded_s=(c["loaded_s"][0], c["loaded_s"][1]),
            block_start_s=round(c["unloaded_s"][0] - 0.4, 3),
            load_start_s=round(c["loaded_s"][0] - 1.6, 3),
        )
        for c in document["cases"]
    )
    postures = {n: {k: float(v) for k, v in p.items()} for n, p in document["postures_deg"].items()}
    return Protocol(postures, cases, float(document["tension_factor"]), cases[-1].loaded_s[1] + 0.1)


@cache
def short() -> Protocol:
    """Fifty-nine of the cases of `dev`, for tests that need no more: one posture less, and single tendons at one level.

    That is the higher one of the two in one posture, and the lower one in the next.
    """
    whole = dev()
    postures = [name for name in whole.postures_deg if name != "hook"]
    turn = {name: k for k, name in enumerate(postures)}

    def kept(case: Case) -> bool:
        single = case.role == "identification" and case.location == "tip" and len(case.masses_g) == 1
        return case.posture in turn and not (single and (int(case.id[1:]) + turn[case.posture]) % 2)

    return replace(
        whole,
        postures_deg={name: whole.postures_deg[name] for name in postures},
        cases=tuple(filter(kept, whole.cases)),
    )


_LEVELS = (
    {"RI": 200.0, "LU": 20.0, "UI": 150.0, "FDP": 250.0, "FDS": 300.0, "EDC": 120.0},
    {"RI": 450.0, "LU": 40.0, "UI": 350.0, "FDP": 550.0, "FDS": 600.0, "EDC": 260.0},
    {"RI": 700.0, "LU": 60.0, "UI": 550.0, "FDP": 900.0, "FDS": 900.0, "EDC": 420.0},
)
_TARE_S, _HOLD_S = 6.0, 6.0


@cache
def three_levels() -> Protocol:
    """Eighty-four cases in four postures: levels interleaved, and five bone readings in each of two.

    For the bone readings the postures are set anew; one posture serves validation alone.
    """
    postures = {
        "pinch": {"MCP": 45.0, "PIP": 40.0, "DIP": 20.0, "abduction": 0.0},
        "claw": {"MCP": 5.0, "PIP": 70.0, "DIP": 40.0, "abduction": 0.0},
        "stretched": {"MCP": -15.0, "PIP": 35.0, "DIP": 30.0, "abduction": 0.0},
        "cylinder": {"MCP": 30.0, "PIP": 50.0, "DIP": 30.0, "abduction": 0.0},
    }
    single = [{m: level[m]} for level in _LEVELS for m in level]
    fitted = [*single, {"FDP": 550.0, "LU": 60.0}, {"FDP": 450.0, "FDS": 450.0}]
    unseen = [{"FDP": 700.0, "FDS": 500.0}, {"FDS": 500.0, "EDC": 260.0}]
    at_bone = [{"FDP": 900.0}, {"FDS": 900.0}, {"EDC": 420.0}, {"FDP": 450.0, "FDS": 450.0}]
    blocks = [(p, "tip", 0, fitted, unseen) for p in ("pinch", "claw", "stretched")]
    blocks.append(("cylinder", "tip", 0, [], [*single[12:], *unseen]))
    blocks += [(p, "bone", 1, at_bone, unseen[:1]) for p in ("pinch", "stretched")]
    cases: list[Case] = []
    clock = 0.0
    for posture, location, setting, identification, validation in blocks:
        start, clock = clock, clock + _TARE_S
        hung = [("identification", m) for m in identification] + [("validation", m) for m in validation]
        for role, masses in hung:
            cases.append(
                Case(
                    id=f"k{len(cases) + 1:03d}",
                    role=role,
                    posture=posture,
                    location=location,
                    masses_g=masses,
                    unloaded_s=(start + 0.5, start + _TARE_S - 0.5),
                    loaded_s=(clock + 2.0, clock + _HOLD_S - 0.5),
                    block_start_s=start,
                    load_start_s=clock,
                    setting=setting,
                )
            )
            clock += _HOLD_S
    return Protocol(postures, tuple(cases), 0.87, clock)


PROTOCOLS = {"dev": dev, "short": short, "three_levels": three_levels}
