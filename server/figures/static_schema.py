"""Attributes of a Plotly figure that are drawn without a browser; any other that shows is refused, never dropped.

Each is named by its path, such as `marker.size`, with `ANY` or the set of values that are understood. Attributes that
only matter to a pointer (hover, dragging, selection) are known to be invisible and pass.
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
    "cross": "P",
    "x": "X",
    "star": "*",
    "pentagon": "p",
    "hexagon": "h",
}


def _any(*names: str, **parts: str) -> dict[str, Any]:
    """Return attributes that are drawn whatever their value: by name, and those of a part, such as a font's size."""
    nested = [f"{part}.{name}" for part, own in parts.items() for name in own.split()]
    return dict.fromkeys([*" ".join(names).split(), *nested], ANY)


_INVISIBLE = "hoverinfo hovertemplate hovertext hoveron hoverlabel customdata meta uid ids legendgroup"
_FONT = "size color family"
_ERRORS: Schema = {
    f"error_{axis}.{name}": allowed
    for axis in "xy"
    for name, allowed in (
        _any("array arrayminus symmetric color thickness width") | {"type": {"data"}, "visible": {True}}
    ).items()
}
_TRACE: Schema = _any("type name x y xaxis yaxis showlegend legendrank text cliponaxis", _INVISIBLE, textfont=_FONT)
TRACES: dict[str, Schema] = {
    "scatter": {
        **_TRACE,
        **_ERRORS,
        **_any("mode fillcolor textposition", line="color width dash"),
        **_any(marker="color size symbol line.color line.width"),
        "line.shape": {"linear"},
        "fill": {"toself"},
    },
    "bar": {
        **_TRACE,
        **_ERRORS,
        **_any("base width offsetgroup", marker="color line.color line.width"),
        "orientation": {"v", "h"},
        "textposition": {"outside"},
        "textangle": {0},
        "constraintext": {"none"},
    },
    "heatmap": {
        **_TRACE,
        **_any("z zmin zmax colorscale showscale xgap ygap hoverongaps"),
        **_any(colorbar="thickness len tickvals ticktext outlinewidth tickfont.size tickfont.color tickfont.family"),
        **_any(colorbar="title.text title.font.size title.font.color title.font.family"),
        "colorbar.title.side": {"top"},
        "texttemplate": {"%{text}"},
    },
}
AXIS: Schema = {
    **_any("range domain anchor showgrid gridcolor gridwidth zeroline zerolinecolor zerolinewidth visible"),
    **_any("showline linecolor linewidth ticklen tickcolor tickangle tickvals ticktext nticks showticklabels"),
    **_any("scaleanchor scaleratio categoryarray", tickfont=_FONT),
    **_any(title="text standoff font.size font.color font.family"),
    "type": {"linear", "log", "category", "-"},
    "rangemode": {"tozero"},
    "mirror": {True},
    "ticks": {"outside", ""},
    "constrain": {"domain"},
    "categoryorder": {"array"},
}
ANNOTATION: Schema = {
    **_any("text x y xref yref xanchor yanchor xshift yshift bgcolor", font=_FONT),
    **_any("showarrow ax ay axref ayref arrowsize arrowwidth arrowcolor"),
    "align": {"left", "center", "right"},
    "arrowhead": {2},
}
SHAPE: Schema = {
    **_any("x0 x1 y0 y1 xref yref fillcolor", line="color width dash"),
    "type": {"line", "rect"},
    "layer": {"above", "below"},
}
LAYOUT: Schema = {
    **_any("template width height paper_bgcolor plot_bgcolor showlegend bargap bargroupgap annotations shapes"),
    **_any("hovermode hoverlabel meta", font=_FONT, margin="l r t b"),
    **_any(title="text x y pad.l font.size font.color font.family subtitle.text"),
    **_any(title="subtitle.font.size subtitle.font.color subtitle.font.family"),
    **_any(legend="x y font.size font.color font.family title.text title.font.size title.font.color"),
    "legend.title.font.family": ANY,
    "title.xref": {"container"},
    "title.yref": {"container"},
    "title.xanchor": {"left"},
    "title.yanchor": {"top"},
    "legend.xanchor": {"left", "right"},
    "legend.yanchor": {"top", "bottom"},
    "legend.orientation": {"h", "v"},
    "legend.traceorder": {"normal"},
    "barmode": {"group", "overlay"},
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


def _check(found: Mapping[str, Any], schema: Schema, where: str, part: str = "") -> None:
    """Refuse what is not in a schema, a part of a figure being named by its path, such as `marker.line.`."""
    for key, value in found.items():
        allowed = schema.get(part + key)
        if value is None or allowed is ANY:
            continue
        if allowed is None and isinstance(value, Mapping) and any(k.startswith(f"{part}{key}.") for k in schema):
            _check(value, schema, f"{where}.{key}", f"{part}{key}.")
        elif allowed is None:
            raise UnsupportedFigureError(f"{where}: {key} is not drawn")
        elif not any(value == one for one in allowed):
            raise UnsupportedFigureError(f"{where}: {key} {value!r} is not drawn")
