"""`fingertwin reproduce`."""

from __future__ import annotations

from pathlib import Path

from fingermodel.studies.published import published_table
from server.commands.console import answer, progress, say, table
from server.reproduce.report import write_study
from server.reproduce.study import reproduce, study_of


def reproduce_study(name: str, figures: Path | None, json: str | None) -> None:
    """Recompute a published study and set it beside ours.

    Raises:
        InputError: there is no such study.
    """
    study = study_of(name)
    with progress("Reproducing") as tell:
        done = reproduce(name, tell)
    body = {"study": name, "citation": study.citation} | done.as_dict()
    if figures is not None:
        body["figures"] = str(write_study(figures, study, done))
    if answer("reproduce", body, json):
        return
    header, rows, notes = published_table(done.rows)
    table(study.citation, header, rows)
    checked = [r for r in done.rows if r.agrees is not None]
    for note in notes:
        say(note)
    for assumption in done.assumptions:
        say(assumption)
    say(f"{sum(bool(r.agrees) for r in checked)} of {len(checked)} figures that can be recomputed agree.")
    for sheet in done.sheets:
        say()
        table(sheet.title, list(sheet.columns), [list(line) for line in sheet.lines])
        for note in sheet.notes:
            say(note)
    if figures is not None:
        say(f"Figures: {body['figures']}")
