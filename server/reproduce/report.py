"""A computed study as one HTML page, with its figures as PNG and SVG beside it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from fingermodel.studies.published import ours, verdict
from server.figures.plot import Plot
from server.figures.report import Picture, Section, Table, write_report
from server.figures.static import write_static
from server.reproduce.study import Reproduction, Study


def write_study(folder: Path, study: Study, done: Reproduction) -> Path:
    """Write `reproduce.html` and every figure as PNG and SVG; return the page.

    Args:
        folder: made where it is absent.
        study: that was computed.
        done: what came out.
    """
    plots = [] if done.plots is None else list(done.plots())
    rows = [[r.quantity, r.printed, ours(r), r.unit, verdict(r)] for r in done.rows]
    notes = list(dict.fromkeys(f"{r.note[:1].upper()}{r.note[1:]}." for r in done.rows if r.note))
    sections = [
        Section("Published and ours", [Table(["quantity", "published", "ours", "unit", ""], rows), *notes]),
        *([Section("What the paper leaves out", list(done.assumptions))] if done.assumptions else []),
        *(
            Section(s.title, [Table(s.columns, [[_cell(x) for x in line] for line in s.lines]), *s.notes])
            for s in done.sheets
        ),
        *_pictures(plots),
    ]
    page = write_report(folder / "reproduce.html", sections, study.citation, f"{study.about}: published and ours")
    write_static(folder, {p.name: p.figure for p in plots})
    return page


def _pictures(plots: Sequence[Plot]) -> list[Section]:
    """One section a heading, in order."""
    found: dict[str, list[Picture]] = {}
    for plot in plots:
        found.setdefault(plot.heading, []).append(Picture(plot.figure, plot.caption))
    return [Section(heading, pictures) for heading, pictures in found.items()]


def _cell(value: str | float | None) -> str:
    return "–" if value is None else value if isinstance(value, str) else f"{value:.4g}"
