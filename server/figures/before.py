"""Predictions of an earlier model in the figure of a later one: the same vectors, thin and grey."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from server.figures.arrows import arrow_traces
from server.figures.panels import key
from server.figures.style import plain

if TYPE_CHECKING:
    import plotly.graph_objects as go

    from fingermodel.comparison.comparison import CaseComparison

_LINE = {"color": "#8a8a8a", "width": 1.6, "dash": "2px,2px"}


def with_before(figure: go.Figure, earlier: go.Figure, cases: dict[str, CaseComparison], label: str) -> go.Figure:
    """Return a figure of vectors with those that an earlier model predicted beside them.

    Args:
        figure: of the later model.
        earlier: the same figure of the earlier one.
        cases: of the comparison by id, for their labels.
        label: of the earlier ones, such as `predicted before: an1979_middle`.
    """
    import plotly.graph_objects as go

    forces = {m["case"]: m["force_N"] for t in earlier.data if (m := _arrow(t)) is not None}
    under: list[Any] = []
    over: list[Any] = []
    for trace in figure.data:
        meta = _arrow(trace)
        if meta is not None and meta["case"] in forces and meta["case"] in cases:
            axes = {"xaxis": trace.xaxis or "x", "yaxis": trace.yaxis or "y"}
            origin = np.array([trace.x[0], trace.y[0]], dtype=float)
            head_mm = 0.032 * float(np.ptp(figure.layout[_axis(axes["xaxis"])].range))
            drawn = arrow_traces(
                np.asarray(forces[meta["case"]], dtype=float),
                origin,
                meta["mm_per_N"],
                axes,
                kind="predicted",
                case=cases[meta["case"]],
                line=_LINE,
                head_mm=head_mm,
                hollow=True,
            )
            for part in drawn:
                part.meta = {"kind": f"before_{part.meta['kind']}", "case": meta["case"]}
                if part.text:
                    part.text = str(part.text).replace("<br>predicted", f"<br>{plain(label)},")
            under += drawn
        over.append(trace)
    keys = [t for t in over if t.x is not None and list(t.x) == [None]]
    rest = [t for t in over if not any(t is k for k in keys)]
    shown = key(plain(label), line=_LINE)
    return go.Figure(data=[*rest, *under, *keys[:2], shown, *keys[2:]], layout=figure.layout)


def _arrow(trace: Any) -> dict[str, Any] | None:
    meta = trace.meta
    return meta if isinstance(meta, dict) and meta.get("kind") == "predicted" and "force_N" in meta else None


def _axis(name: str) -> str:
    return name.replace("x", "xaxis", 1)
