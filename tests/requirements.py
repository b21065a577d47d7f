"""Programs that tests want and that may be absent: what a run must not skip for the want of."""

from __future__ import annotations

import os


def demanded(name: str) -> bool:
    """Whether FINGERTWIN_REQUIRE names a program, so that its absence is a failure and no skip."""
    return name in os.environ.get("FINGERTWIN_REQUIRE", "").split(",")
