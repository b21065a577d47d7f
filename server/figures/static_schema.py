"""Attributes of a Plotly figure that are drawn without a browser; any other that shows is refused, never dropped.

A leaf is `ANY` or the set of values that are understood. Attributes that only matter to a pointer (hover, dragging,
selection) are known to be invisible and pass.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
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
_LINE: Schema = {"color": ANY, "width": ANY, "dash": ANY, "shape": {"linear"}}
_ERROR: Schema = {
    "type": {"data"},
    **_any("array arrayminus symmetric"),
    "visible": {True},
    **_any("color thickness width"),
}
_TRACE: Schema = {
    **_any("type name x y xaxis yaxis showlegend legendrank text"),
    **_INVISIBLE,
}
TRACES: dict[str, Schema] = {
    "scatter": {
        **_TRACE,
        "mode": ANY,
        "line": _LINE,
        "marker": {
            **_any("color size symbol"),
            "line": {"color": ANY, "width": ANY},
        },
        "fill": {"toself"},
        "fillcolor": ANY,
        "error_x": _ERROR,
        "error_y": _ERROR,
        "textposition": ANY,
        "textfont": _FONT,
        "cliponaxis": ANY,
    },
    "bar": {
        **_TRACE,
        "orientation": {"v", "h"},
        **_any("base width"),
        "marker": {"color": ANY, "line": {"color": ANY, "width": ANY}},
        "error_x": _ERROR,
        "error_y": _ERROR,
        "textposition": {"outside"},
        "textfont": _FONT,
        "textangle": {0},
        "cliponaxis": ANY,
        "constraintext": {"none"},
        "offsetgroup": ANY,
    },
    "heatmap": {
        **_TRACE,
        **_any("z zmin zmax colorscale showscale"),
        "texttemplate": {"%{text}"},
        "textfont": _FONT,
        **_any("xgap ygap hoverongaps"),
        "colorbar": {
            "title": {"text": ANY, "side": {"top"}, "font": _FONT},
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
    "rangemode": {"tozero"},
    **_any("domain anchor"),
    **_any("showgrid gridcolor gridwidth zeroline zerolinecolor zerolinewidth showline linecolor linewidth"),
    "mirror": {True},
    "ticks": {"outside", ""},
    **_any("ticklen tickcolor"),
    "tickfont": _FONT,
    **_any("tickangle tickvals ticktext"),
    **_any("nticks showticklabels scaleanchor scaleratio"),
    "constrain": {"domain"},
    "categoryorder": {"array"},
    **_any("categoryarray visible"),
}
ANNOTATION: Schema = {
    **_any("text x y xref yref xanchor yanchor xshift yshift"),
    "align": {"left", "center", "right"},
    "font": _FONT,
    **_any("bgcolor showarrow ax ay axref ayref"),
    "arrowhead": {2},
    **_any("arrowsize arrowwidth arrowcolor"),
}
SHAPE: Schema = {
    "type": {"line", "rect"},
    **_any("x0 x1 y0 y1 xref yref"),
    "line": _LINE,
    "fillcolor": ANY,
    "layer": {"above", "below"},
}
LAYOUT: Schema = {
    **_any("template width height"),
    "margin": {"l": ANY, "r": ANY, "t": ANY, "b": ANY},
    "title": {
        **_any("text x y"),
        "xref": {"container"},
        "yref": {"container"},
        "xanchor": {"left"},
        "yanchor": {"top"},
        "pad": {"l": ANY},
        "font": _FONT,
        "subtitle": {"text": ANY, "font": _FONT},
    },
    "font": _FONT,
    **_any("paper_bgcolor plot_bgcolor showlegend"),
    "legend": {
        **_any("x y"),
        "xanchor": {"left", "right"},
        "yanchor": {"top", "bottom"},
        "orientation": {"h", "v"},
        "font": _FONT,
        "title": {"text": ANY, "font": _FONT},
        "traceorder": {"normal"},
    },
    "barmode": {"group", "overlay"},
    **_any("bargap bargroupgap annotations shapes hovermode hoverlabel meta"),
}


def is_axis(key: str) -> bool:
    """Return whether a layout key is a Cartesian axis: xaxis, yaxis3, …."""
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
        for chosen in _left_to_the_browser(kind, trace):
            raise UnsupportedFigureError(f"{kind} trace {index}: no {chosen}, which the browser would choose")
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


def _left_to_the_browser(kind: str, trace: Mapping[str, Any]) -> Iterator[str]:
    """Yield what a trace has to state, and does not."""
    mode, line, marker = (trace.get(k) or {} for k in ("mode", "line", "marker"))
    if kind == "scatter" and not mode:
        yield "mode"
    if "lines" in mode and line.get("width") != 0 and line.get("color") is None:
        yield "line.color"
    if ("markers" in mode or kind == "bar") and marker.get("color") is None:
        yield "marker.color"
    if trace.get("fill") and not trace.get("fillcolor"):
        yield "fillcolor"
    if kind == "bar" and trace.get("text") is not None and not trace.get("textposition"):
        yield "textposition"
    if kind == "heatmap" and not isinstance(trace.get("colorscale"), list | tuple):
        yield "colorscale with its colours"


def _has_defaults(template: Any) -> bool:
    """Return whether a template says anything beyond the types of traces, which Plotly puts in by itself."""
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
