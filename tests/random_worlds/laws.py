"""Laws that no catalogue has: a stage, muscles or a joint, a function of an angle and one of the load.

A law is dimensionally sound by its making: both functions are pure numbers and `size` has the unit of the stage.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from tests.random_worlds.protocols import RANGES_DEG, Rng
from tests.simulator.finger import JOINTS, MUSCLES, ROTATIONS, Floats

# Where it acts. `passing`: tension of one tendon goes to another at the MCP; `passive`: a torque of its own.
Stage = Literal["tension", "passing", "arm", "share", "passive", "force"]
UNITS: dict[Stage, str] = {"tension": "1", "passing": "1", "arm": "mm", "share": "1", "passive": "N mm", "force": "1"}
# Beyond these a law would be no fault of a rig but another finger.
LARGEST: dict[Stage, float] = {
    "tension": 0.5,
    "passing": 0.6,
    "arm": 8.0,
    "share": 0.5,
    "passive": 120.0,
    "force": 0.3,
}
_HOOD, _INTRINSICS, _FLEXORS = {"RI", "LU", "UI", "EDC"}, {"RI", "LU", "UI"}, {"FDP", "FDS"}
_RISING = {"sine", "versine", "past"}

# Of an angle, its centre and its width [rad].
ANGLES: dict[str, Callable[[float, float, float], float]] = {
    "any": lambda q, c, w: 1.0,
    "sine": lambda q, c, w: float(np.sin(q)),
    "versine": lambda q, c, w: float(1.0 - np.cos(q)),
    "about": lambda q, c, w: float(np.sin(2.0 * (q - c))),
    "bump": lambda q, c, w: float(np.exp(-(((q - c) / w) ** 2))),
    "past": lambda q, c, w: float(1.0 / (1.0 + np.exp(-3.0 * (q - c) / w))),
}
# Of a load as a share of the heaviest, and of a turning point or power.
LOADS: dict[str, Callable[[float, float], float]] = {
    "any": lambda x, c: 1.0,
    "power": lambda x, c: float(max(x, 1e-6) ** c),
    "saturating": lambda x, c: float(x / (x + c)),
    "threshold": lambda x, c: float(0.05 * np.logaddexp(0.0, (x - c) / 0.05) / (1.0 - c)),
}


@dataclass(frozen=True)
class Law:
    """One law with its size.

    Attributes:
        stage: where it acts.
        size: in the unit of its stage.
        muscles: on which it acts; for `passing` the giving one, then the taking one; none for joints and the cell.
        joint: rotation about which it acts, for `arm`, `share` and `passive`.
        angle_of: joint whose angle counts.
        angle: name of the function of that angle; centre and width in rad.
        load: name of the function of the load; turn is its turning point or power.
        mount: where the cell reads wrongly; axes: the component that changes, then the one that leaks.
        full_N: by muscle, and `all` for their sum, the tension that counts as a whole load.
    """

    stage: Stage
    size: float = 1.0
    muscles: tuple[str, ...] = ()
    joint: str = ""
    angle_of: str = "MCP"
    angle: str = "any"
    centre: float = 0.0
    width: float = 0.5
    load: str = "any"
    turn: float = 0.5
    mount: str = ""
    axes: tuple[int, int] = (0, 0)
    full_N: Mapping[str, float] = field(default_factory=dict)

    def factor(self, flexion: Floats, load_N: float, of: str) -> float:
        """Size times both functions, for angles (3,) of MCP, PIP, DIP [rad] and a load [N]."""
        q = float(flexion[JOINTS.index(self.angle_of)])
        by_load = LOADS[self.load](load_N / self.full_N[of], self.turn)
        return self.size * ANGLES[self.angle](q, self.centre, self.width) * by_load

    def pulled(self, flexion: Floats, pull: Floats) -> Floats:
        """Tensions (6,) [N] behind the pulleys, of which the cells and the joints feel the same."""
        if self.stage != "tension":
            return pull
        share = [self.factor(flexion, t, m) if m in self.muscles else 0.0 for m, t in zip(MUSCLES, pull, strict=True)]
        return pull * (1.0 + np.array(share))

    def passed(self, flexion: Floats, pull: Floats) -> float:
        """Tension that goes from the first muscle to the second at the MCP [N]."""
        if self.stage != "passing":
            return 0.0
        giving = float(pull[MUSCLES.index(self.muscles[0])])
        return self.factor(flexion, giving, self.muscles[0]) * giving

    def turned(self, flexion: Floats, pull: Floats, torque: Floats) -> Floats:
        """Joint torques (4,) about MCP, abduction, PIP and DIP [N mm]."""
        if self.stage not in ("arm", "share", "passive"):
            return torque
        out, i = torque.copy(), ROTATIONS.index(self.joint)
        if self.stage == "arm":
            tension = dict(zip(MUSCLES, pull.tolist(), strict=True))
            out[i] += sum(self.factor(flexion, tension[m], m) * tension[m] for m in self.muscles)
        elif self.stage == "share":
            out[i] *= 1.0 + self.factor(flexion, float(pull.sum()), "all")
        else:
            out[i] += self.factor(flexion, float(pull.sum()), "all")
        return out

    def read(self, flexion: Floats, location: str, force: Floats) -> Floats:
        """Force (3,) as the cell has it [N]."""
        if self.stage != "force" or location != self.mount:
            return force
        out, (to, of) = force.copy(), self.axes
        # A whole load at the cell is taken as a third of the tendons' sum.
        out[to] += self.factor(flexion, 3.0 * float(np.linalg.norm(force)), "all") * force[of]
        return out

    @property
    def words(self) -> str:
        """What it is, on one line."""
        where = {"force": f"{self.mount} {'xyz'[self.axes[0]]} by {'xyz'[self.axes[1]]}"}.get(self.stage, self.joint)
        whose = " to ".join(self.muscles) if self.stage == "passing" else "+".join(self.muscles)
        angle = f"{self.angle} of {self.angle_of}" if self.angle != "any" else "any angle"
        load = f"{self.load} {self.turn:.2g} of load" if self.load != "any" else "any load"
        return ", ".join(
            w for w in (f"{self.stage} {self.size:.3g} {UNITS[self.stage]}", whose, where, angle, load) if w
        )


def same_as(law: Law) -> str | None:
    """The effect of the catalogue, or the part of every rig's budget, whose structure a law has; none for most."""
    muscles, own = set(law.muscles), law.angle_of == law.joint
    plain_load, plain_angle = law.load == "any", law.angle == "any"
    if law.stage == "tension" and plain_load:
        if plain_angle:
            return "rig_friction" if len(muscles) > 1 else "worn_pulley"
        return "sheath_friction" if muscles <= _FLEXORS and law.angle in _RISING else None
    if law.stage == "passing":
        named = {frozenset(("FDP", "FDS")): "fdp_fds_coupling", frozenset(("LU", "FDP")): "lumbrical_on_fdp"}
        return named.get(frozenset(muscles))
    if law.stage == "arm":
        return _known_arm(law, muscles, own)
    if law.stage == "share" and plain_load:
        return "joint_friction" if plain_angle else ("volar_plate" if law.joint == "MCP" and own else None)
    if law.stage == "passive" and plain_load:
        # What does not change with the load is in the tare, too.
        return "zero_offset"
    return "cell_crosstalk" if law.stage == "force" and plain_load and plain_angle else None


def _known_arm(law: Law, muscles: set[str], own: bool) -> str | None:
    plain_load, rising = law.load == "any", law.angle in _RISING
    if plain_load and law.angle == "any":
        return "budget"
    if plain_load and own and len(muscles) == len(MUSCLES):
        return "centre_migration"
    if muscles <= _FLEXORS and own and rising and law.load in ("power", "saturating"):
        return "bowstringing"
    if plain_load and muscles <= _INTRINSICS and law.joint == "MCP" and own and rising:
        return "intrinsic_bowstring"
    if plain_load and muscles <= _HOOD and law.joint in ("PIP", "DIP") and law.angle_of in ("MCP", "PIP"):
        return "lateral_band_slip" if own else "hood_shift"
    return None


def draw_law(rng: Rng, full_N: Mapping[str, float]) -> Law:
    """Draw a law of the largest size that is none of the catalogue's."""
    while True:
        law = _drawn(rng, full_N)
        if same_as(law) is None:
            return law


def _drawn(rng: Rng, full_N: Mapping[str, float]) -> Law:
    stage: Stage = list(UNITS)[int(rng.integers(len(UNITS)))]
    muscles: tuple[str, ...] = ()
    if stage in ("tension", "passing", "arm"):
        count = 2 if stage == "passing" else int(rng.choice([1, 2, 6], p=[0.6, 0.3, 0.1]))
        muscles = tuple(str(m) for m in rng.permutation(MUSCLES)[:count])
    angle_of = str(rng.choice(JOINTS))
    low, high = np.deg2rad(RANGES_DEG[angle_of])
    load = str(rng.choice(list(LOADS)))
    return Law(
        stage=stage,
        size=LARGEST[stage] * float(rng.choice([-1.0, 1.0])),
        muscles=muscles,
        joint=str(rng.choice(ROTATIONS)) if stage in ("arm", "share", "passive") else "",
        angle_of=angle_of,
        angle=str(rng.choice(list(ANGLES))),
        centre=float(low + (high - low) * rng.uniform(0.2, 0.8)),
        width=float((high - low) * rng.uniform(0.2, 0.5)),
        load=load,
        turn=float(rng.choice([0.5, 1.0, 2.0])) if load == "power" else float(rng.uniform(0.2, 0.7)),
        mount=str(rng.choice(["tip", "bone"])) if stage == "force" else "",
        axes=(int(rng.integers(3)), int(rng.integers(3))),
        full_N=dict(full_N),
    )
