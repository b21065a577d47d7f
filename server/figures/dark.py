"""Figures for dark pages: the same drawing with every colour's lightness turned over, its hue kept.

Lightness is that of OKLab (Ottosson 2020), in which equal steps look equally large. What is near the page stays near
it, so pale remains faint and strong remains strong; colours of data are kept lighter than a plain reflection would
make them, so that each stands out from the page by 3:1 where it did so before.
"""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

# Lightness of white paper once it is turned over: of a page of about #121417.
PAGE = 0.19
# From this chroma on a colour says something.
_CHROMA = 0.013
# Lightness before, and after: of data's colours, and of greys.
_BEFORE = (0.0, 0.25, 0.55, 0.80, 0.90, 1.0)
_DATA, _GREYS = (1.0, 0.92, 0.78, 0.64, 0.48, PAGE), (1.0, 0.92, 0.66, 0.42, 0.28, PAGE)
_TO_LMS = np.array(
    [
        [0.4122214708, 0.5363325363, 0.0514459929],
        [0.2119034982, 0.6806995451, 0.1073969566],
        [0.0883024619, 0.2817188376, 0.6299787005],
    ]
)
_TO_LAB = np.array(
    [
        [0.2104542553, 0.7936177850, -0.0040720468],
        [1.9779984951, -2.4285922050, 0.4505937099],
        [0.0259040371, 0.7827717662, -0.8086757660],
    ]
)
_COLOR = re.compile(r"#([0-9a-fA-F]{6})|rgba?\(\s*(\d+)\s*,\s*(\d+)\s*,\s*(\d+)\s*(?:,\s*([0-9.]+)\s*)?\)")


def for_dark(part: Any, *, colored: bool = False) -> Any:
    """Return plain data of a figure with its colours turned over.

    Args:
        part: of a figure's JSON.
        colored: whether it stands under the name of a colour.
    """
    if isinstance(part, dict):
        return {k: for_dark(v, colored="color" in k) for k, v in part.items()}
    if isinstance(part, list):
        return [for_dark(v, colored=colored) for v in part]
    return turned(part) if colored and isinstance(part, str) else part


@lru_cache(maxsize=1024)
def turned(text: str) -> str:
    """Return a colour, `#rrggbb` or `rgb(…)` with or without an opacity, turned over; any other text as it is."""
    found = _COLOR.fullmatch(text)
    if found is None:
        return text
    if found[1]:
        channels = [int(found[1][i : i + 2], 16) for i in (0, 2, 4)]
    else:
        channels = [min(int(found[i]), 255) for i in (2, 3, 4)]
    lab = _lab(np.array(channels) / 255.0)
    chroma = float(np.hypot(lab[1], lab[2]))
    light = float(np.interp(lab[0], _BEFORE, _DATA if chroma > _CHROMA else _GREYS))
    r, g, b = (round(255.0 * v) for v in _within(light, lab[1:]))
    return f"rgba({r},{g},{b},{found[5]})" if found[5] else f"#{r:02x}{g:02x}{b:02x}"


def _within(light: float, ab: Floats) -> list[float]:
    """Return red, green and blue (0 to 1) of a lightness, with as much of the chroma as a screen can show."""
    low, high = 0.0, 1.0
    if _shown(_rgb(np.array([light, *ab]))):
        low = 1.0
    else:
        for _ in range(12):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if _shown(_rgb(np.array([light, *(middle * ab)]))) else (low, middle)
    out: list[float] = np.clip(_rgb(np.array([light, *(low * ab)])), 0.0, 1.0).tolist()
    return out


def _shown(rgb: Floats) -> bool:
    return bool(((rgb >= -1e-6) & (rgb <= 1.0 + 1e-6)).all())


def _lab(rgb: Floats) -> Floats:
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    return np.asarray(_TO_LAB @ np.cbrt(_TO_LMS @ linear))


def _rgb(lab: Floats) -> Floats:
    linear = np.linalg.solve(_TO_LMS, np.linalg.solve(_TO_LAB, lab) ** 3)
    bent = 1.055 * np.maximum(linear, 0.0) ** (1.0 / 2.4) - 0.055
    return np.where(linear <= 0.0031308, 12.92 * linear, bent)
