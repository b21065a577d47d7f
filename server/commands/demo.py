"""`fingertwin demo`: the main job on shipped data, in a dozen seconds once the models are compiled."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING

from server.commands.additions import add_bench, print_history
from server.commands.diagnosis import diagnosis_body, run_diagnosis
from server.console import progress, say, table
from server.diagnosis_report import draw_diagnosis
from server.workflow import Bench, compare_bench, open_bench, refit_bench, save_revision

if TYPE_CHECKING:
    from fingermodel.compare import Comparison
    from fingermodel.diagnosis.diagnose import Diagnosis

RECORDED = "DEV-08"
PUBLISHED = "synek2019_H01"


def run_demo(out: Path) -> None:
    """Replay a recorded session with a hidden effect and a published specimen: find what is missing, add it."""
    from daq.checks import check

    began = time.perf_counter()
    say(f"1. A recorded bench session ({RECORDED}): raw load-cell readings of 96 load cases, and something is wrong")
    report = check(RECORDED)
    verdict = "usable" if report.ok else "NOT usable"
    say(f"   check: {verdict}, {len(report.errors)} errors, {len(report.warnings)} warnings")
    with progress("Reading and correcting") as tell:
        bench = open_bench(RECORDED, None, tell, catalogue=True)
    study = open_bench(PUBLISHED, catalogue=True)
    # On a machine's first run both models are compiled, each on a core of its own.
    warming = threading.Thread(target=_compile, args=(study,), daemon=True)
    warming.start()
    _story(bench, RECORDED, out / "recorded")

    say("")
    say(f"2. A published specimen ({PUBLISHED}, Synek et al. 2019): averaged forces of a cadaver finger")
    warming.join()
    _story(study, PUBLISHED, out / "published")
    say(f"Done in {time.perf_counter() - began:.0f} s. Open {out / 'recorded' / 'diagnose.html'}")
    say(f"                and {out / 'published' / 'diagnose.html'} in a browser.")


def _story(bench: Bench, session: str, folder: Path) -> None:
    """Refit, diagnose, add what was found (or what is likeliest), and show the error fall."""
    from fingermodel.model_files import Step, free_path

    plane = bench.model.finger.judged_in
    first = compare_bench(bench)
    say("   Refit: tendon points, hood fractions and the rig's small errors, all at once")
    fitted, path = _refit(bench, folder, first)
    with progress("Diagnosing") as tell:
        diagnosis = run_diagnosis(bench, False, tell)
    body = diagnosis_body(bench, diagnosis)
    say(f"   {body['sentence']}")
    for reason in body["reasons"][:2]:
        say(f"   {reason}")
    names = _to_add(diagnosis)
    bench = open_bench(session, str(path), catalogue=True)
    with progress("Adding and refitting"):
        before, addition, after = add_bench(bench, names, [])
    step = Step(added=addition.names, evidence={"log_evidence_gain": addition.log_evidence_gain})
    added = free_path(folder, bench.measured.session.id)
    document = save_revision(bench, addition.fit, added, before.summary(), after.summary(), step)
    label = " + ".join(names)
    _errors(
        f"{session}: RMSE of the forces [N], {'in the sagittal plane' if plane == 'sagittal' else 'in space'}",
        plane,
        [("normative model", first), ("refitted", fitted), (f"with {label}", after)],
    )
    print_history(document["history"])
    draw_diagnosis(body, folder, document["history"], static=False)


def _to_add(diagnosis: Diagnosis) -> list[str]:
    """What the verdict names, or else the single effect that is likeliest: to see how far it goes."""
    if diagnosis.verdict.kind == "found":
        return list(diagnosis.best.explanation.names)
    singles = [w for w in diagnosis.evidence.weighed if w.explanation.size == 1]
    best = max(singles, key=lambda w: w.log_evidence)
    say(f"   No effect stands; the likeliest single one, {best.explanation.names[0]}, is added to see how far it goes.")
    return list(best.explanation.names)


def _compile(bench: Bench) -> None:
    from fingermodel.problems import map_problem
    from fingermodel.refit import solve

    problem = map_problem(bench.model, bench.observations)
    solve(problem, problem.start, evaluations=1)
    compare_bench(bench)


def _refit(bench: Bench, folder: Path, before: Comparison) -> tuple[Comparison, Path]:
    from fingermodel.compare import compare
    from fingermodel.model_files import free_path

    with progress("Refitting (the first time on a machine, the model is compiled)"):
        fit = refit_bench(bench)
    after = compare(bench.model, bench.observations, fit.theta)
    path = free_path(folder, bench.measured.session.id)
    save_revision(bench, fit, path, before.summary(), after.summary())
    say(f"   {fit.outcome} in {fit.evaluations} evaluations, {fit.seconds:.2f} s; misfit {fit.objective:.0f}")
    return after, path


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
