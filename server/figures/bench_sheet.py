"""A sheet for the bench, to print: every load case in order, what to hang, boxes to tick, and room for notes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import wrap
from typing import Any

import matplotlib as mpl
from matplotlib.backends.backend_pdf import FigureCanvasPdf, PdfPages
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

from daq.files import replacing
from daq.sessions.protocols import PlannedCase, Protocol

# A4 upright; margins, heights of lines and places of columns from the left [mm].
_WIDTH, _HEIGHT, _LEFT, _RIGHT, _TOP, _BOTTOM = 210.0, 297.0, 14.0, 196.0, 16.0, 16.0
_ROW, _TEXT = 8.4, 5.4
_COLUMNS = {"case": 14.0, "hung": 29.0, "role": 84.0, "at": 103.0, "tare": 121.0, "read": 136.0, "notes": 151.0}
_TITLES = ("case", "hang [g]", "for", "planned", "tared", "read", "notes")
_MM_PER_INCH = 25.4
# Characters in a line of the head, and of what is hung, at their size.
_MOST_HEAD, _MOST_HUNG = 100, 27
_SETTINGS: Any = {"pdf.fonttype": 42, "font.family": "DejaVu Sans"}
_ROLES = {"identification": "fit", "validation": "validation"}


@dataclass
class _Pages:
    """Pages that are filled from the top."""

    title: str
    figures: list[Figure]
    y: float = 0.0

    def text(self, x: float, text: str, size: float = 9.0, **more: Any) -> None:
        """Write at a place of the line [mm]."""
        self.figures[-1].text(
            x / _WIDTH, 1.0 - self.y / _HEIGHT, text, fontsize=size, va="baseline", parse_math=False, **more
        )

    def line(self, x0: float, x1: float, width: float = 0.5) -> None:
        """Draw a line just below the text [mm]."""
        y = 1.0 - (self.y + 1.6) / _HEIGHT
        self.figures[-1].add_artist(Line2D([x0 / _WIDTH, x1 / _WIDTH], [y, y], linewidth=width, color="black"))

    def box(self, x: float) -> None:
        """Draw a box to tick [mm]."""
        place = (x / _WIDTH, 1.0 - (self.y + 0.6) / _HEIGHT)
        self.figures[-1].add_artist(
            Rectangle(
                place, 4.0 / _WIDTH, 4.0 / _HEIGHT, fill=False, linewidth=0.8, transform=self.figures[-1].transFigure
            )
        )

    def begin(self) -> None:
        """Begin a page with its heading."""
        self.figures.append(Figure(figsize=(_WIDTH / _MM_PER_INCH, _HEIGHT / _MM_PER_INCH)))
        FigureCanvasPdf(self.figures[-1])
        self.y = _TOP
        self.text(_LEFT, self.title, 13.0, weight="bold")
        self.down(9.0)

    def down(self, by: float) -> None:
        """Go down [mm]."""
        self.y += by

    def needs(self, height: float) -> bool:
        """Begin a page where so much does not fit on this one [mm]; return whether."""
        if self.y + height <= _HEIGHT - _BOTTOM:
            return False
        self.begin()
        return True


def write_bench_sheet(
    path: Path,
    protocol: Protocol,
    cases: Sequence[PlannedCase],
    title: str,
    finger: str,
    bones: Sequence[tuple[str, float]],
) -> int:
    """Write a bench sheet as PDF, A4.

    Args:
        path: of the file.
        protocol: with its postures.
        cases: in the order in which they are hung.
        title: of the sheet.
        finger: in words.
        bones: measured lengths of the specimen's bones [mm], to be written down with the rest.

    Returns:
        How many pages it has.
    """
    with mpl.rc_context(_SETTINGS):
        pages = _Pages(title, [])
        pages.begin()
        _head(pages, protocol, finger, bones)
        before: tuple[str, str, float] | None = None
        for case in cases:
            block = (case.posture, case.location, case.block_start_s)
            height = _ROW * (3.0 if block != before else 1.0) + (9.0 if block != before else 0.0)
            if pages.needs(height) or block != before:
                _block(pages, case, protocol, again=block == before)
            before = block
            _case(pages, case)
        _foot(pages)
        with replacing(path) as temporary, PdfPages(temporary, metadata={"Title": title, "CreationDate": None}) as file:
            for figure in pages.figures:
                file.savefig(figure)
    return len(pages.figures)


def _head(pages: _Pages, protocol: Protocol, finger: str, bones: Sequence[tuple[str, float]]) -> None:
    for left, right in (
        ("specimen", "date"),
        ("load cell", "operator"),
        ("friction, cord, pulleys", "room, temperature"),
    ):
        pages.text(_LEFT, left)
        pages.line(_LEFT + 36.0, 104.0)
        pages.text(110.0, right)
        pages.line(144.0, _RIGHT)
        pages.down(_ROW)
    lengths = ", ".join(f"{bone} {length:g} mm" for bone, length in bones)
    heaviest = ", ".join(f"{tendon} {mass:g} g" for tendon, mass in protocol.heaviest_g().items())
    said = {"Finger": finger, "Bones": lengths, "Protocol": protocol.title or protocol.id, "Heaviest": heaviest}
    for name, text in said.items():
        for line in wrap(f"{name}: {text}", _MOST_HEAD) if text else ():
            pages.text(_LEFT, line)
            pages.down(_TEXT)


def _block(pages: _Pages, case: PlannedCase, protocol: Protocol, *, again: bool) -> None:
    """Write the heading of a posture at one place of the cell, with its tare; `again` on a new page."""
    pages.down(4.0)
    angles = ", ".join(f"{joint} {angle:g}°" for joint, angle in protocol.postures_deg[case.posture].items())
    more = ", continued" if again else ""
    pages.text(_LEFT, f"{case.posture.replace('_', ' ')} at the {case.location}{more}", 11.0, weight="bold")
    pages.text(_COLUMNS["role"], angles, 9.0)
    pages.down(_TEXT)
    for x, title in zip(_COLUMNS.values(), _TITLES, strict=True):
        pages.text(x, title, 7.5, color="dimgray")
    pages.line(_LEFT, _RIGHT, 0.8)
    pages.down(_ROW)
    if not again:
        pages.text(_COLUMNS["hung"], "nothing: tare", 9.5)
        pages.box(_COLUMNS["tare"])
        pages.line(_COLUMNS["notes"], _RIGHT, 0.4)
        pages.down(_ROW)


def _case(pages: _Pages, case: PlannedCase) -> None:
    hung = " + ".join(f"{tendon} {mass:g}" for tendon, mass in case.masses_g.items()) or "nothing"
    told = case.told()
    more = "".join(f", {told[key]}" for key in ("direction", "note") if key in told)
    pages.text(_COLUMNS["case"], case.id)
    hung += " (again)" if case.repeat_of else ""
    pages.text(_COLUMNS["hung"], hung, min(9.5, 9.5 * _MOST_HUNG / len(hung)), weight="bold")
    pages.text(_COLUMNS["role"], _ROLES[case.role], 8.0)
    pages.text(_COLUMNS["at"], f"{int(case.loaded_s[0] // 60)}:{int(case.loaded_s[0] % 60):02d}", 8.0, color="dimgray")
    pages.box(_COLUMNS["tare"])
    pages.box(_COLUMNS["read"])
    if more:
        pages.text(_COLUMNS["notes"], more.removeprefix(", "), 7.0, color="dimgray")
    pages.line(_COLUMNS["notes"], _RIGHT, 0.4)
    pages.down(_ROW)


def _foot(pages: _Pages) -> None:
    count = len(pages.figures)
    for number, figure in enumerate(pages.figures, 1):
        y = 1.0 - (_HEIGHT - 9.0) / _HEIGHT
        figure.text(_RIGHT / _WIDTH, y, f"{number} of {count}", fontsize=8, ha="right", color="dimgray")
