"""Plotly's graph objects, loaded with the first figure that is drawn: what draws nothing starts without them."""

from __future__ import annotations

from importlib import import_module
from typing import Any


def __getattr__(name: str) -> Any:
    """Return Plotly's class of this name."""
    return getattr(import_module("plotly.graph_objects"), name)
