"""A figure as it is answered: Plotly's data in the page's colours, with the same in words."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Literal

import orjson

from server.figures.alternative import plain_text, text_of
from server.figures.dark import for_dark
from server.figures.style import NothingToDrawError
from server.service.figures.cases import Told, cases_of

if TYPE_CHECKING:
    import plotly.graph_objects as go

    from server.figures.plot import Plot

Theme = Literal["light", "dark"]

SCHEMA = "fingertwin/figure/1"


def shown(
    name: str, figure: go.Figure | None, caption: str, about: dict[str, Any], known: Sequence[Told] = ()
) -> dict[str, Any]:
    """Return the answer's plain data, in the colours of paper."""
    if figure is not None:
        return shown_data(name, orjson.loads(figure.to_json()), caption, about, known)
    nothing = {"title": None, "caption": None, "text": caption, "figure": None, "cases": None}
    return {"schema": SCHEMA, "name": name} | nothing | about


def shown_or_why(
    name: str, draw: Callable[[], tuple[go.Figure, str]], about: dict[str, Any], known: Sequence[Told] = ()
) -> dict[str, Any]:
    """Return the answer of a figure with its caption, or with why there is nothing to draw."""
    try:
        figure, caption = draw()
    except NothingToDrawError as nothing:
        return shown(name, None, nothing.sentence, about)
    return shown(name, figure, caption, about, known)


def shown_data(
    name: str, data: dict[str, Any], caption: str, about: dict[str, Any], known: Sequence[Told] = ()
) -> dict[str, Any]:
    """Return a figure's plain data, in the colours of paper."""
    title = plain_text(str(((data["layout"].get("title")) or {}).get("text") or name))
    cases = cases_of(data, known) if known else None
    told = {"title": title, "caption": caption, "text": text_of(data, caption), "figure": data, "cases": cases}
    return {"schema": SCHEMA, "name": name} | told | about


def on_page(shown: dict[str, Any], theme: Theme) -> dict[str, Any]:
    """Let the page show through, and turn the colours over where it is dark."""
    figure = shown["figure"]
    if figure is None:
        return shown
    figure["layout"] |= {"paper_bgcolor": "rgba(0,0,0,0)", "plot_bgcolor": "rgba(0,0,0,0)"}
    if theme == "light":
        return shown
    return shown | {"figure": for_dark(figure)}


def drawn_plots(draw: Callable[[], Sequence[Plot]], theme: Theme | None) -> list[dict[str, Any]]:
    """Return figures that go along with the answer whose numbers they show; none where no theme is named."""
    if theme is None:
        return []
    answers = [shown(p.name, p.figure, p.caption, {"heading": p.heading}) for p in draw()]
    return [on_page(answer, theme) | {"theme": theme} for answer in answers]
