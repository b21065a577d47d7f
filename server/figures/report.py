"""A report as one HTML file: headings, sentences, tables and figures, nothing loaded from anywhere.

Plotly's own script is written into the file once, from the installed wheel. A policy in the page forbids every
connection, so that it shows the same offline, and a hostile name in a session can do nothing.
"""

from __future__ import annotations

import html
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import plotly.graph_objects as go

from daq.files import replacing

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


@dataclass(frozen=True)
class Table:
    """A table; numbers stand right-aligned under their heading."""

    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""


@dataclass(frozen=True)
class Picture:
    """A figure with a sentence below it."""

    figure: go.Figure
    caption: str = ""


@dataclass(frozen=True)
class Section:
    """A heading with what follows it, in order: sentences, tables, figures."""

    heading: str
    parts: Sequence[str | Table | Picture]


def write_report(path: Path, sections: Sequence[Section], title: str, subtitle: str = "") -> Path:
    """Write a report; the file appears whole or not at all.

    Args:
        path: of the HTML file; its folder is made.
        sections: in order.
        title: of the page.
        subtitle: one line below it.

    Returns:
        The path.
    """
    text = report_html(sections, title, subtitle)
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return path


def report_html(sections: Sequence[Section], title: str, subtitle: str = "") -> str:
    """Return the page of `write_report`."""
    names = _anchors([s.heading for s in sections])
    figures: list[go.Figure] = []
    body: list[str] = []
    for section, name in zip(sections, names, strict=True):
        body.append(f'<section id="{name}"><h2>{_text(section.heading)}</h2>')
        for part in section.parts:
            if isinstance(part, Table):
                body.append(_table(part))
            elif isinstance(part, Picture):
                body.append(_picture(part, len(figures)))
                figures.append(part.figure)
            else:
                body.append(f"<p>{_text(part)}</p>")
        body.append("</section>")
    contents = "".join(f'<li><a href="#{n}">{_text(s.heading)}</a></li>' for n, s in zip(names, sections, strict=True))
    return "\n".join(
        [
            "<!DOCTYPE html>",
            '<html lang="en"><head><meta charset="utf-8">',
            f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<title>{_text(title)}</title>",
            f"<style>{_STYLE}</style></head><body>",
            f"<header><h1>{_text(title)}</h1>{f'<p>{_text(subtitle)}</p>' if subtitle else ''}</header>",
            f'<nav aria-label="Contents"><ol>{contents}</ol></nav>' if len(sections) > 1 else "",
            "<main>",
            *body,
            "</main>",
            *_scripts(figures),
            "</body></html>\n",
        ]
    )


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
    head = "".join(f'<th scope="col"{k}>{_text(h)}</th>' for h, k in zip(table.header, kinds, strict=True))
    rows = "".join(
        "<tr>" + "".join(f"<td{k}>{_text(v)}</td>" for v, k in zip(row, kinds, strict=True)) + "</tr>"
        for row in table.rows
    )
    caption = f"<caption>{_text(table.caption)}</caption>" if table.caption else ""
    return f'<div class="wide"><table>{caption}<thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>'


def _is_number(text: str) -> bool:
    return bool(re.fullmatch(r"[\s\d.,;()%°NmgkΔ±→–\N{MINUS SIGN}+-]*", text)) and text.strip() not in ("",)


def _picture(picture: Picture, index: int) -> str:
    layout = picture.figure.layout
    size = f"width:{int(layout.width or 700)}px;height:{int(layout.height or 450)}px"
    caption = f"<figcaption>{_text(picture.caption)}</figcaption>" if picture.caption else ""
    return f'<figure><div class="wide"><div class="plot" id="plot{index}" style="{size}"></div></div>{caption}</figure>'


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
        "figures.forEach((f, i) => Plotly.newPlot('plot' + i, f.data, f.layout, options));</script>",
    ]


_STYLE = """
:root { color-scheme: light; }
body { margin: 0 auto; padding: 32px 24px 64px; max-width: 976px; background: #fff; color: #222;
  font: 16px/1.5 Helvetica, Arial, "Liberation Sans", "DejaVu Sans", sans-serif; }
header { border-bottom: 1px solid #ccc; margin-bottom: 16px; }
h1 { font-size: 26px; font-weight: 600; line-height: 1.25; margin: 0 0 4px; overflow-wrap: anywhere; }
header p { color: #555; margin: 0 0 14px; overflow-wrap: anywhere; }
h2 { font-size: 19px; font-weight: 600; margin: 40px 0 8px; }
p { max-width: 44em; margin: 8px 0; }
nav ol { margin: 0; padding-left: 1.4em; columns: 2; font-size: 15px; }
a { color: #1f5a8a; }
figure { margin: 16px 0 24px; break-inside: avoid; }
figcaption { color: #555; font-size: 14px; max-width: 50em; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: 14px; margin: 12px 0 20px; font-variant-numeric: tabular-nums; }
caption { text-align: left; color: #555; padding-bottom: 6px; }
th, td { padding: 3px 14px 3px 0; text-align: left; vertical-align: top; border-bottom: 1px solid #eee; }
th { font-weight: 600; border-bottom: 1px solid #999; vertical-align: bottom; }
th.n, td.n { text-align: right; }
td { white-space: nowrap; }
@media print {
  @page { size: A4; margin: 14mm; }
  body { padding: 0; max-width: none; font-size: 11pt; }
  nav { display: none; }
  .wide { overflow: visible; }
  .plot { zoom: 0.7; }
  table { font-size: 7.5pt; }
  h2 { break-after: avoid; }
  tr, figure { break-inside: avoid; }
  thead { display: table-header-group; }
  .modebar { display: none; }
}
"""
