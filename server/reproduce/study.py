"""Published studies, and the result of computing one again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple

from daq.errors import InputError
from fingermodel.studies.published import Row

if TYPE_CHECKING:
    from server.figures.plot import Plot

Progress = Callable[[float], None]
Line = Sequence[str | float | None]


@dataclass(frozen=True)
class Sheet:
    """A table beside the rows: what the study does not print, or our own answer to its question."""

    title: str  # what is in it
    columns: Sequence[str]  # their headings, with units
    lines: Sequence[Line]  # one list of cells a line
    notes: Sequence[str] = ()  # what it means, a sentence each


@dataclass(frozen=True)
class Reproduction:
    """A study's figures beside ours."""

    rows: tuple[Row, ...]  # every published figure
    assumptions: tuple[str, ...] = ()  # what the paper leaves out and what stands in its place, a sentence each
    sheets: tuple[Sheet, ...] = ()  # tables beside the rows
    # Further results of this study as plain data, merged into the JSON answer.
    results: dict[str, Any] = field(default_factory=dict)
    plots: Callable[[], Sequence[Plot]] | None = None  # draws the study's figures

    def as_dict(self) -> dict[str, Any]:
        """Return plain data."""
        sheets = [{"title": s.title, "columns": s.columns, "lines": s.lines, "notes": s.notes} for s in self.sheets]
        body = {"rows": [r.as_dict() for r in self.rows], "assumptions": self.assumptions, "sheets": sheets}
        return body | self.results


class Study(NamedTuple):
    """A published study."""

    name: str  # by which it is asked for; also the module beside this one that computes it
    citation: str  # authors, year, journal
    about: str  # what the study is of, in a few plain words


STUDIES = (
    Study("synek2019", "Synek et al. 2019, PeerJ 7:e7470", "tip and bone forces of clamped cadaver fingers"),
    Study(
        "hu2014a", "Hu et al. 2014, PLoS ONE 9:e94533", "forces in a pressing index finger without and with its hood"
    ),
    Study(
        "hu2014b",
        "Hu et al. 2014, BioMed Res Int 2014:743460",
        "the extensor hood of a pressing index finger as a network of springs",
    ),
    Study("wu2008", "Wu et al. 2008, J Biomech 41:668-676", "muscle forces in an index finger that taps on a key"),
    Study(
        "barry2018",
        "Barry et al. 2018, J Biomech, doi 10.1016/j.jbiomech.2018.06.017",
        "tip forces of index finger and thumb, and activation deficits",
    ),
)


def study_of(name: str) -> Study:
    """Return the study of that name.

    Raises:
        InputError: there is none.
    """
    for study in STUDIES:
        if study.name == name:
            return study
    raise InputError(f"no study {name!r}", f"one of {', '.join(s.name for s in STUDIES)}")


def reproduce(name: str, progress: Progress) -> Reproduction:
    """Compute a study again.

    Args:
        name: of the study.
        progress: called with the fraction done.

    Raises:
        InputError: there is no such study.
    """
    done: Reproduction = import_module(f"server.reproduce.{study_of(name).name}").reproduce(progress)
    return done
