"""The rig and its effects by the physics of `tests/second_simulator`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tests.random_worlds.engines import Part
from tests.random_worlds.laws import Law
from tests.random_worlds.protocols import Plan, Rng
from tests.second_simulator import effect_draws, protocols, reading, rig, situation
from tests.simulator.finger import MUSCLES, Floats

# Effects whose sizes `further` holds too.
_FURTHER_TOO = {"fdp_fds_coupling", "cell_crosstalk"}
_LAW_STAGES = ("tension", "passing", "torque", "force")


@dataclass(frozen=True)
class _ActingLaw(situation.Acting):
    law: Law = field(default_factory=lambda: Law("passing"))


@dataclass(frozen=True)
class Named(situation.Acting):
    """An effect of the second simulator that knows its name."""

    name: str = ""


class SecondRig:
    """By `tests/second_simulator`."""

    def __init__(self, plan: Plan, rng: Rng, budget: float, scale: float) -> None:
        self.plan = plan
        cases = tuple(
            situation.Case(
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
        drawn = rig.draw_rig(protocols.Protocol("random", postures, cases), rng, budget)
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
        acting: dict[str, situation.Acting] = {p.name: p for p in parts if isinstance(p, Named)}
        for part in parts:
            if isinstance(part, Law):
                acting |= {f"composed_{s}": _ActingLaw(f"{s}_law", np.ones(1), law=part) for s in _LAW_STAGES}
        if passes is not None:
            at = zip(self.plan.cases, passes.tolist(), strict=True)
            own = {f"{c.id}.{m}": x for c, row in at for m, x in zip(MUSCLES, row, strict=True)}
            acting["scatter"] = situation.Acting("from_case_to_case", np.ones(1), own=own)
        acted = self._rig.with_only(acting)
        return np.array([reading.read(acted, case) for case in acted.plan.cases])

    def wander(self, parts: Sequence[Part], t_s: Floats) -> Floats:
        """Of a tare that drifts, and of every rig's own creep."""
        acted = self._rig.with_only({p.name: p for p in parts if isinstance(p, Named)})
        return np.column_stack([reading.wander(acted, t_s), np.zeros((len(t_s), 3))])

    def said(self, part: Part) -> tuple[str, dict[str, float]]:
        """Sizes in its own units, with the form."""
        if not isinstance(part, Named):
            return "", {}
        sizes = {f"{part.form}.{i}": float(x) for i, x in enumerate(part.size.flat)}
        return part.name, sizes


def _law_of(a: situation.Acting) -> Law:
    if not isinstance(a, _ActingLaw):
        raise TypeError("not a law")
    return a.law


def _pull(s: situation.Situation) -> Floats:
    return np.array([s.pull[m] for m in MUSCLES])


@situation.form("composed_tension", "tension")
def tension_law(s: situation.Situation, a: situation.Acting) -> None:
    """In the posture as stated and as the rig has it, before effects move it."""
    s.pull = dict(zip(MUSCLES, _law_of(a).pulled(s.flexion, _pull(s)).tolist(), strict=True))


@situation.form("scatter", "tension")
def from_case_to_case(s: situation.Situation, a: situation.Acting) -> None:
    """Each tension by itself."""
    s.pull = {m: pull * a.own[f"{s.case.id}.{m}"] for m, pull in s.pull.items()}


@situation.form("composed_passing", "sharing")
def passing_law(s: situation.Situation, a: situation.Acting) -> None:
    """At the MCP."""
    law = _law_of(a)
    if law.stage == "passing":
        passed = law.passed(s.flexion, _pull(s))
        s.tension[law.muscles[0], "MCP"] -= passed
        s.tension[law.muscles[1], "MCP"] += passed


@situation.form("composed_torque", "torque")
def torque_law(s: situation.Situation, a: situation.Acting) -> None:
    """After all that the joints do by themselves."""
    s.torque = _law_of(a).turned(s.flexion, _pull(s), s.torque)


@situation.form("composed_force", "cell")
def force_law(s: situation.Situation, a: situation.Acting) -> None:
    """In the cell's own axes."""
    s.force = _law_of(a).read(s.flexion, s.case.location, s.force)
