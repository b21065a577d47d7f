"""A report as one HTML file: headings, sentences, tables and figures, nothing loaded from anywhere.

Plotly's own script is written into the file once, from the installed wheel. A policy in the page forbids every
connection, so that it shows the same offline, and a hostile name in a session can do nothing.
"""

from __future__ import annotations

import html
import json
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

from daq.files import replacing
from server.figures import graph_objects as go
from server.figures.plot import Plot
from server.figures.style import NothingToDrawError

# Plotly's tool bar would by default offer to send the figure, with its data, to a server of its maker.
OPTIONS = {
    "displaylogo": False,
    "showSendToCloud": False,
    "plotlyServerURL": "",
    "modeBarButtonsToRemove": ["sendChartToCloud", "select2d", "lasso2d"],
}
_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:; font-src data:"
)


# All is drawn, and then folded; whoever prints, or follows a link into a fold, has it open.
_DRAW = """
const folds = (open) => document.querySelectorAll('details').forEach((d) => { d.open = open; });
const drawn = figures.map((f, i) => Plotly.newPlot('plot' + i, f.data, f.layout, options));
Promise.all(drawn).then(() => folds(false));
addEventListener('beforeprint', () => folds(true));
addEventListener('hashchange', () => {
  const fold = document.querySelector(location.hash + ' details');
  if (fold) fold.open = true;
});
"""


@dataclass(frozen=True)
class Table:
    """A table; numbers stand right-aligned under their heading."""

    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""


@dataclass(frozen=True)
class Steps:
    """A numbered list of what is to be done."""

    items: Sequence[str]


Part = str | Table | Plot | Steps


@dataclass(frozen=True)
class Section:
    """A heading with what follows it, in order: sentences, lists, tables, figures; a click opens what is folded."""

    heading: str
    parts: Sequence[Part]
    folded: bool = False


def plot_or_reason(name: str, draw: Callable[[], go.Figure], caption: str) -> Plot | str:
    """Return a figure with its caption, or why there is nothing to draw."""
    try:
        return Plot(name, "", draw(), caption)
    except NothingToDrawError as nothing:
        return nothing.sentence


def figures_of(sections: Sequence[Section]) -> dict[str, go.Figure]:
    """Return the figures of a report by name."""
    return {part.name: part.figure for section in sections for part in section.parts if isinstance(part, Plot)}


def by_heading(parts: Iterable[tuple[str, Part]]) -> list[Section]:
    """Return a section for each heading, with what stands under it, in order."""
    found: dict[str, list[Part]] = {}
    for heading, part in parts:
        found.setdefault(heading, []).append(part)
    return [Section(heading, those) for heading, those in found.items()]


def write_report(
    path: Path, sections: Sequence[Section], title: str, subtitle: str = "", *, static: bool = True
) -> Path:
    """Write a report; each file appears whole or not at all.

    Args:
        path: of the HTML file; its folder is made.
        sections: in order.
        title: of the page.
        subtitle: one line below it.
        static: whether to write its figures beside it too, as PNG and SVG by their names.

    Returns:
        The path.
    """
    text = report_html(sections, title, subtitle)
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    if static and (figures := figures_of(sections)):
        from server.figures.static import write_static

        write_static(path.parent, figures)
    return path


def report_html(sections: Sequence[Section], title: str, subtitle: str = "") -> str:
    """Return the page of `write_report`."""
    body, figures = report_body(sections)
    names = _anchors([s.heading for s in sections])
    contents = "".join(f'<li><a href="#{n}">{_text(s.heading)}</a></li>' for n, s in zip(names, sections, strict=True))
    style = files("server.pages").joinpath("report.css").read_text(encoding="utf-8")
    return "\n".join(
        [
            "<!DOCTYPE html>",
            '<html lang="en"><head><meta charset="utf-8">',
            f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<title>{_text(title)}</title>",
            f'<style>\n{style}</style></head><body class="report">',
            report_header(title, subtitle),
            "<main>",
            body,
            "</main>",
            f'<nav aria-label="Contents"><ol>{contents}</ol></nav>' if len(sections) > 1 else "",
            *_scripts(figures),
            "</body></html>\n",
        ]
    )


def report_header(title: str, subtitle: str, *, alone: bool = True) -> str:
    """Return the head of a report as HTML; within a page that has a heading of its own its title is a paragraph."""
    named = f"<h1>{_text(title)}</h1>" if alone else f'<p class="title">{_text(title)}</p>'
    return f"<header>{named}{f'<p>{_text(subtitle)}</p>' if subtitle else ''}</header>"


def report_body(sections: Sequence[Section]) -> tuple[str, list[go.Figure]]:
    """Return the sections as HTML, with a place `plot0`, `plot1`, … for each of the figures."""
    figures: list[go.Figure] = []
    body: list[str] = []
    for section, name in zip(sections, _anchors([s.heading for s in sections]), strict=True):
        heading = f"<h2>{_text(section.heading)}</h2>"
        # Open as long as no script has drawn what stands in it: a figure has no size where it is not shown.
        fold = ("<details open><summary>", "</summary>", "</details>") if section.folded else ("", "", "")
        body.append(f'<section id="{name}">{fold[0]}{heading}{fold[1]}')
        for part in section.parts:
            if isinstance(part, Table):
                body.append(_table(part))
            elif isinstance(part, Plot):
                body.append(_picture(part, len(figures)))
                figures.append(part.figure)
            elif isinstance(part, Steps):
                body.append(f"<ol>{''.join(f'<li>{_text(item)}</li>' for item in part.items)}</ol>")
            else:
                body.append(f"<p>{_text(part)}</p>")
        body.append(f"{fold[2]}</section>")
    return "\n".join(body), figures


def _text(text: object) -> str:
    return html.escape(str(text))


def _anchors(headings: Sequence[str]) -> list[str]:
    out: list[str] = []
    for heading in headings:
        name = re.sub(r"[^a-z0-9]+", "-", heading.lower()).strip("-") or "part"
        out.append(name if name not in out else f"{name}-{len(out) + 1}")
    return out


def _table(table: Table) -> str:
    columns = len(table.header)
    figures = [all(_is_number(row[k]) for row in table.rows) and bool(table.rows) for k in range(columns)]
    kinds = [' class="n"' if f else "" for f in figures]
    head = "".join(
        f'<th scope="col"{k}>{_text(h)}</th>' if h else "<td></td>" for h, k in zip(table.header, kinds, strict=True)
    )
    rows = "".join(
        "<tr>" + "".join(f"<td{k}>{_text(v)}</td>" for v, k in zip(row, kinds, strict=True)) + "</tr>"
        for row in table.rows
    )
    caption = f"<caption>{_text(table.caption)}</caption>" if table.caption else ""
    inner = f"{caption}<thead><tr>{head}</tr></thead><tbody>{rows}</tbody>"
    return f'<div class="wide" tabindex="0"><table>{inner}</table></div>'


def _is_number(text: str) -> bool:
    return bool(re.fullmatch(r"[\s\d.,;()%°NmgkΔ±→–\N{MINUS SIGN}+-]*", text)) and text.strip() not in ("",)


def _picture(plot: Plot, index: int) -> str:
    layout = plot.figure.layout
    size = f"width:{int(layout.width or 700)}px;height:{int(layout.height or 450)}px"
    caption = f"<figcaption>{_text(plot.caption)}</figcaption>" if plot.caption else ""
    named = _text(html.unescape(re.sub(r"<[^>]*>", " ", str(layout.title.text or "Figure"))))
    place = f'<div class="plot" id="plot{index}" role="img" aria-label="{named}" style="{size}"></div>'
    return f'<figure><div class="wide" tabindex="0">{place}</div>{caption}</figure>'


def _scripts(figures: Sequence[go.Figure]) -> list[str]:
    if not figures:
        return []
    from plotly.offline import get_plotlyjs

    # A "<" in JSON only ever stands in text; escaped, no name can end the script.
    data = json.dumps([json.loads(f.to_json()) for f in figures], ensure_ascii=False).replace("<", "\\u003c")
    data = data.replace("\N{LINE SEPARATOR}", "\\u2028").replace("\N{PARAGRAPH SEPARATOR}", "\\u2029")
    return [
        f"<script>{get_plotlyjs()}</script>",
        "<noscript><p>The figures need a browser with scripts switched on; the tables do not.</p></noscript>",
        f"<script>const figures = {data};",
        f"const options = {json.dumps(OPTIONS)};",
        f"{_DRAW}</script>",
    ]
