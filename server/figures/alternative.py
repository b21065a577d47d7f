"""A figure in words, for who cannot see it: its title, its headings and axes, and what is shown."""

from __future__ import annotations

import html
import re
from collections.abc import Iterable, Mapping
from typing import Any

_MOST = 2000


def text_of(figure: Mapping[str, Any], caption: str = "") -> str:
    """Return sentences that stand for a figure.

    Args:
        figure: its plain data: `data` and `layout`.
        caption: what is said below it.
    """
    layout = figure["layout"]
    title = layout.get("title") or {}
    headings = [a.get("text") for a in layout.get("annotations") or () if a.get("xref") == "paper"]
    axes = [
        (part.get("title") or {}).get("text")
        for name, part in layout.items()
        if name.startswith(("xaxis", "yaxis")) and isinstance(part, Mapping)
    ]
    named = [t.get("name") for t in figure["data"] if t.get("showlegend", True)]
    parts = [
        *_words([title.get("text"), (title.get("subtitle") or {}).get("text")]),
        *(text for text in (plain_text(h) for h in headings if h) if text),
        *_listed("Axes", axes),
        *_listed("Shown", named),
        *_words([caption]),
    ]
    said = " ".join(part if part.endswith((".", "!", "?")) else f"{part}." for part in parts)
    return said if len(said) <= _MOST else f"{said[: _MOST - 1].rstrip()}…"


def plain_text(marked: str) -> str:
    """Return a text of a figure without its marks: line breaks as commas, bold and small as it is."""
    lines = [re.sub(r"<[^>]*>", "", line).strip() for line in re.split(r"<br\s*/?>", marked)]
    out = ""
    for line in filter(None, lines):
        out += line if not out else f" {line}" if out.endswith((".", ",", ";", ":")) else f", {line}"
    return " ".join(html.unescape(out).split())


def _words(found: Iterable[str | None]) -> list[str]:
    """Return texts, each once, in their order."""
    return list(dict.fromkeys(text for text in (plain_text(f) for f in found if f) if text))


def _listed(what: str, found: Iterable[str | None]) -> list[str]:
    words = _words(found)
    return [f"{what}: {'; '.join(words)}"] if words else []
