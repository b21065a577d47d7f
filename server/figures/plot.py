"""A figure with what stands above and below it: drawn, or still to be drawn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from server.figures import graph_objects as go


@dataclass(frozen=True)
class Plot:
    """A figure with its heading and caption."""

    name: str  # for files and addresses
    heading: str  # above it; empty where it stands under another's
    figure: go.Figure  # drawn
    caption: str = ""  # a sentence below it


@dataclass(frozen=True)
class Plan:
    """A figure that is still to be drawn; `draw` raises NothingToDrawError where there is nothing to show."""

    name: str
    heading: str
    caption: str
    draw: Callable[[], go.Figure]
