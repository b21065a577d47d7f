"""Numbers in files say where they come from."""

from __future__ import annotations

from typing import Literal

from daq.documents import Document

Certainty = Literal["high", "medium", "low", "assumed", "fitted"]


class Sourced(Document):
    """A block of numbers: its source (listed at the top of the file), how certain it is, and a note."""

    source: str
    certainty: Certainty
    note: str = ""
