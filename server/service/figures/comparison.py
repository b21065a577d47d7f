"""Figures of predicted against measured forces: of all cases as the command line draws them, or of some, in a plane."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from fingermodel.fingers.finger import Plane
from fingermodel.session import Session
from server.figures.compared import Compared
from server.figures.comparison import comparison_plans
from server.figures.vectors import Beside

if TYPE_CHECKING:
    import plotly.graph_objects as go

    from fingermodel.comparison.comparison import Comparison
    from server.figures.arrows import Spread


@dataclass(frozen=True)
class Only:
    """Selection of load cases to draw, and of components of their forces."""

    plane: Plane | None = None  # the sagittal one or space; None for that in which the finger is judged
    role: str | None = None  # identification, validation or all; None for both, on the finger those of validation alone
    location: str | None = None  # tip or bone
    posture: str | None = None  # its name
    muscles: str | None = None  # that are loaded, such as `FDP+FDS`

    def of(self, comparison: Comparison) -> Comparison:
        """Return those cases of a comparison."""
        role = None if self.role == "all" else self.role
        return comparison.select(role, self.location, self.muscles, self.posture)


def drawn_comparison(
    name: str,
    bench: Session,
    comparison: Comparison,
    only: Only,
    before: tuple[str, Session, Comparison] | None,
    spread: Mapping[str, Spread] | None,
) -> tuple[go.Figure, str]:
    """Draw a figure and return it with its caption.

    Args:
        name: of the figure.
        bench: that was compared.
        comparison: of all cases that may be seen.
        only: choice of cases that are drawn.
        before: name, bench and comparison of the model that it is held against.
        spread: between specimens by case, where the session is their average.

    Raises:
        NothingToDrawError: no such case.
    """
    shown, held = only.of(comparison), None if before is None else (before[0], only.of(before[2]))
    beside = None
    if held is not None:
        beside = Beside(f"predicted before: {held[0]}", {c.id: c.predicted_N for c in held[1].cases})
    plans = comparison_plans(
        Compared.of(bench, shown, held, spread),
        [c.id for c in shown.cases] if only.role == "all" else None,
        plane=only.plane,
        role="validation" if only.role == "validation" else "identification",
        location=only.location or "tip",
        beside=beside,
    )
    plan = next(p for p in plans if p.name == name)
    return plan.draw(), f"{plan.caption} Model: {bench.loaded.fitted}."
