"""The elastic hood against Winslow's rhombus on the published specimens: both refitted, both tried on unseen loads."""

from __future__ import annotations

from typing import Any

from fingermodel import api, comparing
from fingermodel.session import Session
from server.reproduce.study import Progress, Sheet

SPECIMENS = ("HMEAN", "H01", "H02", "H03")
FINGERS = {"synek2019_initial": "Winslow's rhombus", "synek2019_network": "elastic network"}
"""The same tendon points, axes and insertions: the hoods differ in nothing else."""


def against_rhombus(progress: Progress) -> tuple[Sheet, dict[str, Any]]:
    """Refit both fingers to each specimen's single-tendon loads; errors in the sagittal plane, before and after."""
    lines: list[tuple[str | float | None, ...]] = []
    results: dict[str, Any] = {}
    for i, specimen in enumerate(SPECIMENS):
        for k, (finger, title) in enumerate(FINGERS.items()):
            bench = Session.open(f"synek2019_{specimen}", finger)
            fit = api.refit(bench)
            compared = {
                "before": comparing.compare(bench),
                "after": comparing.compare(bench.at(fit)),
            }
            errors = {
                when: {
                    key: one.select(*key.split("/")).errors("sagittal")
                    for key in ("identification/tip", "validation/tip", "validation/bone")
                }
                for when, one in compared.items()
            }
            after = errors["after"]
            tip, bone = after["validation/tip"], after["validation/bone"]
            shares = {p.name: (p.value, p.sd) for p in fit.parameters if p.name.startswith("fraction.")}
            lines.append(
                (
                    specimen,
                    title,
                    errors["before"]["identification/tip"].rmse_N,
                    after["identification/tip"].rmse_N,
                    tip.rmse_N,
                    tip.direction_error_deg,
                    tip.magnitude_error_pct,
                    bone.rmse_N,
                    fit.objective,
                )
            )
            results.setdefault(specimen, {})[finger] = {
                "rmse_N": {when: {key: e.rmse_N for key, e in those.items()} for when, those in errors.items()},
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
        tuple(lines),
        (
            "Both are refitted to the 24 single-tendon loads (MAP); unseen: the 16 combined loads. Points, axes and "
            "insertions are the same, and the rhombus has four fractions where the network has two stiffnesses.",
            "The network is the index finger's, laid out on the third digit's bones.",
        ),
    ), results
