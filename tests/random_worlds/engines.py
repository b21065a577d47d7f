"""Two rigs with a finger, by the two simulators' physics, that go through one protocol.

Each takes effects of the catalogue in its own forms, composed laws, and a scatter from case to case.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol, TypeAlias

import numpy as np

from tests.random_worlds.laws import Law
from tests.random_worlds.protocols import Plan, Rng
from tests.second_simulator import effect_draws, reading
from tests.second_simulator import protocols as second_protocols
from tests.second_simulator import rig as second_rig
from tests.second_simulator import situation as second
from tests.simulator import CATALOGUE
from tests.simulator import protocols as first_protocols
from tests.simulator import rig as first_rig
from tests.simulator import situation as first
from tests.simulator.finger import FLEXIONS, MUSCLES, Floats

Part: TypeAlias = first_rig.Acting | second.Acting | Law
NAMES = tuple(CATALOGUE)
# Sizes of the second simulator that `further` holds too.
_FURTHER_TOO = {"fdp_fds_coupling", "cell_crosstalk"}
_LAW_STAGES: tuple[tuple[str, first.Stage], ...] = (
    ("tension", "tension"),
    ("passing", "sharing"),
    ("torque", "torque"),
    ("force", "reading"),
)


class Engine(Protocol):
    """What reads a protocol's cases."""

    plan: Plan

    def drawn(self, name: str, rng: Rng) -> Part:
        """Draw an effect of the catalogue at its largest."""

    def sized(self, part: Part, share: float) -> Part:
        """The same at a share of its size."""

    def read(self, parts: Sequence[Part], passes: Floats | None = None) -> Floats:
        """What the cell reads without noise, drift apart: (cases, 6) [N, N mm].

        Args:
            parts: what acts.
            passes: (cases, 6) by which the tensions of each case differ from case to case.
        """

    def wander(self, parts: Sequence[Part], t_s: Floats) -> Floats:
        """What the clock adds to the readings (n, 6)."""

    def said(self, part: Part) -> tuple[str, dict[str, float]]:
        """Name of what acts and its sizes."""


def loads(engine: Engine, parts: Sequence[Part], passes: Floats | None = None) -> Floats:
    """(cases, 6) as the windows have it, drift included, tare removed."""
    out = engine.read(parts, passes)
    for i, case in enumerate(engine.plan.cases):
        late, early = (engine.wander(parts, np.linspace(*w, 25)) for w in (case.loaded_s, case.unloaded_s))
        out[i] += late.mean(axis=0) - early.mean(axis=0)
    return out


class FirstRig:
    """By `tests/simulator`."""

    def __init__(self, plan: Plan, seed: int, budget: float, scale: float) -> None:
        self.plan = plan
        cases = tuple(
            first.Case(
                c.id, c.role, c.posture, c.location, c.masses_g, c.unloaded_s, c.loaded_s, c.set_s, c.hung_s, c.setting
            )
            for c in plan.cases
        )
        postures = {n: dict(p) for n, p in plan.postures_deg.items()}
        self._plan = first_protocols.Protocol(postures, cases, plan.tension_factor, plan.end_s)
        rig = first_rig.draw_rig(self._plan, seed, budget)
        f = rig.finger
        grown = replace(
            f,
            centre=f.centre * scale,
            proximal=f.proximal * scale,
            distal=f.distal * scale,
            load_point=f.load_point * scale,
        )
        self._rig = replace(rig, finger=grown)

    def drawn(self, name: str, rng: Rng) -> Part:
        """Any direction among its places; one tendon's pulley is worn, one mount's zero is off."""
        effect = CATALOGUE[name]
        size = rng.uniform(0.0, 1.0, len(effect.places))
        if name == "worn_pulley":
            size[np.arange(6) != rng.integers(6)] = 0.0
        if name == "zero_offset":
            size[3:] *= rng.integers(2)
            size[:3] *= not size[3:].any()
        size *= effect.high / size.max()
        if effect.low < 0.0:
            size *= rng.choice([-1.0, 1.0], len(size))
        return first_rig.Acting(effect, size, rng.uniform(-1.0, 1.0, 8))

    def by_place(self, name: str) -> list[Part]:
        """An effect at three tenths of its range, at each of its places by itself."""
        effect = CATALOGUE[name]
        one = np.eye(len(effect.places)) * 0.3 * effect.high
        return [first_rig.Acting(effect, size, np.zeros(8)) for size in one]

    def sized(self, part: Part, share: float) -> Part:
        """In proportion."""
        return replace(part, size=part.size * share)  # type: ignore[arg-type]

    def read(self, parts: Sequence[Part], passes: Floats | None = None) -> Floats:
        """Laws act after the effects of their stage, the scatter after all that changes a tension."""
        acting = [p for p in parts if isinstance(p, first_rig.Acting) and p.effect.wander is None]
        for part in parts:
            if isinstance(part, Law):
                acting += _first_law(part)
        if passes is not None:
            acting.append(_first_scatter(self.plan, passes))
        return first_rig.read_cases(self._rig.with_effects(acting), self._plan)

    def wander(self, parts: Sequence[Part], t_s: Floats) -> Floats:
        """Of a tare that drifts."""
        acting = [p for p in parts if isinstance(p, first_rig.Acting) and p.effect.wander is not None]
        return first_rig.wander(self._rig.with_effects(acting), t_s, self.plan.end_s)

    def said(self, part: Part) -> tuple[str, dict[str, float]]:
        """Sizes by place in the catalogue's units."""
        if not isinstance(part, first_rig.Acting):
            return "", {}
        named = zip(part.effect.places, part.size.tolist(), strict=True)
        return part.effect.name, {place or "size": x for place, x in named if x != 0.0}


def _first_law(law: Law) -> list[first_rig.Acting]:
    def acts(stage: str, s: first.Situation) -> None:
        flexion = s.angles[FLEXIONS]
        if stage == "tension":
            s.pull = law.pulled(flexion, s.pull)
        elif stage == "torque":
            s.torque = law.turned(flexion, s.pull, s.torque)
        elif stage == "force":
            s.wrench = np.concatenate([law.read(flexion, s.case.location, s.wrench[:3]), s.wrench[3:]])
        elif law.stage == "passing":
            giving, taking = (s.finger.of(m, joint="MCP") for m in law.muscles)
            s.tension = s.tension + law.passed(flexion, s.pull) * (1.0 * taking - 1.0 * giving)

    def entered(stage: str) -> first.Acts:
        return lambda s, size, shape: acts(stage, s)

    one = np.ones(1)
    return [
        first_rig.Acting(first.Effect(f"composed_{stage}", at, "", 0.0, 1.0, ("",), entered(stage)), one, one)
        for stage, at in _LAW_STAGES
    ]


def _first_scatter(plan: Plan, passes: Floats) -> first_rig.Acting:
    by_case = dict(zip((c.id for c in plan.cases), passes, strict=True))

    def act(s: first.Situation, size: Floats, shape: Floats) -> None:
        s.pull = s.pull * by_case[s.case.id]

    return first_rig.Acting(first.Effect("scatter", "tension", "", 0.0, 1.0, ("",), act), np.ones(1), np.ones(1))


@dataclass(frozen=True)
class _ActingLaw(second.Acting):
    law: Law = field(default_factory=lambda: Law("passing"))


@dataclass(frozen=True)
class Named(second.Acting):
    """An effect of the second simulator that knows its name."""

    name: str = ""


class SecondRig:
    """By `tests/second_simulator`."""

    def __init__(self, plan: Plan, rng: Rng, budget: float, scale: float) -> None:
        self.plan = plan
        cases = tuple(
            second.Case(
                id=c.id,
                role=c.role,
                posture=c.posture,
                location=c.location,
                masses_g=c.masses_g,
                unloaded_s=c.unloaded_s,
                loaded_s=c.loaded_s,
                setting=c.setting,
                mounting=0,
                block=c.block,
            )
            for c in plan.cases
        )
        # Angles are whole numbers here, as a goniometer has them.
        postures = {n: {j: round(a) for j, a in p.items()} for n, p in plan.postures_deg.items()}
        drawn = second_rig.draw_rig(second_protocols.Protocol("random", postures, cases), rng, budget)
        for strand in drawn.finger.strands.values():
            strand.proximal, strand.distal = strand.proximal * scale, strand.distal * scale
        for bone in drawn.finger.shaft:
            drawn.finger.shaft[bone] *= scale
        self._rig = drawn

    def drawn(self, name: str, rng: Rng) -> Part:
        """In one of its forms."""
        a = effect_draws.draw_effect(name, rng)
        return Named(a.form, a.size, a.at, a.own, a.further, name)

    def sized(self, part: Part, share: float) -> Part:
        """In proportion, in what else has the same size too."""
        if isinstance(part, Named) and part.name in _FURTHER_TOO:
            return replace(part, size=part.size * share, further=part.further * share)
        return replace(part, size=part.size * share)  # type: ignore[arg-type]

    def read(self, parts: Sequence[Part], passes: Floats | None = None) -> Floats:
        """Laws act after the effects of their stage, the scatter after all that changes a tension."""
        acting: dict[str, second.Acting] = {p.name: p for p in parts if isinstance(p, Named)}
        for part in parts:
            if isinstance(part, Law):
                acting |= {f"composed_{s}": _ActingLaw(f"{s}_law", np.ones(1), law=part) for s, _ in _LAW_STAGES}
        if passes is not None:
            at = zip(self.plan.cases, passes.tolist(), strict=True)
            own = {f"{c.id}.{m}": x for c, row in at for m, x in zip(MUSCLES, row, strict=True)}
            acting["scatter"] = second.Acting("from_case_to_case", np.ones(1), own=own)
        rig = self._rig.with_only(acting)
        return np.array([reading.read(rig, case) for case in rig.plan.cases])

    def wander(self, parts: Sequence[Part], t_s: Floats) -> Floats:
        """Of a tare that drifts, and of every rig's own creep."""
        rig = self._rig.with_only({p.name: p for p in parts if isinstance(p, Named)})
        return np.column_stack([reading.wander(rig, t_s), np.zeros((len(t_s), 3))])

    def said(self, part: Part) -> tuple[str, dict[str, float]]:
        """Sizes in its own units, with the form."""
        if not isinstance(part, Named):
            return "", {}
        sizes = {f"{part.form}.{i}": float(x) for i, x in enumerate(part.size.flat)}
        return part.name, sizes


def _law_of(a: second.Acting) -> Law:
    if not isinstance(a, _ActingLaw):
        raise TypeError("not a law")
    return a.law


def _pull(s: second.Situation) -> Floats:
    return np.array([s.pull[m] for m in MUSCLES])


@second.form("composed_tension", "tension")
def tension_law(s: second.Situation, a: second.Acting) -> None:
    """In the posture as stated and as the rig has it, before effects move it."""
    s.pull = dict(zip(MUSCLES, _law_of(a).pulled(s.flexion, _pull(s)).tolist(), strict=True))


@second.form("scatter", "tension")
def from_case_to_case(s: second.Situation, a: second.Acting) -> None:
    """Each tension by itself."""
    s.pull = {m: pull * a.own[f"{s.case.id}.{m}"] for m, pull in s.pull.items()}


@second.form("composed_passing", "sharing")
def passing_law(s: second.Situation, a: second.Acting) -> None:
    """At the MCP."""
    law = _law_of(a)
    if law.stage == "passing":
        passed = law.passed(s.flexion, _pull(s))
        s.tension[law.muscles[0], "MCP"] -= passed
        s.tension[law.muscles[1], "MCP"] += passed


@second.form("composed_torque", "torque")
def torque_law(s: second.Situation, a: second.Acting) -> None:
    """After all that the joints do by themselves."""
    s.torque = _law_of(a).turned(s.flexion, _pull(s), s.torque)


@second.form("composed_force", "cell")
def force_law(s: second.Situation, a: second.Acting) -> None:
    """In the cell's own axes."""
    s.force = _law_of(a).read(s.flexion, s.case.location, s.force)
