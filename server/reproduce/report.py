"""A computed study as one HTML page, with its figures as PNG and SVG beside it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from fingermodel.studies.published import published_table
from server.figures.plot import Plot
from server.figures.report import Picture, Section, Table, write_report
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
        *_pictures(plots),
    ]
    subtitle, figures = f"{study.about}: published and ours", {p.name: p.figure for p in plots}
    return write_report(folder / "reproduce.html", sections, study.citation, subtitle, figures)


def _pictures(plots: Sequence[Plot]) -> list[Section]:
    """Return one section a heading, in order."""
    found: dict[str, list[Picture]] = {}
    for plot in plots:
        found.setdefault(plot.heading, []).append(Picture(plot.figure, plot.caption))
    return [Section(heading, pictures) for heading, pictures in found.items()]


def _cell(value: str | float | None) -> str:
    return "–" if value is None else value if isinstance(value, str) else f"{value:.4g}"
