"""`fingertwin activate`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from fingermodel.studies.activation import activate
from fingermodel.studies.activation_result import ActivationResult
from server.application.exporting import writing
from server.application.study_tables import write_deficits
from server.commands.console import answer, progress, say, table
from server.commands.entries import numbers
from server.figures.activation import activation_report


def activate_finger(
    finger: str,
    muscles: str | None,
    posture: Sequence[str],
    activation: Sequence[str],
    force: Sequence[str],
    deficit: Sequence[str],
    out: Path | None,
    figures: Path | None,
    json: str | None,
) -> None:
    """Hold a finger with its muscles active; print what each does at the tip, and its deficits.

    Raises:
        InputError: a file that cannot be used, a name that is not known, or a number out of range.
    """
    with progress("Activating"):
        result = activate(
            finger,
            muscles,
            posture_deg=_numbers(posture, "--posture", "MCP=45"),
            activation=_shares(activation, "--activation", "FDP=50"),
            force_N=_numbers(force, "--force", "palmar=8"),
            lost=_shares(deficit, "--deficit", "FDI=25"),
        )
    body = result.as_dict() | {"file": None, "figures": None}
    if out is not None:
        with writing(out):
            write_deficits(result, out)
        body["file"] = str(out)
    if figures is not None:
        body["figures"] = str(activation_report(result, figures))
    if answer("activate", body, json):
        return
    _show(result)
    for label, text in (("file", "Deficits"), ("figures", "Figures")):
        if body[label]:
            say(f"{text}: {body[label]}")


def _show(result: ActivationResult) -> None:
    angles = ", ".join(f"{n} {a:g}" for n, a in zip(result.rotations, result.posture_deg, strict=True))
    table(
        f"{result.finger} with muscles {result.muscle_set} at {angles} deg: each muscle alone, fully active",
        ["muscle", "tension [N]", "proximal [N]", "dorsal [N]", "radial [N]", "sagittal [N]", "at [deg]",
         "coronal [N]", "at [deg] "],
        [
            [m.muscle, m.tension_N, *m.force_N, *(m.as_dict()[plane][key] for plane in ("sagittal", "coronal")
             for key in ("magnitude_N", "direction_deg"))]
            for m in result.alone
        ],
        "angles from proximal towards dorsal and towards radial",
    )  # fmt: skip
    levels = ", ".join(
        f"{m} {100.0 * a:.0f}" for m, a in zip(result.muscles, result.activation, strict=True) if a > 0.0
    )
    force = " ".join(
        f"{word} {x:z.2f}" for word, x in zip(("proximal", "dorsal", "radial"), result.force_N, strict=True)
    )
    say(f"Baseline, activation in %: {levels or 'none'}. Tip force {force} N.")
    percents = [f"{x:g} %" for x in result.deficits[0].levels_pct]
    table(
        "Tip force while one muscle loses activation: magnitude [N] (turned by [deg])",
        ["muscle", *percents],
        [[d.muscle, *map(_cell, d.magnitudes, d.change_deg())] for d in result.deficits],
    )
    if result.lost_force_N is not None:
        together = result.as_dict()["together"]
        lost = ", ".join(f"{name} {100.0 * share:g} %" for name, share in result.lost.items())
        say(f"With deficits {lost}: {_cell(together['magnitude_N'], together['direction_change_deg'])}.")
    for note in result.notes:
        say(f"Note: {note}")


def _cell(magnitude: float, turned: float | None) -> str:
    return f"{magnitude:.2f}" + ("" if turned is None else f" ({turned:.1f})")


def _numbers(entries: Sequence[str], option: str, example: str) -> dict[str, float]:
    return numbers(entries, option, f"NAME=NUMBER, such as {option} {example}")


def _shares(entries: Sequence[str], option: str, example: str) -> dict[str, float]:
    return {name: value / 100.0 for name, value in _numbers(entries, option, example).items()}
