"""What of a Plotly figure can be drawn without a browser; everything else that shows is refused, never dropped.

A leaf is `ANY` or the set of values that are understood. Attributes that only matter to a pointer (hover, dragging,
selection) are known to be invisible and pass.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

ANY = object()
Schema = Mapping[str, Any]


class UnsupportedFigureError(ValueError):
    """A figure uses something that the converter without a browser does not draw."""


SYMBOLS = {
    "circle": "o",
    "square": "s",
    "diamond": "D",
    "triangle-up": "^",
    "triangle-down": "v",
    "triangle-left": "<",
    "triangle-right": ">",
    "cross": "P",
    "x": "X",
    "star": "*",
    "pentagon": "p",
    "hexagon": "h",
    "line-ns": "|",
    "line-ew": "_",
}


def _any(names: str) -> dict[str, object]:
    return dict.fromkeys(names.split(), ANY)


_INVISIBLE = _any("hoverinfo hovertemplate hovertext hoveron hoverlabel customdata meta uid ids legendgroup")
_FONT: Schema = {"size": ANY, "color": ANY, "family": ANY}
_LINE: Schema = {"color": ANY, "width": ANY, "dash": ANY, "shape": {"linear", "hv", "vh"}, "simplify": ANY}
_ERROR: Schema = {
    "type": {"data"},
    **_any("array arrayminus symmetric"),
    "visible": {True},
    **_any("color thickness width"),
}
_TRACE: Schema = {
    **_any("type name x y xaxis yaxis"),
    "visible": {True, False, "legendonly"},
    **_any("opacity showlegend legendrank text"),
    **_INVISIBLE,
}
TRACES: dict[str, Schema] = {
    "scatter": {
        **_TRACE,
        "mode": ANY,
        "line": _LINE,
        "marker": {
            **_any("color size symbol opacity"),
            "line": {"color": ANY, "width": ANY},
        },
        "fill": {"none", "toself", "tozeroy"},
        "fillcolor": ANY,
        "error_x": _ERROR,
        "error_y": _ERROR,
        "textposition": ANY,
        "textfont": _FONT,
        "cliponaxis": ANY,
        "connectgaps": {False},
    },
    "bar": {
        **_TRACE,
        "orientation": {"v", "h"},
        **_any("base width offset"),
        "marker": {"color": ANY, "opacity": ANY, "line": {"color": ANY, "width": ANY}},
        "error_x": _ERROR,
        "error_y": _ERROR,
        "textposition": {"outside", "inside", "none"},
        "textfont": _FONT,
        "textangle": {0},
        "cliponaxis": ANY,
        "constraintext": {"none"},
        "offsetgroup": ANY,
    },
    "heatmap": {
        **_TRACE,
        **_any("z zmin zmax zmid colorscale reversescale showscale"),
        "texttemplate": {"%{text}"},
        "textfont": _FONT,
        **_any("xgap ygap hoverongaps"),
        "colorbar": {
            "title": {"text": ANY, "side": {"top", "right"}, "font": _FONT},
            **_any("thickness len"),
            "tickfont": _FONT,
            **_any("tickvals ticktext outlinewidth"),
        },
    },
}
AXIS: Schema = {
    "title": {"text": ANY, "font": _FONT, "standoff": ANY},
    "range": ANY,
    "type": {"linear", "log", "category", "-"},
    "autorange": {True, "reversed"},
    "rangemode": {"normal", "tozero"},
    **_any("domain anchor"),
    "side": {"bottom", "top", "left", "right"},
    **_any("showgrid gridcolor gridwidth zeroline zerolinecolor zerolinewidth showline linecolor linewidth"),
    "mirror": {True, False},
    "ticks": {"outside", "inside", ""},
    **_any("ticklen tickcolor tickwidth"),
    "tickfont": _FONT,
    **_any("tickangle tickvals ticktext"),
    "tickmode": {"array", "auto", "linear"},
    "dtick": ANY,
    "tick0": {0},
    **_any("nticks ticksuffix showticklabels scaleanchor scaleratio"),
    "constrain": {"domain", "range"},
    "matches": ANY,
    "categoryorder": {"array", "trace"},
    **_any("categoryarray visible automargin fixedrange"),
    "layer": {"above traces"},
}
ANNOTATION: Schema = {
    **_any("text x y xref yref xanchor yanchor xshift yshift"),
    "align": {"left", "center", "right"},
    "font": _FONT,
    **_any("textangle bgcolor showarrow ax ay axref ayref"),
    "arrowhead": {0, 1, 2, 3},
    **_any("arrowsize arrowwidth arrowcolor"),
    "standoff": {0},
    **_any("name hovertext captureevents"),
}
SHAPE: Schema = {
    "type": {"line", "rect"},
    **_any("x0 x1 y0 y1 xref yref"),
    "line": _LINE,
    **_any("fillcolor opacity"),
    "layer": {"above", "below"},
    "name": ANY,
}
LAYOUT: Schema = {
    **_any("template width height"),
    "margin": {"l": ANY, "r": ANY, "t": ANY, "b": ANY},
    "title": {
        **_any("text x y"),
        "xref": {"container"},
        "yref": {"container"},
        "xanchor": {"left", "center", "right"},
        "yanchor": {"top"},
        "pad": {"l": ANY, "t": ANY, "r": ANY, "b": ANY},
        "font": _FONT,
        "subtitle": {"text": ANY, "font": _FONT},
    },
    "font": _FONT,
    **_any("paper_bgcolor plot_bgcolor showlegend"),
    "legend": {
        **_any("x y"),
        "xanchor": {"left", "center", "right"},
        "yanchor": {"top", "middle", "bottom"},
        "xref": {"paper"},
        "yref": {"paper"},
        "orientation": {"h", "v"},
        "font": _FONT,
        "title": {"text": ANY, "font": _FONT},
        "traceorder": {"normal"},
        **_any("bgcolor itemclick itemdoubleclick itemsizing tracegroupgap groupclick"),
    },
    "barmode": {"group", "overlay", "stack", "relative"},
    **_any(
        "bargap bargroupgap annotations shapes hovermode hoverlabel hoverdistance dragmode modebar uirevision meta "
        "autosize"
    ),
}


def is_axis(key: str) -> bool:
    """Whether a layout key is a Cartesian axis: xaxis, yaxis3, …."""
    return key[:5] in ("xaxis", "yaxis") and (key[5:] == "" or key[5:].isdigit())


def require_supported(figure: Mapping[str, Any]) -> None:
    """Refuse a figure (as a dict) that shows anything the converter does not draw.

    Raises:
        UnsupportedFigureError: naming the attribute.
    """
    for index, trace in enumerate(figure.get("data", ())):
        kind = trace.get("type", "scatter")
        if kind not in TRACES:
            raise UnsupportedFigureError(f"trace {index} is a {kind}; drawn are {', '.join(TRACES)}")
        _check(trace, TRACES[kind], f"{kind} trace {index}")
        if kind == "bar" and trace.get("text") is not None and not trace.get("textposition"):
            raise UnsupportedFigureError(f"bar trace {index}: text without textposition is placed by the browser")
    layout = figure.get("layout", {})
    if _has_defaults(layout.get("template")):
        # Its defaults would have to be looked up everywhere.
        raise UnsupportedFigureError("the layout has a template with defaults; build the figure with template={}")
    _check({k: v for k, v in layout.items() if not is_axis(k)}, LAYOUT, "layout")
    for key, value in layout.items():
        if is_axis(key):
            _check(value, AXIS, key)
    for index, annotation in enumerate(layout.get("annotations", ())):
        _check(annotation, ANNOTATION, f"annotation {index}")
    for index, shape in enumerate(layout.get("shapes", ())):
        _check(shape, SHAPE, f"shape {index}")
    if figure.get("frames"):
        raise UnsupportedFigureError("an animation has no still picture")


def _has_defaults(template: Any) -> bool:
    """Whether a template says anything beyond the types of traces, which Plotly puts in by itself."""
    if not template:
        return False
    entries = [entry for kind in (template.get("data") or {}).values() for entry in kind]
    return bool(template.get("layout")) or any(set(entry) - {"type"} for entry in entries)


def _check(found: Mapping[str, Any], schema: Schema, where: str) -> None:
    for key, value in found.items():
        if value is None:
            continue
        if key not in schema:
            raise UnsupportedFigureError(f"{where}: {key} is not drawn")
        allowed = schema[key]
        if allowed is ANY:
            continue
        if isinstance(allowed, Mapping):
            if not isinstance(value, Mapping):
                raise UnsupportedFigureError(f"{where}: {key} is {value!r}, expected its parts")
            _check(value, allowed, f"{where}.{key}")
        elif not any(value == one for one in allowed):
            raise UnsupportedFigureError(f"{where}: {key} {value!r} is not drawn")
