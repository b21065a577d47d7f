"""Forms of figures."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from server.service.schemas.common import Answered, Shown


class FigureParameter(Shown):
    """A query parameter of a figure."""

    name: str
    required: bool
    description: str


class FigureListed(Shown):
    """A figure that can be drawn."""

    kind: str = Field(description="comparison, diagnosis, revisions, finger or effect.")
    name: str = Field(description="Within its kind.")
    title: str
    needs: str = Field(description="What must be there before it shows anything.")
    path: str = Field(description="Address below the service's.", examples=["/api/v1/figures/comparison/scatter"])
    parameters: list[FigureParameter]


class FigureList(Answered):
    """All figures."""

    figures: list[FigureListed]


class PlotlyFigure(Shown):
    """A figure of Plotly: traces and layout, with no template and no colour of the page."""

    data: list[dict[str, Any]]
    layout: dict[str, Any]


class FigureShown(Shown):
    """A figure, and the same in words."""

    schema_: str = Field(alias="schema", examples=["fingertwin/figure/1"])
    name: str
    title: str | None
    caption: str | None = Field(description="To stand below it.")
    text: str = Field(description="The figure in words, for who cannot see it; or why there is none.")
    figure: PlotlyFigure | None = Field(description="Null where there is nothing to draw; `text` says why.")
    cases: list[Any] | None = Field(
        None,
        description="Of each trace the load cases that its points stand for: one id for all of it, or for each point "
        "an id, a list of ids or null (of a map for each row a list of those), or null.",
    )
    theme: str = Field(description="light or dark.")
    blinded: list[str] = Field([], description="Cases that are left out, or whose prediction is, until it is closed.")
