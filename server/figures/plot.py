"""A drawn figure with what stands above and below it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import plotly.graph_objects as go


@dataclass(frozen=True)
class Plot:
    """A figure with its heading and caption.

    Attributes:
        name: for files and addresses.
        heading: above it.
        figure: drawn.
        caption: a sentence below it.
    """

    name: str
    heading: str
    figure: go.Figure
    caption: str = ""
