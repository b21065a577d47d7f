"""Figures that the service draws, as Plotly has them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from daq.errors import InputError
from fingertwin.client.errors import ServiceError
from fingertwin.client.exchange import Exchange, path_of, reading

if TYPE_CHECKING:
    import plotly.graph_objects as go


def figure(exchange: Exchange, name: str, **query: str | None) -> go.Figure:
    """Ask for a figure.

    Args:
        exchange: with the service.
        name: its kind and name, such as `comparison/scatter`.
        query: what it is about.

    Raises:
        ServiceError: there is no such figure, or what it is about is not there.
        InputError: there is nothing to draw; the message says why.
    """
    import plotly.graph_objects as go

    given = {key: value for key, value in query.items() if value is not None}
    answer = exchange.get(path_of("figures", *name.split("/")), given)
    with reading("a figure"):
        drawn, words = answer["figure"], str(answer["text"])
        if drawn is not None:
            # The service says all that is to be seen; no template of this machine's is to change it.
            return go.Figure(drawn, skip_invalid=True).update_layout(template="none")
    raise InputError(words)


def figure_names(exchange: Exchange) -> dict[str, str]:
    """Return the figures that the service draws: names with titles."""
    with reading("figures"):
        rows = exchange.get(path_of("figures"))["figures"]
        return {str(row["path"]).partition("/figures/")[2]: str(row["title"]) for row in rows}


def model_of(exchange: Exchange, asked: str | None, used: str) -> str | None:
    """Return by what a model can be asked for again.

    Args:
        exchange: with the service.
        asked: as it was asked for the first time.
        used: what the service took, by its answer.
    """
    if asked is None:
        return None
    try:
        exchange.get(path_of("revisions", used))
    except ServiceError as error:
        if error.status != 404:
            raise
        # A finger: the one that was asked for by name, or the session's own.
        return used if asked == used else None
    return used
