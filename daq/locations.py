"""Location of shipped data: beside the packages in a checkout, inside `daq` in an installed wheel."""

from __future__ import annotations

from functools import cache
from pathlib import Path


@cache
def data_dir() -> Path:
    """Return the folder that holds `fingers/`, `sessions/`, `protocols/` and `reference/`."""
    here = Path(__file__).resolve().parent
    for folder in (here / "_data", here.parent / "data"):
        if (folder / "fingers").is_dir():
            return folder
    raise FileNotFoundError(f"no data folder beside {here}: the installation is incomplete; install fingertwin again")
