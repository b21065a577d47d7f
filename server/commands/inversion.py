"""`fingertwin invert`."""

from __future__ import annotations

from pathlib import Path

from fingermodel.session import Session
from fingermodel.studies.inversion import invert_bench
from fingermodel.studies.inverted import Assigned, Inversion, InvertedCase
from server.application.provenance import provenance, told_first
from server.commands.console import answer, progress, say, table
from server.commands.twin import say_first
from server.figures.inversion import inversion_report


def invert_session(session: str, closure: str, model: str | None, figures: Path | None, json: str | None) -> None:
    """Assign muscle and joint forces to a session's tip forces and show them beside what hung.

    Raises:
        InputError: no case that can be inverted.
        ModelError: a finger that the closure does not fit.
    """
    with progress("Reading and correcting") as tell:
        bench = Session.open(session, model, progress=tell, catalogue=False)
    with progress("Inverting"):
        inversion = invert_bench(bench, closure)
    name, about = bench.measured.session.id, provenance(bench)
    body = about | inversion.as_dict() | {"figures": None}
    if figures is not None:
        title, first = f"Forces behind the tip forces: {name}", told_first(about)
        body["figures"] = str(inversion_report(figures, inversion, title, bench.loaded.name, about["notes"], first))
    if answer("invert", body, json):
        return
    say_first(body)
    table(
        "Assigned less hung, over all cases",
        ["muscle", "stands for", "RMS [N]", "within 2 sd", "asked to push", "beyond 2 sd"],
        [
            [m.name, "+".join(m.merged), m.rms_error_N, m.within_2sd, m.pushes, m.pushes_beyond_2sd]
            for m in inversion.muscles
        ],
    )
    for sentence in inversion.verdicts():
        say(sentence)
    table(
        f"{name} with {bench.loaded.name}, {inversion.title}: tension ± sd (hung) [N]",
        *_cases(inversion),
        "contact: force between the bones ± sd (what the model makes of the weights that hung) [N]",
    )
    for note in (*inversion.notes, *about["notes"]):
        say(f"Note: {note}")
    if body["figures"]:
        say(f"Figures: {body['figures']}")


def _cases(inversion: Inversion) -> tuple[list[str], list[list[str]]]:
    """Return columns and rows of the cases."""
    muscles, joints = [m.name for m in inversion.muscles], list(inversion.cases[0].contacts)
    columns = ["case", "posture", "hung", *muscles, *(f"{joint} contact" for joint in joints)]
    rows = []
    for case in inversion.cases:
        cells = [*(case.muscles[m] for m in muscles), *(case.contacts[j] for j in joints)]
        rows.append([case.id, case.posture, _hung(case), *map(_cell, cells)])
    return columns, rows


def _hung(case: InvertedCase) -> str:
    return " ".join(f"{muscle} {mass:g} g" for muscle, mass in case.masses_g.items() if mass) or "none"


def _cell(force: Assigned) -> str:
    hung = f" ({force.hung_N:.1f})" if force.hung_N else ""
    return f"{force.force_N:z.1f} ± {force.sd_N:.1f}{hung}"
