"""Figures of predicted against measured forces: of all cases as the command line draws them, or of some, in a plane."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

from fingermodel.session import Session
from server.figures.bone import bone_figure
from server.figures.compared import Compared
from server.figures.scatter import scatter_figure
from server.figures.summary import errors_figure
from server.figures.vectors import Beside, vector_figure
from server.figures.zscores import z_figure

if TYPE_CHECKING:
    import plotly.graph_objects as go

    from fingermodel.comparison.comparison import Comparison
    from server.figures.arrows import Spread

Plane = Literal["sagittal", "space"]


@dataclass(frozen=True)
class Only:
    """Selection of load cases to draw, and of components of their forces.

    Attributes:
        plane: the sagittal one or space; None for that in which the finger is judged.
        role: identification, validation or all; None for both, on the finger those of validation alone.
        location: tip or bone.
        posture: its name.
        muscles: that are loaded, such as `FDP+FDS`.
    """

    plane: Plane | None = None
    role: str | None = None
    location: str | None = None
    posture: str | None = None
    muscles: str | None = None

    def of(self, comparison: Comparison) -> Comparison:
        """Return those cases of a comparison."""
        role = None if self.role == "all" else self.role
        return comparison.select(role, self.location, self.muscles, self.posture)

    @property
    def everything(self) -> bool:
        """True if no case is left out and no plane is asked for."""
        return replace(self, role=None if self.role == "all" else self.role) == Only()


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
    from server.figures.comparison import comparison_plans

    shown = only.of(comparison)
    held = None if before is None else only.of(before[2])
    compared = Compared.of(bench, shown, None if before is None or held is None else (before[0], held), spread)
    cases = [c.id for c in shown.cases] if only.role == "all" else None
    plans = comparison_plans(compared, cases)
    plan = next(p for p in plans if p.name == name)
    caption = f"{plan.caption} Model: {bench.loaded.fitted}."
    if name in ("vectors", "bone") and before is not None and held is not None:
        other = Beside(f"predicted before: {before[0]}", {c.id: c.predicted_N for c in held.cases})
        return {"vectors": vector_figure, "bone": bone_figure}[name](compared, cases, other), caption
    if name in ("vectors", "bone") or only.everything:
        return plan.draw(), caption
    return _of_some(name, bench, shown, only, None if before is None or held is None else (before[0], held)), caption


def _of_some(
    name: str, bench: Session, shown: Comparison, only: Only, before: tuple[str, Comparison] | None
) -> go.Figure:
    plane = only.plane or bench.model.finger.judged_in
    called, held = before or ("", None)
    if name == "errors":
        return errors_figure(shown, before=held, before_name=called, model_name=bench.loaded.name, plane=plane)
    if name == "z":
        return z_figure(shown, before=held, before_name=called, plane=plane)
    both = [*([(called, held)] if held is not None else []), (bench.loaded.name, shown)]
    role = "validation" if name == "scatter_validation" else "identification"
    return scatter_figure(both, plane=plane, role=role, location=only.location or "tip")
