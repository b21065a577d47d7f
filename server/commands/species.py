"""`fingertwin species`."""

from __future__ import annotations

from pathlib import Path

from fingermodel.studies.published import published_table
from fingermodel.studies.species import SpeciesResult
from fingermodel.studies.species_sides import PLANES, Spread, shared
from server.application.species import compare_species
from server.commands.console import answer, progress, say, table
from server.figures.species import species_report

KINDS = ("predicted", "measured")
WORDS = {"tension_to_tip": "tension / tip", "bone_to_tip": "bone / tip"}


def compare_fingers(
    of: str | None,
    other: str | None,
    of_session: str | None,
    other_session: str | None,
    figures: Path | None,
    json: str | None,
) -> None:
    """Set two fingers side by side; print their sizes and force ratios, and draw them.

    Raises:
        InputError: a finger or session that cannot be read, or that do not fit together.
    """
    with progress("Comparing") as tell:
        result = compare_species(of, other, of_session, other_session, tell)
    body = result.as_dict() | {"figures": None}
    if figures is not None:
        body["figures"] = str(species_report(result, figures))
    if answer("species", body, json):
        return
    _show(result)
    if figures is not None:
        say(f"Figures: {body['figures']}")


def _show(result: SpeciesResult) -> None:
    a, b = result.of, result.other
    shown = [
        (name, side, kind)
        for name, side in zip(result.names, (a, b), strict=True)
        for kind in (KINDS if side.session else KINDS[:1])
    ]
    loaded = [s for s in result.of.arms_mm if s.rpartition(".")[2] in result.main.split("+")]
    arms = [(n, x, y) for n, x, y in shared(a.arms_mm, b.arms_mm) if n in loaded]
    sizes: list[tuple[str, float | None, float | None]] = shared(a.lengths_mm, b.lengths_mm)
    if set(a.lengths_mm) == set(b.lengths_mm):
        sizes.append(("together", sum(a.lengths_mm.values()), sum(b.lengths_mm.values())))
    sizes += arms
    table(
        "Bone lengths and mean flexion moment arms [mm]",
        ["", a.label, b.label, "ratio"],
        [[name, x, y, y / x if x and y else None] for name, x, y in sizes],
    )
    table(
        "Force ratios, mean (least to most) over postures and loads",
        ["tendons", "ratio", "plane", *(f"{name}, {kind}" for name, _, kind in shown)],
        [
            [
                *(tendons, WORDS[key], plane),
                *(_cell(s.spread(tendons, key, measured=kind == "measured", plane=plane)) for _, s, kind in shown),
            ]
            for tendons in result.tendons
            for key in WORDS
            for plane in (PLANES if tendons == result.main else PLANES[:1])
        ],
    )
    table(
        f"{result.main} by posture: tension / tip force in space, and direction of the tip force",
        ["posture", "finger", "load", *(f"{k}{unit}" for unit in ("", " [deg]") for k in KINDS)],
        [
            [
                load.posture.replace("_", " "),
                name,
                " ".join(f"{m} {g:g} g" for m, g in load.masses_g.items()),
                *(load.ratios(measured=m)["tension_to_tip"] for m in (False, True)),
                *(_angle(load.directions_deg(measured=m)["tip"]) for m in (False, True)),
            ]
            for posture in dict.fromkeys([*a.postures_rad, *b.postures_rad])
            for name, side in zip(result.names, (a, b), strict=True)
            for load in side.of_tendons(result.main)
            if load.posture == posture
        ],
        "direction in the sagittal plane, axes of the last bone: 0 proximal, 90 dorsal",
    )
    if result.steps:
        table(
            f"Step by step, {result.main}",
            ["finger", "tension / tip", "bone / tip"],
            [[s.what, s.tension_to_tip, s.bone_to_tip] for s in result.steps],
        )
    if result.rows:
        header, rows, notes = published_table(result.rows)
        table(
            "Synek et al. 2019, PeerJ 7:e7470",
            header,
            rows,
        )
        for note in notes:
            say(note)
    for assumption in result.assumptions:
        say(assumption)


def _cell(spread: Spread | None) -> str:
    if spread is None:
        return "–"
    return f"{spread.mean:.2f} ({spread.least:.2f} to {spread.most:.2f})"


def _angle(degrees: float | None) -> str:
    return "–" if degrees is None else f"{degrees:.1f}"
