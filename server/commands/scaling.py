"""`fingertwin scale`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from daq.errors import InputError
from fingermodel.studies.scaling import NEUTRAL, Scaled, scale_finger, write_scaled
from server.application.exporting import writing
from server.commands.console import answer, say, table
from server.commands.entries import numbers


def scale_specimen(
    finger: str,
    bones: Sequence[str],
    moment_arms: Sequence[str],
    references: Sequence[str],
    postures: str,
    out: Path,
    json: str | None,
) -> None:
    """Scale a finger to a specimen, write its file, and show lengths and moment arms before and after.

    Raises:
        InputError: a name or a length that cannot be used, or a file that cannot be written.
    """
    if out.suffix.lower() not in (".yaml", ".yml"):
        raise InputError(f"--out {out.name}", "a finger file, which ends in .yaml")
    if Path(finger).is_file() and out.exists() and out.samefile(finger):
        raise InputError(f"--out {out} is the finger that is scaled", "another file", "Choose another --out")
    scaled = scale_finger(
        finger,
        measures(bones, "--bone", "PP=40.1"),
        measures(moment_arms, "--moment-arm", "FDP@MCP=10.2"),
        measures(references, "--reference", "DP=19.0"),
        out.stem,
        postures,
    )
    with writing(out):
        write_scaled(scaled, out)
    if answer("scale", scaled.as_dict() | {"file": str(out)}, json):
        return
    _show(scaled)
    say(f"Finger: {out}")


def _show(scaled: Scaled) -> None:
    table(
        f"{scaled.base.id}, scaled",
        ["bone", "before [mm]", "after [mm]", "factor", "how"],
        [[b.bone, b.before_mm, b.after_mm, b.factor, b.how] for b in scaled.bones],
    )
    names = [p for p in scaled.arms[0].after_mm if p != NEUTRAL]
    table(
        "Flexion moment arms, before > after [mm]",
        ["tendon", NEUTRAL, *(p.replace("_", " ") for p in names), "mean", "asked"],
        [
            [
                a.segment,
                *(f"{a.before_mm[p]:.1f} > {a.after_mm[p]:.1f}" for p in (NEUTRAL, *names)),
                f"{a.mean_before_mm:.1f} > {a.mean_after_mm:.1f}",
                a.asked_mm,
            ]
            for a in scaled.arms
        ],
        f"mean: over the postures of {scaled.postures_of}, without the neutral one",
    )
    for assumption in scaled.assumptions:
        say(assumption)


def measures(entries: Sequence[str], option: str, example: str) -> dict[str, float]:
    """Return lengths in mm by name, from entries such as `PP=40.1`.

    Raises:
        InputError: an entry of another form, or a name that comes twice.
    """
    return numbers(entries, option, f"a name and a length in mm, such as {example}", "mm")
