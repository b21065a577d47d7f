"""The report of a comparison: one file that fetches nothing and believes no name."""

from __future__ import annotations

import json
import re
from html.parser import HTMLParser
from pathlib import Path

import plotly.graph_objects as go

from fingermodel.comparison.comparison import Comparison
from server.figures.compared import Compared
from server.figures.comparison import comparison_report
from server.figures.plot import Plot
from server.figures.report import Section, Table, report_html, write_report
from server.figures.static import write_static
from server.figures.vectors import vector_figure
from tests.server.compared_sessions import HOSTILE, ordinary


class Links(HTMLParser):
    """Collects what a page would fetch, its scripts' number and its plain text."""

    def __init__(self) -> None:
        super().__init__()
        self.links: list[str] = []
        self.scripts = 0
        self.words: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.links += [str(v) for k, v in attrs if k in ("src", "href", "data", "action", "srcset")]
        self.scripts += tag == "script"

    def handle_data(self, data: str) -> None:
        self.words.append(data)


def test_the_report_is_one_file_that_fetches_nothing(tmp_path: Path) -> None:
    model, observations, comparison = ordinary()
    rows = [c for c in comparison.cases if c.location == "tip"]
    part = Comparison(tuple(rows), comparison.noise_assumed)
    written = comparison_report(
        tmp_path, Compared(model, observations, part, name=HOSTILE), session=HOSTILE, static=False
    )
    assert written == tmp_path / "compare.html"
    assert list(tmp_path.iterdir()) == [written]
    text = written.read_text(encoding="utf-8")
    page = Links()
    page.feed(text)
    assert page.links
    assert all(link.startswith("#") for link in page.links)
    assert page.scripts == 2, "Plotly and the figures; a hostile name adds none"
    assert text.count("plotly.js v") == 1
    assert "default-src 'none'" in text
    assert '"showSendToCloud": false' in text
    assert HOSTILE not in text
    words = "".join(page.words)
    assert HOSTILE in words, "the name is still to be read"
    assert "No figure: none of these load cases was measured at the bone." in words


def test_figures_of_a_hostile_model_name_are_drawn(tmp_path: Path) -> None:
    model, observations, comparison = ordinary()
    write_static(tmp_path, {"vectors": vector_figure(Compared(model, observations, comparison, name=HOSTILE))})
    assert "&lt;/script&gt;&lt;script&gt;" in (tmp_path / "vectors.svg").read_text(encoding="utf-8")


def test_figure_data_cannot_end_the_script() -> None:
    figure = go.Figure(go.Scatter(x=[1], y=[1], name="</script><img src=x>\u2028"))
    page = report_html([Section("A", [Plot("a", "", figure, "c"), Table(["h"], [["<i>"]], "t"), "p"])], "T")
    tail = page[page.rindex("const figures") :]
    assert "</script><img" not in tail
    assert "\u2028" not in page
    found = re.search(r"const figures = (.*);\n", tail)
    assert found
    assert json.loads(found[1])[0]["data"][0]["name"] == figure.data[0].name
    assert "&lt;i&gt;" in page


def test_a_report_without_figures_needs_no_script(tmp_path: Path) -> None:
    path = write_report(tmp_path / "new" / "r.html", [Section("A b", ["x"]), Section("A b", ["y"])], "T", "s")
    text = path.read_text(encoding="utf-8")
    assert "<script" not in text
    assert len(set(re.findall(r'<section id="([^"]+)"', text))) == 2
