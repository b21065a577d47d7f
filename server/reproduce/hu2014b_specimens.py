"""The elastic hood against Winslow's rhombus on the published specimens: both refitted, both tried on unseen loads."""

from __future__ import annotations

from typing import Any

from fingermodel import api, comparing
from fingermodel.comparison.comparison import Comparison, ErrorSummary
from fingermodel.session import Session
from server.reproduce.study import Line, Progress, Sheet

SPECIMENS = ("HMEAN", "H01", "H02", "H03")
FINGERS = {"synek2019_initial": "Winslow's rhombus", "synek2019_network": "elastic network"}
"""The same tendon points, axes and insertions: the hoods differ in nothing else."""


def _errors(comparison: Comparison) -> dict[str, ErrorSummary]:
    places = ("identification/tip", "validation/tip", "validation/bone")
    return {place: comparison.select(*place.split("/")).errors("sagittal") for place in places}


def against_rhombus(progress: Progress) -> tuple[Sheet, dict[str, Any]]:
    """Refit both fingers to each specimen's single-tendon loads; errors in the sagittal plane, before and after."""
    lines: list[Line] = []
    results: dict[str, Any] = {}
    for i, specimen in enumerate(SPECIMENS):
        for k, (finger, title) in enumerate(FINGERS.items()):
            bench = Session.open(f"synek2019_{specimen}", finger)
            fit = api.refit(bench)
            before, after = (_errors(comparing.compare(b)) for b in (bench, bench.at(fit)))
            tip, bone = after["validation/tip"], after["validation/bone"]
            shares = {p.name: (p.value, p.sd) for p in fit.parameters if p.name.startswith("fraction.")}
            lines.append(
                (
                    specimen,
                    title,
                    before["identification/tip"].rmse_N,
                    after["identification/tip"].rmse_N,
                    tip.rmse_N,
                    tip.direction_error_deg,
                    tip.magnitude_error_pct,
                    bone.rmse_N,
                    fit.objective,
                )
            )
            results.setdefault(specimen, {})[finger] = {
                "rmse_N": {
                    when: {key: e.rmse_N for key, e in errors.items()}
                    for when, errors in (("before", before), ("after", after))
                },
                "objective": fit.objective,
                "seconds": fit.seconds,
                "fractions": shares,
            }
            progress((2 * i + k + 1) / (2 * len(SPECIMENS)))
    return Sheet(
        "Elastic network and Winslow's rhombus on the published specimens, sagittal plane",
        (
            "specimen",
            "hood",
            "unfitted [N]",
            "fitted tip [N]",
            "unseen tip [N]",
            "unseen tip [deg]",
            "unseen tip [%]",
            "unseen bone [N]",
            "objective",
        ),
        lines,
        (
            "Both are refitted to the 24 single-tendon loads (MAP); unseen: the 16 combined loads. Points, axes and "
            "insertions are the same, and the rhombus has four fractions where the network has two stiffnesses.",
            "The network is the index finger's, laid out on the third digit's bones.",
        ),
    ), results
