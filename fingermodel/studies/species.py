"""Two fingers side by side, as Synek et al. 2019 set human and bonobo: bones, moment arms, and force transmission.

Force transmission is how much tendon tension a newton at the tip costs, and how much bone force comes with it. Both are
ratios, so a finger scaled as a whole has the same; what changes them is posture, and moment arms against bone lengths.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from daq.errors import InputError
from fingermodel.studies.species_sides import PLANES, RATIOS, Side, open_side, over, same_angles, shared
from fingermodel.studies.species_steps import Step, steps_between

if TYPE_CHECKING:
    from fingermodel.fingers import Plane
    from fingermodel.studies.published import Row

HUMAN, BONOBO = "synek2019_optimised", "synek2019_bonobo"
# The specimens that the published fingers stand for.
SESSIONS = {HUMAN: "synek2019_HMEAN", BONOBO: "synek2019_B01"}


@dataclass(frozen=True)
class SpeciesResult:
    """Two fingers compared.

    Attributes:
        of: the finger that is held against.
        other: the finger that is compared.
        tendons: loads that both have, most tendons first.
        steps: from the one to the other, empty where they are not built alike.
        rows: a paper's numbers beside ours; none until somebody adds them.
        assumptions: a sentence each.
    """

    of: Side
    other: Side
    tendons: tuple[str, ...]
    steps: tuple[Step, ...]
    rows: tuple[Row, ...]
    assumptions: tuple[str, ...]

    @property
    def main(self) -> str:
        """The load that is compared first: the most tendons that both have."""
        return self.tendons[0]

    @property
    def names(self) -> tuple[str, str]:
        """Short names of the two: their species where that tells them apart."""
        a, b = self.of, self.other
        return (a.species, b.species) if a.species and b.species and a.species != b.species else (a.name, b.name)

    def as_dict(self) -> dict[str, Any]:
        """Return plain data."""
        return {
            "of": self.of.as_dict(),
            "with": self.other.as_dict(),
            "bones": [
                {"bone": name, "of_mm": a, "with_mm": b, "ratio": over(b, a)}
                for name, a, b in shared(self.of.lengths_mm, self.other.lengths_mm)
            ],
            "moment_arms": [
                {"segment": name, "of_mm": a, "with_mm": b, "ratio": over(b, a)}
                for name, a, b in shared(self.of.arms_mm, self.other.arms_mm)
            ],
            "force_ratios": [self._ratio(t, key, p) for t in self.tendons for key in RATIOS for p in PLANES],
            "steps": [dict(step.__dict__) for step in self.steps],
            "rows": [row.as_dict() for row in self.rows],
            "assumptions": list(self.assumptions),
        }

    def _ratio(self, tendons: str, key: str, plane: Plane) -> dict[str, Any]:
        out: dict[str, Any] = {"tendons": tendons, "ratio": key, "plane": plane}
        for kind in ("predicted", "measured"):
            measured = kind == "measured"
            a, b = (side.spread(tendons, key, measured=measured, plane=plane) for side in (self.of, self.other))
            out[kind] = {
                "of": None if a is None else dict(a.__dict__),
                "with": None if b is None else dict(b.__dict__),
                "with_over_of": None if a is None or b is None else b.mean / a.mean,
            }
        return out


def compare_species(
    of: str | None = None,
    other: str | None = None,
    of_session: str | None = None,
    other_session: str | None = None,
    progress: Callable[[float], None] = lambda done: None,
) -> SpeciesResult:
    """Compare two fingers; by default the published human and our bonobo, each with its measured session.

    A side without a session is loaded as the other is, and nothing measured stands beside it.

    Args:
        of: finger, finger file or revision to hold against; by default its session's finger, or the human.
        other: the same of the one to compare; by default its session's finger, or the bonobo.
        of_session: with forces measured on the first.
        other_session: with forces measured on the second.
        progress: called with the fraction done.

    Raises:
        InputError: a finger or session that cannot be read, or that do not fit together.
    """
    names = [
        name or (None if session else default)
        for name, session, default in ((of, of_session, HUMAN), (other, other_session, BONOBO))
    ]
    given = (of_session, other_session)
    own = [session or SESSIONS.get(name or "") for name, session in zip(names, given, strict=True)]
    loads = [own[0] or own[1] or SESSIONS[HUMAN], own[1] or own[0] or SESSIONS[HUMAN]]
    sides = []
    for i, (name, session, load) in enumerate(zip(names, own, loads, strict=True)):
        sides.append(open_side(name, session, load))
        progress((i + 1) / 3)
    first, second = sides
    tendons = _common_tendons(first, second)
    return SpeciesResult(
        of=first,
        other=second,
        tendons=tendons,
        steps=steps_between(first, second, tendons[0]),
        rows=(),
        assumptions=tuple(_assumptions(first, second)),
    )


def _common_tendons(first: Side, second: Side) -> tuple[str, ...]:
    own, others = (dict.fromkeys(load.tendons for load in side.loads) for side in (first, second))
    # The order of a dict is that of the loads; a sort keeps it among combinations of as many tendons.
    common = sorted((t for t in own if t in others), key=lambda name: -name.count("+"))
    if not common:
        raise InputError(
            f"{first.loads_of} loads {', '.join(own) or 'nothing'} at the tip, "
            f"{second.loads_of} {', '.join(others) or 'nothing'}",
            "at least one tendon or combination that both load",
        )
    return tuple(common)


def _assumptions(first: Side, second: Side) -> list[str]:
    out = []
    for side in (first, second):
        if "synek2019_bonobo" in (side.name, side.finger.id):
            out.append(
                "The bonobo's tendon points are not published: ours are the human's scaled by bone length, its flexors "
                "moved to the published mean moment arms. Measured forces do not depend on them."
            )
        if side.session is None:
            out.append(f"{side.label} has no session of its own: it is loaded as {side.loads_of}, and not measured.")
    both = [name for name in first.postures_rad if name in second.postures_rad]
    differ = [name.replace("_", " ") for name in both if not same_angles(first, second, name)]
    if differ:
        out.append(f"Angles differ between the two in: {', '.join(differ)}.")
    out.append("The last bone's length is that of a finger held at mid pulp; files state where it is held alone.")
    return out
