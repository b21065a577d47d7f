"""`fingertwin move`."""

from __future__ import annotations

from pathlib import Path

from fingermodel.studies.movement import move
from server.application.exporting import writing
from server.application.study_tables import write_time_courses
from server.commands.console import answer, progress, say, table
from server.figures.movement import movement_report


def move_finger(
    motion: str, finger: str, muscles: str, steps: int, out: Path | None, figures: Path | None, json: str | None
) -> None:
    """Work out a recorded movement; print its peaks, write its time courses.

    Raises:
        InputError: a file that cannot be used, or torques beyond the muscles' strength.
    """
    with progress("Moving"):
        result = move(motion, finger, muscles, steps)
    body = result.as_dict() | {"file": None, "figures": None}
    if out is not None:
        with writing(out):
            write_time_courses(result, out)
        body["file"] = str(out)
    if figures is not None:
        body["figures"] = str(movement_report(result, figures))
    if answer("move", body, json):
        return
    table(
        f"{result.motion} with {result.finger} and muscles {result.muscle_set}: peaks",
        ["muscle", "peak [N]", "at [s]", "of it passive [%]", "over peak tip force", "most activation [%]"],
        [
            [
                p["muscle"],
                p["peak_N"],
                p["at_s"],
                100.0 * p["passive_share"],
                p["over_tip_force"],
                100.0 * p["largest_activation"],
            ]
            for p in result.peaks()
        ],
    )
    table(
        "Joint torques, flexion positive",
        ["joint", "greatest [N mm]", "least [N mm]"],
        [[name, t["greatest"], t["least"]] for name, t in body["peak_torque_Nmm"].items()],
    )
    contact = result.contact_s()
    if contact:
        say(f"Contact from {contact[0]:.3f} to {contact[1]:.3f} s.")
    for label in ("file", "figures"):
        if body[label]:
            say(f"{'Time courses' if label == 'file' else 'Figures'}: {body[label]}")
