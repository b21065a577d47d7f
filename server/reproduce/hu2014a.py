"""Hu, Howard, Ren 2014 (PLoS ONE 9:e94533): forces in the pressing index finger, without and with the extensor hood.

The study's own postures and loads are in tables that are not at hand. Three measured ones of the same laboratory stand
in for them. Its points of attachment are not published at all; ours are those of An et al. 1979, as they are, and with
one or two moment arms fitted to the study's first posture.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from fingermodel.compiled.compilation import prepare_jax
from fingermodel.studies.published import Row, not_available, row, row_about, row_within
from server.figures.plot import Plot
from server.figures.pressing import Panel, pressing_figure
from server.reproduce.hu2014a_fingers import (
    COLUMNS,
    MODELS,
    PUBLISHED,
    Pressed,
    index_finger,
    means,
    pressed,
    with_fitted_flexor,
    with_fitted_terminal_slip,
)
from server.reproduce.hu2014a_sheets import forces_sheet, least_sheet, needed_sheet, sister_sheet, terminal_sheet
from server.reproduce.printed import reference
from server.reproduce.study import Progress, Reproduction

NORMATIVE, FLEXOR, TERMINAL = "An's index", "flexor fitted", "terminal slip fitted"


MIXED = (
    "the load stands for postures 2 and 3: the range is from the lower mean less its spread to the higher plus its own"
)
SUBJECT = "range of one subject's trials at four postures; ours are three loads of the same subject"
LAWS = (
    "printed means against the study's own Eqs 10 and 11, by which LE = 0.4 (RI + LU + UI): a linear law, which means "
    "must meet too, and the printed ones do not"
)
CHANGES = "change of the printed means; the study's text has means of the changes, for which its trials would be needed"
GROWS = "points of per cent; the study: greater with flexion, so above zero"
GIVEN = "given: our moment arms are from it"
UNUSED = {
    FLEXOR: "flexor fitted: FDP's arms at DIP and PIP to PE and PF of Table 1, posture 1; no other number was used",
    TERMINAL: "terminal slip fitted: TE's arm at the DIP to PF of Table 1, posture 1; no other number was used",
}
PUSH = "a negative force: the closure asks the muscle to push"
MEANS = (
    "One number is fitted, TE's moment arm at the DIP, to the printed PF of posture 1 without a hood.",
    "Changes of means are not means of changes: the study's text has 27 % and 41 % at the MCP for the two most flexed "
    "postures where its tables have 25 % and 29 %.",
    "Radial is RI and LU together, as printed; with the hood RI alone is asked to push in every posture.",
)
CARRIED = (
    "Two numbers are fitted, FDP's moment arms at DIP and PIP, to the printed PE and PF of posture 1 without a hood.",
    "Carried to the other postures they fail: the minimal model then asks PE to push.",
)


def reproduce(progress: Progress) -> Reproduction:
    """Compute both models at the three loads, with An's index finger and with fitted moment arms."""
    prepare_jax()
    published = reference("hu2014a")
    normative = index_finger(published)
    fingers = {
        NORMATIVE: normative,
        FLEXOR: with_fitted_flexor(normative, published),
        TERMINAL: with_fitted_terminal_slip(normative, published),
    }
    progress(0.4)
    forces = {who: pressed(finger, published) for who, finger in fingers.items()}
    progress(0.7)
    own, flexor, terminal = forces.values()
    rows = [
        *_law_rows(published),
        *_claim_rows(published),
        *_table_rows(own, published, NORMATIVE),
        *_change_rows(own, published, NORMATIVE),
        *_range_rows(own, published, NORMATIVE),
        *_fitted_rows(flexor[:1], published, FLEXOR),
        *_fitted_rows(terminal, published, TERMINAL),
        *_range_rows(terminal, published, TERMINAL),
        *_flexion_rows(TERMINAL, {c: (-terminal[0].change_pct(c), -terminal[-1].change_pct(c)) for c in COLUMNS}),
    ]
    sheets = (
        forces_sheet("Terminal slip fitted to posture 1: forces per newton of load", terminal, published, MEANS),
        forces_sheet("Flexor fitted to posture 1: forces per newton of load", flexor, published, CARRIED),
        needed_sheet(normative, published),
        terminal_sheet(normative, published),
        sister_sheet(forces, published),
        least_sheet(normative, published),
    )
    progress(1.0)
    return Reproduction(
        tuple(rows),
        tuple(published["assumptions"]),
        sheets,
        {"pressing": {who: [p.as_dict() for p in answers] for who, answers in forces.items()}},
        lambda: _plots(forces, published),
    )


def _law_rows(published: dict[str, Any]) -> Iterator[Row]:
    for k, columns in enumerate(published["full"]):
        extensor, _, radial, ulnar = (columns[i][0] for i in range(4))
        ours = 0.4 * (float(radial) + float(ulnar))
        yield row(f"Table 2, posture {k + 1}: LE by the laws from its RI + LU and UI", extensor, ours, "P", LAWS)


def _claim_rows(published: dict[str, Any]) -> Iterator[Row]:
    """Yield rows on the hood's influence as the study's text states it, against its own tables."""
    changes: dict[str, list[float]] = {c: [] for c in COLUMNS}
    for k in range(4):
        without, with_hood = (means(published, model, (k + 1,)) for model in ("minimal", "full"))
        for c in COLUMNS:
            changes[c].append(100.0 * (1.0 - with_hood[c] / without[c]))
    said = published["changes_pct"]
    for what, less, (low, high) in (
        ("intrinsics", [*changes["radial"], *changes["ulnar"]], said["intrinsics"]),
        ("MCP contact", changes["MCP"], said["MCP"]),
    ):
        yield row(f"Tables 1 and 2, {what} less with the hood: least", low, min(less), "%", CHANGES)
        yield row(f"Tables 1 and 2, {what} less with the hood: most", high, max(less), "%", CHANGES)
    name = "Tables 1 and 2, posture 2: extensor less with the hood"
    yield row(name, said["extensor, posture 2"], changes["extensor"][1], "%", CHANGES)
    yield from _flexion_rows("Tables 1 and 2", {c: (less[0], less[3]) for c, less in changes.items()})


def _flexion_rows(who: str, less: Mapping[str, tuple[float, float]]) -> Iterator[Row]:
    """Yield rows on whether the hood takes more off a force in posture 1 than in posture 4 [%]."""
    for column, what in (("MCP", "MCP contact"), ("radial", "radial intrinsics"), ("ulnar", "ulnar intrinsics")):
        more = less[column][0] - less[column][1]
        name = f"{who}, {what}: taken off in posture 1 less that in posture 4"
        yield Row(name, None, more, "%", more > 0.0, GROWS, "above 0")


def _table_rows(own: Sequence[Pressed], published: dict[str, Any], who: str) -> Iterator[Row]:
    for p in own:
        for model, label in MODELS.items():
            for i, column in enumerate(COLUMNS):
                name, ours = f"{who}, {p.title}, {label}: {column}", p.forces[model][column]
                note = PUSH if ours < 0.0 else ""
                printed = [published[PUBLISHED[model]][k - 1][i] for k in p.postures]
                if len(printed) == 1:
                    mean, spread = printed[0]
                    yield row_about(name, mean, spread, ours, "P", note)
                else:
                    low = min(float(m) - float(sd) for m, sd in printed)
                    high = max(float(m) + float(sd) for m, sd in printed)
                    note = f"{note}; {MIXED}" if note else MIXED
                    yield row_within(name, f"{low:.3f}", f"{high:.3f}", ours, "P", note)


def _change_rows(own: Sequence[Pressed], published: dict[str, Any], who: str) -> Iterator[Row]:
    """Yield rows on the hood's influence, against the study's text."""
    changes = published["changes_pct"]
    for p in own:
        flexed = p.postures == (1,)
        name = f"{who}, {p.title}, with the hood"
        low, high = changes["MCP, two most flexed" if flexed else "MCP"]
        yield row_within(f"{name}: MCP contact less by", low, high, -p.change_pct("MCP"), "%")
        low, high = changes["intrinsics, two most flexed" if flexed else "intrinsics"]
        for column in ("radial", "ulnar"):
            yield row_within(f"{name}: {column} intrinsics less by", low, high, -p.change_pct(column), "%")
        low, high = changes["DIP and PIP"]
        # The study excepts the PIP of the most flexed posture.
        for column in ("DIP",) if flexed else ("DIP", "PIP"):
            yield row_within(f"{name}: {column} contact more by", low, high, p.change_pct(column), "%")


def _range_rows(own: Sequence[Pressed], published: dict[str, Any], who: str) -> Iterator[Row]:
    for what, columns in (
        ("DIP and PIP contact", ("DIP", "PIP")),
        ("MCP contact", ("MCP",)),
        ("muscles", ("extensor", "flexor", "radial", "ulnar")),
    ):
        every = [p.forces[model][c] for p in own for model in MODELS for c in columns]
        low, high = published["subject_ranges"][what]
        yield row_within(f"{who}, {what}: least", low, high, min(every), "P", SUBJECT)
        yield row_within(f"{who}, {what}: most", low, high, max(every), "P", SUBJECT)


def _fitted_rows(fitted: Sequence[Pressed], published: dict[str, Any], who: str) -> Iterator[Row]:
    given = ("posture 1, no hood: flexor", *(["posture 1, no hood: extensor"] if who == FLEXOR else []))
    for r in _table_rows(fitted, published, who):
        if r.quantity.endswith(given):
            yield not_available(r.quantity, r.printed.split()[0], r.ours, r.unit, GIVEN)
        else:
            yield replace(r, note=r.note or UNUSED[who])
    yield from _change_rows(fitted, published, who)


def _plots(forces: dict[str, list[Pressed]], published: dict[str, Any]) -> list[Plot]:
    def printed(model: str, postures: tuple[int, ...], i: int) -> tuple[float, float]:
        numbers = [published[PUBLISHED[model]][k - 1][i] for k in postures]
        return float(np.mean([float(mean) for mean, _ in numbers])), float(np.mean([float(sd) for _, sd in numbers]))

    def panel(p: Pressed, who: str) -> Panel:
        tables = {m: [printed(m, p.postures, i) for i in range(len(COLUMNS))] for m in MODELS}
        forces = {m: [p.forces[m][c] for c in COLUMNS] for m in MODELS}
        return Panel(f"{who[:1].upper()}{who[1:]}, {p.title}", COLUMNS, tables, forces)

    fitted = [panel(p, TERMINAL) for p in forces[TERMINAL]] + [panel(forces[FLEXOR][0], FLEXOR)]
    return [
        Plot(
            "pressing-fitted",
            "With one or two moment arms fitted to posture 1",
            pressing_figure(fitted, MODELS),
            "One number of the study is used for the upper three panels, two for the lowest; all other bars are "
            "predictions.",
        ),
        Plot(
            "pressing-normative",
            "An's index finger as it is",
            pressing_figure([panel(p, NORMATIVE) for p in forces[NORMATIVE]], MODELS),
            "The same loads with the points of An et al. 1979 and nothing fitted.",
        ),
    ]
