"""`fingertwin demo`: the main job on shipped data, in well under a minute."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

from server.console import progress, say, table
from server.drawing import draw_comparison
from server.workflow import Bench, compare_bench, open_bench, refit_bench, save_revision

if TYPE_CHECKING:
    from fingermodel.compare import Comparison

RECORDED = "DEV-08"
PUBLISHED = "synek2019_HMEAN"


def run_demo(out: Path) -> None:
    """Replay a recorded session and the published study as far as the refit, and save the falling error."""
    from daq.checks import check

    began = time.perf_counter()
    say(f"1. A recorded bench session ({RECORDED}): raw load-cell readings of 96 load cases")
    report = check(RECORDED)
    verdict = "usable" if report.ok else "NOT usable"
    say(f"   check: {verdict}, {len(report.errors)} errors, {len(report.warnings)} warnings")
    with progress("Reading and correcting") as tell:
        bench = open_bench(RECORDED, None, tell)
    first = compare_bench(bench)
    say("2. Refit: tendon points, hood fractions and the rig's small errors, all at once")
    after = _refit(bench, out / "recorded", first)
    _errors(f"{RECORDED}: force errors in space [N]", "space", [("normative model", first), ("refitted", after)])

    say(f"3. The published study ({PUBLISHED}, Synek et al. 2019): three cadaver fingers")
    study = open_bench(PUBLISHED)
    initial = compare_bench(study)
    published = compare_bench(open_bench(PUBLISHED, "synek2019_optimised"))
    ours = _refit(study, out / "published", initial)
    _errors(
        "Published fingers: force errors in the sagittal plane [N]",
        "sagittal",
        [("initial model", initial), ("published optimised", published), ("our refit", ours)],
    )
    say("Bone forces are mostly tension: they rest on the friction factor, which no fit to tip forces can better.")
    say(f"Done in {time.perf_counter() - began:.0f} s. Open {out / 'recorded' / 'compare.html'}")
    say(f"                and {out / 'published' / 'compare.html'} in a browser.")


def _refit(bench: Bench, folder: Path, before: Comparison) -> Comparison:
    from fingermodel.compare import compare
    from fingermodel.model_files import free_path

    with progress("Refitting (the first time on a machine, the model is compiled)"):
        fit = refit_bench(bench)
    after = compare(bench.model, bench.observations, fit.theta)
    path = free_path(folder, bench.measured.session.id)
    save_revision(bench, fit, path, before.summary(), after.summary())
    say(f"   {fit.outcome} in {fit.evaluations} evaluations, {fit.seconds:.2f} s; {path}")
    say(f"   {fit.message}")
    draw_comparison(bench, after, folder, before=before, theta=fit.theta, model_name="refitted", static=False)
    return after


def _errors(title: str, plane: str, steps: list[tuple[str, Comparison]]) -> None:
    names = list(steps[0][1].summary())
    rows = []
    for name in names:
        errors = [c.select(*name.split("/")).errors(plane).rmse_N for _, c in steps]
        seen = "fitted" if name.startswith("identification") else "never fitted"
        rows.append([name, seen, *errors, _bar(errors)])
    table(title, ["cases", "", *(label for label, _ in steps), "what is left"], rows)


def _bar(errors: list[float | None]) -> str:
    """The last error as a share of the first, drawn."""
    first, last = errors[0], errors[-1]
    if not first or last is None:
        return ""
    share = last / first
    return "#" * max(1, min(30, round(30 * share))) + f" {100 * share:.0f} %"
