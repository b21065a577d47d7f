"""Barry et al. 2018 (J Biomech): index finger and thumb with Hill muscles, and what activation deficits do to the tip.

The paper's model is not published, and neither are the muscle activities from which its deficits start. What stands in
for them is said; a figure that hangs on them has no verdict, but ours is beside it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from fingermodel.fingers.files import read_finger
from fingermodel.isometric.forces import IsometricFinger
from fingermodel.muscles.muscle_files import read_muscles
from fingermodel.studies.activation import DIRECTIONS, work_out
from fingermodel.studies.activation_result import angle_between
from fingermodel.studies.published import Row, not_available, row
from server.figures.activation import alone_figure, deficits_figure
from server.figures.plot import Plot
from server.reproduce.barry2018_sheets import Case, alone, arms, deficits, levels, passive, postures, reach
from server.reproduce.printed import reference, rows_beside
from server.reproduce.study import Progress, Reproduction

INDEX, THUMB = "barry2018_index", "barry2018_thumb"
# 32 N are 62 % of it, where both speak of the same force.
THUMB_PALMAR_N = 32.0 / 0.62
INDEX_DORSAL_N = 1.0
PATTERN = (
    "not available: the activities that the deficits start from (EMG of Qiu and Kamper 2014 and Valero-Cuevas 2003) "
    "are not in the paper; ours starts from the least activity that gives the same force"
)
COMPARED = (
    "not available: the cadavers' forces (Qiu et al. 2017, Towles et al. 2008) and the paper's are in figures alone"
)
MOST = "ours starts from the least activity that gives the force, not from EMG"


def reproduce(progress: Progress) -> Reproduction:
    """Recompute the study."""
    cases = baselines(progress)
    rows = [
        *_model_rows(cases),
        *rows_beside(reference("barry2018")["against_cadavers"], {}, COMPARED),
        *_deficit_rows(cases),
        *_most_rows(cases),
    ]
    sheets = (
        *(alone(cases[i].result) for i in (0, 2)),
        levels(cases),
        *(deficits(case) for case in cases),
        reach(cases),
        arms(cases),
        postures(cases),
        passive(cases),
    )
    progress(1.0)
    results: dict[str, Any] = {"baselines": {c.name: c.result.as_dict() for c in cases}}
    return Reproduction(
        rows=tuple(rows),
        assumptions=tuple(reference("barry2018")["assumptions"]),
        sheets=sheets,
        results=results,
        plots=lambda: _plots(cases),
    )


def baselines(progress: Progress = lambda fraction: None) -> list[Case]:
    """Return palmar and dorsal forces of the index finger, then of the thumb."""
    out: list[Case] = []
    for name, sizes in ((INDEX, (7.7, INDEX_DORSAL_N)), (THUMB, (THUMB_PALMAR_N, 12.7))):
        finger = read_finger(name)
        held = IsometricFinger(finger, read_muscles(name, finger))
        for direction, size in zip(("palmar", "dorsal"), sizes, strict=True):
            out.append(Case(name, direction, size, work_out(held, force_N={direction: size}), held))
            progress(0.2 * len(out))
    return out


def _model_rows(cases: Sequence[Case]) -> list[Row]:
    index, thumb = cases[0].held, cases[2].held
    heads: dict[str, list[str]] = thumb.finger.document.get("heads", {})
    rows = [
        row("index finger: degrees of freedom", "4", len(index.finger.topology.rotations), "1"),
        row(
            "thumb: degrees of freedom", "5", len(thumb.finger.topology.rotations), "1",
            "the thumb's MP abduction axis is not at hand",
        ),
        row("index finger: muscles (Table 1)", "7", len(cases[0].result.alone), "1"),
        row("thumb: muscles (Table 1)", "8", len(cases[2].result.alone), "1"),
        row("heads of FDI", "2", 1, "1", "MyoHand has one head of FDI"),
        row("heads of ADP", "2", len(heads["ADP"]), "1"),
    ]  # fmt: skip
    for name, held in (("index finger", index), ("thumb", thumb)):
        zero = held.place(np.zeros(len(held.finger.topology.rotations)))
        count = len(held.finger.topology.muscles)
        state = held.hold(zero, np.ones((1, count)))
        m = held.muscles.values
        fibre = np.asarray(state.fibre)[0] * m.fibre
        along = np.sqrt(fibre**2 - (m.fibre * np.sin(m.pennation)) ** 2)
        strain = 100.0 * ((np.asarray(zero.length) - along) / m.slack - 1.0)
        rows.append(
            row(
                f"{name}: greatest tendon strain, all muscles fully active at 0 deg (Eq 1)", "3.3", float(strain.max()),
                "%", "the slack lengths were set by Eq 1, so this row tests the equilibrium alone",
            )
        )  # fmt: skip
    return rows


def _deficit_rows(cases: Sequence[Case]) -> list[Row]:
    palmar, dorsal, thumb_palmar, thumb_dorsal = cases

    def turned(case: Case, muscle: str) -> float:
        return case.result.deficit(muscle).change_deg()[-1] or 0.0

    def size(case: Case, muscle: str, level: float) -> float:
        d = case.result.deficit(muscle)
        return float(d.magnitudes[list(d.levels_pct).index(level)])

    full, no_adp = (size(thumb_palmar, "ADP", level) for level in (100.0, 0.0))
    fpl = thumb_palmar.result.deficit("FPL")
    half_fpl = fpl.force_N[list(fpl.levels_pct).index(50.0)]
    distal = angle_between(half_fpl, np.array(DIRECTIONS["distal"])) or 0.0
    given = "not available: given to our baseline"
    return [
        not_available("index dorsal: turn without FDI", "83", turned(dorsal, "FDI"), "deg", PATTERN),
        not_available("index palmar: force at full activation", "7.7", size(palmar, "FDP", 100.0), "N", given),
        not_available("index palmar: force without FDP", "1.9", size(palmar, "FDP", 0.0), "N", PATTERN),
        not_available("index palmar: turn without FDP", "60", turned(palmar, "FDP"), "deg", PATTERN),
        not_available("thumb dorsal: force at full activation", "12.7", size(thumb_dorsal, "EPL", 100.0), "N", given),
        not_available("thumb dorsal: force without EPL", "4.4", size(thumb_dorsal, "EPL", 0.0), "N", PATTERN),
        not_available("thumb dorsal: turn without EPL", "73.1", turned(thumb_dorsal, "EPL"), "deg", PATTERN),
        not_available(
            "thumb palmar: palmar force less with FPL at 50 %", "40.5", full + float(half_fpl[1]), "N", PATTERN
        ),
        Row(
            "thumb palmar: force with FPL at 50 %, away from distal",
            None,
            distal,
            "deg",
            distal < 15.0,
            f"{MOST}; 'almost entirely' is taken as within 15 deg",
            "almost entirely distal",
        ),
        not_available("thumb palmar: less without ADP (negative: more)", "32", full - no_adp, "N", PATTERN),
        not_available("thumb: less without ADP (negative: more)", "62", 100.0 * (1.0 - no_adp / full), "%", PATTERN),
    ]


def _most_rows(cases: Sequence[Case]) -> list[Row]:
    """Return rows on the muscle with the largest influence; a row's number is the effect of losing the named one."""
    palmar, dorsal, thumb_palmar, thumb_dorsal = cases

    def turns(case: Case) -> dict[str, float]:
        return {d.muscle: d.change_deg()[-1] or 0.0 for d in case.result.deficits}

    def changes(case: Case, level: int = -1) -> dict[str, float]:
        return {d.muscle: float(np.linalg.norm(d.force_N[level] - d.force_N[0])) for d in case.result.deficits}

    def most(what: str, muscle: str, values: dict[str, float], unit: str, place: int = 0) -> Row:
        ours = sorted(values, key=lambda m: -values[m])[place]
        note = MOST if ours == muscle else f"{MOST}; there {ours} does more ({values[ours]:.3g})"
        return Row(what, None, values[muscle], unit, ours == muscle, note, muscle)

    return [
        most("index dorsal: turns most when lost", "FDI", turns(dorsal), "deg"),
        most("index palmar: turns most when lost", "FDP", turns(palmar), "deg"),
        most("index palmar: changes the force most when lost", "FDP", changes(palmar), "N"),
        most("thumb dorsal: turns most when lost", "EPL", turns(thumb_dorsal), "deg"),
        most("thumb palmar: changes the force most when lost", "FPL", changes(thumb_palmar), "N"),
        most("thumb palmar: second to change the force when lost", "ADP", changes(thumb_palmar), "N", 1),
    ]


def _plots(cases: Sequence[Case]) -> list[Plot]:
    """Return the tip forces of all muscles of both fingers, then the deficits of every baseline."""
    plots = [
        Plot(
            c.finger.replace("barry2018_", "alone-"),
            f"Tip force of each muscle: {c.finger}",
            alone_figure(c.result),
            "Per newton of tension; the paper's Figs 2 and 3 have the cadaver tests' tensions, not printed there.",
        )
        for c in (cases[0], cases[2])
    ]
    plots += [
        Plot(
            f"deficits-{c.finger.removeprefix('barry2018_')}-{c.direction}",
            f"Deficits: {c.name}",
            deficits_figure(c.result),
        )
        for c in cases
    ]
    return plots
