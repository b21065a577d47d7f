"""The page of a diagnosis as a browser reads it, and what it should hold."""

from __future__ import annotations

from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import plotly.graph_objects as go

from server.application.diagnosis_report import draw_diagnosis
from tests.server.diagnosis_parts import Answer

NAMES = {
    "sensitivity", "residual_map", "missing_torque", "ranking", "size", "confounding", "revisions", "held_out",
    "own_curve",
}  # fmt: skip
HEADINGS = (
    "Verdict",
    "What to do",
    "Error before and after",
    "Suspect load cases and the rig",
    "Sensitivity analysis",
    "Where the model fails",
    "Which explanation",
    "What cannot be told apart",
    "Tests that need no model",
    "The fall of the error",
    "Hints at a formula",
    "Load cases to run next",
    "How this was found",
    "Glossary",
)


MISSING = {
    "found": {"own_curve"},
    "one_of": {"size", "own_curve"},
    "none_of_catalogue": {"size"},
    "nothing_missing": {"missing_torque", "confounding", "held_out", "size", "own_curve"},
    "undecided": {"size", "own_curve"},
}


class Page(HTMLParser):
    """Collects a page's headings, paragraphs, addresses, scripts and words."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.headings: list[str] = []
        self.paragraphs: list[str] = []
        self.addresses: list[str] = []
        self.words: list[str] = []
        self.scripts = 0
        self._into: list[str] | None = None
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.addresses += [str(v) for k, v in attrs if k in ("src", "href", "data", "action", "srcset")]
        self.scripts += tag == "script"
        self._into = {"h2": self.headings, "p": self.paragraphs}.get(tag)
        if self._into is not None:
            self._into.append("")

    def handle_endtag(self, tag: str) -> None:
        self._into = None

    def handle_data(self, data: str) -> None:
        self.words.append(data)
        if self._into is not None:
            self._into[-1] += data


def page(answer: Answer, folder: Path, history: list[dict[str, Any]] | None = None) -> Page:
    """Draw the page alone and read it."""
    return Page(draw_diagnosis(answer, folder, history, static=False).read_text(encoding="utf-8"))


def bars(figure: go.Figure) -> list[Any]:
    return [t for t in figure.data if t.type == "bar"]
