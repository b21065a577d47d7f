"""The rig and its effects by the physics of `tests/simulator`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tests.random_worlds.engines import NAMES, Part, loads
from tests.random_worlds.laws import Law
from tests.random_worlds.protocols import Plan, Rng
from tests.random_worlds.visibility import Visibility
from tests.simulator import CATALOGUE, protocols, rig, situation
from tests.simulator.finger import FLEXIONS, Floats

_LAW_STAGES: tuple[tuple[str, situation.Stage], ...] = (
    ("tension", "tension"),
    ("passing", "sharing"),
    ("torque", "torque"),
    ("force", "reading"),
)


class FirstRig:
    """By `tests/simulator`."""

    def __init__(self, plan: Plan, seed: int, budget: float, scale: float) -> None:
        self.plan = plan
        cases = tuple(
            situation.Case(
                c.id, c.role, c.posture, c.location, c.masses_g, c.unloaded_s, c.loaded_s, c.set_s, c.hung_s, c.setting
            )
            for c in plan.cases
        )
        postures = {n: dict(p) for n, p in plan.postures_deg.items()}
        self._plan = protocols.Protocol(postures, cases, plan.tension_factor, plan.end_s)
        drawn = rig.draw_rig(self._plan, seed, budget)
        f = drawn.finger
        grown = replace(
            f,
            centre=f.centre * scale,
            proximal=f.proximal * scale,
            distal=f.distal * scale,
            load_point=f.load_point * scale,
        )
        self._rig = replace(drawn, finger=grown)

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
        return rig.Acting(effect, size, rng.uniform(-1.0, 1.0, 8))

    def by_place(self, name: str) -> list[Part]:
        """An effect at three tenths of its range, at each of its places by itself."""
        effect = CATALOGUE[name]
        one = np.eye(len(effect.places)) * 0.3 * effect.high
        return [rig.Acting(effect, size, np.zeros(8)) for size in one]

    def sized(self, part: Part, share: float) -> Part:
        """In proportion."""
        return replace(part, size=part.size * share)  # type: ignore[arg-type]

    def read(self, parts: Sequence[Part], passes: Floats | None = None) -> Floats:
        """Laws act after the effects of their stage, the scatter after all that changes a tension."""
        acting = [p for p in parts if isinstance(p, rig.Acting) and p.effect.wander is None]
        for part in parts:
            if isinstance(part, Law):
                acting += _first_law(part)
        if passes is not None:
            acting.append(_first_scatter(self.plan, passes))
        return rig.read_cases(self._rig.with_effects(acting), self._plan)

    def wander(self, parts: Sequence[Part], t_s: Floats) -> Floats:
        """Of a tare that drifts."""
        acting = [p for p in parts if isinstance(p, rig.Acting) and p.effect.wander is not None]
        return rig.wander(self._rig.with_effects(acting), t_s, self.plan.end_s)

    def said(self, part: Part) -> tuple[str, dict[str, float]]:
        """Sizes by place in the catalogue's units."""
        if not isinstance(part, rig.Acting):
            return "", {}
        named = zip(part.effect.places, part.size.tolist(), strict=True)
        return part.effect.name, {place or "size": x for place, x in named if x != 0.0}


def _first_law(law: Law) -> list[rig.Acting]:
    def acts(stage: str, s: situation.Situation) -> None:
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

    def entered(stage: str) -> situation.Acts:
        return lambda s, size, shape: acts(stage, s)

    one = np.ones(1)
    return [
        rig.Acting(situation.Effect(f"composed_{stage}", at, "", 0.0, 1.0, ("",), entered(stage)), one, one)
        for stage, at in _LAW_STAGES
    ]


def _first_scatter(plan: Plan, passes: Floats) -> rig.Acting:
    by_case = dict(zip((c.id for c in plan.cases), passes, strict=True))

    def act(s: situation.Situation, size: Floats, shape: Floats) -> None:
        s.pull = s.pull * by_case[s.case.id]

    return rig.Acting(situation.Effect("scatter", "tension", "", 0.0, 1.0, ("",), act), np.ones(1), np.ones(1))


def nearest_effect(plan: Plan, scale: float, visibility: Visibility, change: Floats) -> tuple[str, float]:
    """The effect of the catalogue that comes nearest to a change, and what it leaves in standard uncertainties."""
    rig = FirstRig(plan, 0, 0.0, scale)
    without = loads(rig, [])
    left: list[tuple[float, str]] = []
    for name in NAMES:
        columns = [loads(rig, [p]) - without for p in rig.by_place(name)]
        # One tendon's pulley is worn, one mount's zero is off: each is an explanation of its own.
        size = {"worn_pulley": 1, "zero_offset": 3}.get(name, len(columns))
        for k in range(0, len(columns), size):
            moving = [c for c in columns[k : k + size] if np.abs(c).max() > 1e-9]
            left.append((visibility.sds(change, moving), name))
    sds, nearest = min(left)
    return nearest, sds
