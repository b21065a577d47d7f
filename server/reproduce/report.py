"""A computed study as one HTML page, with its figures as PNG and SVG beside it."""

from __future__ import annotations

from pathlib import Path

from fingermodel.studies.published import published_table
from server.figures.report import Section, Table, by_heading, write_report
from server.reproduce.study import Reproduction, Study


def write_study(folder: Path, study: Study, done: Reproduction) -> Path:
    """Write `reproduce.html` and every figure as PNG and SVG; return the page.

    Args:
        folder: made where it is absent.
        study: that was computed.
        done: what came out.
    """
    plots = [] if done.plots is None else list(done.plots())
    header, rows, notes = published_table(done.rows)
    sections = [
        Section("Published and ours", [Table(header, rows), *notes]),
        *([Section("What the paper leaves out", list(done.assumptions))] if done.assumptions else []),
        *(
            Section(s.title, [Table(s.columns, [[_cell(x) for x in line] for line in s.lines]), *s.notes])
            for s in done.sheets
        ),
        *by_heading((p.heading, p) for p in plots),
    ]
    subtitle = f"{study.about}: published and ours"
    return write_report(folder / "reproduce.html", sections, study.citation, subtitle)


def _cell(value: str | float | None) -> str:
    return "–" if value is None else value if isinstance(value, str) else f"{value:.4g}"
