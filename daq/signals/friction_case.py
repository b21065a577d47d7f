"""The force balance of one posture and set of weights."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class FrictionCase:
    """Force balance of one posture and set of weights.

    Attributes:
        session: id; specimen: id.
        posture: name.
        masses_g: on each tendon.
        direction: loading or unloading; tapped where the rig was tapped before the reading, which its note says.
        tip_cases: ids of the tip readings; bone_cases: of the bone readings; repeats are averaged.
        weight_N: Σ m g.
        factor: c of Eq 1.
        factor_sd: its standard uncertainty from the readings alone, None where they state none.
        along: component of the balance along +x of the metacarpal, over Σ m g, signed.
        across: length of its component across, over Σ m g.
        above_one: whether c > 1 and no friction explains it: on unloading it does.
    """

    session: str
    specimen: str
    posture: str
    masses_g: dict[str, float]
    direction: str
    tip_cases: tuple[str, ...]
    bone_cases: tuple[str, ...]
    weight_N: float
    factor: float
    factor_sd: float | None
    along: float
    across: float
    above_one: bool
