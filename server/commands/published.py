"""`fingertwin reproduce`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from daq.errors import InputError
from server.console import answer, progress, say, table

if TYPE_CHECKING:
    from server.reproduce.synek2019 import SpecimenFit

STUDIES = ("synek2019",)
NAMES = {
    "published_model": "published optimised model",
    "published_method": "published method, this specimen",
    "ours": "our fit (map)",
    "superposition": "superposition limit",
}


def reproduce_study(study: str, figures: Path | None, json: str | None) -> None:
    """Recompute a published study and set it beside ours."""
    if study not in STUDIES:
        raise InputError(f"no study {study!r}", f"one of {', '.join(STUDIES)}")
    from server.reproduce.synek2019 import reproduce

    with progress("Reproducing") as tell:
        rows, fits = reproduce(tell)
    body = {"study": study, "rows": [r.as_dict() for r in rows], "fits": [f.as_dict() for f in fits]}
    if figures is not None:
        from server.drawing import draw_comparison
        from server.workflow import compare_bench, open_bench

        bench = open_bench("synek2019_HMEAN", "synek2019_optimised")
        before = compare_bench(open_bench("synek2019_HMEAN"))
        body["figures"] = str(draw_comparison(bench, compare_bench(bench), figures, before=before))
    if answer("reproduce", body, json):
        return
    words = {True: "agrees", False: "DIFFERS", None: ""}
    table(
        "Synek et al. 2019, PeerJ 7:e7470",
        ["quantity", "published", "ours", "unit", ""],
        [
            [
                r.quantity,
                r.printed,
                "–" if r.ours is None else f"{r.ours:.4g}",
                r.unit,
                words[r.agrees] or r.note.partition(":")[0],
            ]
            for r in rows
        ],
    )
    checked = [r for r in rows if r.agrees is not None]
    for note in dict.fromkeys(r.note for r in rows if r.note):
        say(f"{note[:1].upper()}{note[1:]}.")
    say(f"{sum(bool(r.agrees) for r in checked)} of {len(checked)} figures that can be recomputed agree.")
    say()
    print_fits(fits)
    if "figures" in body:
        say(f"Figures: {body['figures']}")


def print_fits(fits: list[SpecimenFit]) -> None:
    """Print errors on the unseen combined loads, predictor by predictor."""
    lines = []
    for fit in fits:
        for key, comparison in fit.comparisons.items():
            known = comparison.select("identification", "tip").errors("sagittal").rmse_N
            tip = comparison.select("validation", "tip").errors("sagittal")
            bone = comparison.select("validation", "bone").errors("sagittal")
            lines.append(
                [
                    fit.specimen,
                    NAMES[key],
                    known,
                    tip.rmse_N,
                    tip.direction_error_deg,
                    tip.magnitude_error_pct,
                    bone.direction_error_deg,
                    bone.magnitude_error_pct,
                ]
            )
    table(
        "Unseen combined loads, sagittal plane: fitted to single tendons alone",
        ["specimen", "predictor", "fitted RMSE [N]", "tip RMSE [N]", "tip [deg]", "tip [%]", "bone [deg]", "bone [%]"],
        lines,
        "superposition: measured single-tendon forces added up; no linear model fitted to them can promise better",
    )
    say(
        "Our fit holds where the tip RMSE is at most the published model's, its direction and magnitude at most "
        "the larger of that model's and the superposition limit's, and the bone within 1 deg and 1.5 points of "
        "the published model."
    )
    for fit in fits:
        held = fit.held_to()
        short = [name for name, ok in held.items() if not ok]
        say(
            f"{fit.specimen}: "
            + ("our fit holds on the unseen loads" if not short else f"short of: {', '.join(short)}")
        )
