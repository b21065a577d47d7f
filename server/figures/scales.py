"""Scale bars and directions in a corner of a drawing of the finger."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from server.figures import graph_objects as go
from server.figures import marks
from server.figures.sheet import note
from server.figures.style import MUTED, SMALL_PX

Floats = NDArray[np.float64]


def round_length(value: float) -> float:
    """Return the largest of 1, 2, 5 times a power of ten that is not above `value`."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(m for m in (1.0, 2.0, 5.0) if m * power <= value * (1 + 1e-9)) * power)


def scale_bars(
    low: Floats, size: Floats, mm_per_N: float, names: Mapping[str, str], *, first: bool
) -> tuple[list[go.Scatter], list[dict[str, Any]]]:
    """Return the force bar of each panel; the first one has a length bar and the directions too."""
    on = (names["xaxis"], names["yaxis"])
    look: dict[str, Any] = {"size": SMALL_PX, "color": MUTED}
    y = float(low[1] + 0.035 * size[1])
    bars = []
    if mm_per_N > 0:  # else there is no force to scale
        force = round_length(0.22 * float(size[0]) / mm_per_N)
        bars.append((f"{force:g} N", force * mm_per_N))
    if first:
        length = round_length(0.25 * float(size[0]))
        bars.append((f"{length:g} mm", length))
    x = float(low[0] + 0.02 * size[0])
    traces, words = [], []
    for text, length in bars:
        line, meta = {"color": MUTED, "width": 2.5 if text.endswith("N") else 1.2}, {"kind": "scale", "text": text}
        traces.append(marks.line([x, x + length], [y, y], line, showlegend=False, meta=meta, **names))
        words.append(note(text, x + length / 2, y, on, at=("auto", "bottom"), shift=(0, 1), **look))
        x += length + 0.06 * float(size[0])
    if first:
        x, arm = float(low[0] + 0.80 * size[0]), 0.09 * float(size[0])
        head: dict[str, Any] = {"showarrow": True, "arrowhead": 2, "arrowsize": 1, "arrowwidth": 1.2}
        head |= {"arrowcolor": MUTED}
        tail: dict[str, Any] = {"ax": x, "ay": y, "axref": on[0], "ayref": on[1]}
        for dx, dy, text, anchor in ((1, 0, "proximal", "top"), (0, 1, "dorsal", "bottom")):
            words.append(note("", x + dx * arm, y + dy * arm, on, at=("auto", "auto"), **head, **tail))
            words.append(note(text, x + dx * arm * 0.6, y + dy * arm, on, at=("auto", anchor), **look))
    return traces, words
