"""`fingertwin demo`: the main job on shipped data, through a running service, as at a bench."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, redirect_stdout
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from daq.checks import check
from daq.errors import InputError
from fingertwin.client import Client
from server.application.diagnosis_report import draw_diagnosis, draw_shared
from server.commands.additions import print_history
from server.commands.console import answer, progress, say, table
from server.commands.log import replay_session
from server.commands.pooling import say_shared

if TYPE_CHECKING:
    from fingertwin.client.findings import Finding, Fit
    from fingertwin.client.jobs import Job
    from fingertwin.client.summaries import Summary

RECORDED = "DEV-08"
# Synek et al. 2019: three human fingers and a bonobo's.
PUBLISHED = ("synek2019_B01", "synek2019_H01", "synek2019_H02", "synek2019_H03")
# Both models are compiled at once on a machine's first run, each by a worker of its own.
WORKERS = 2
_STOP_S = 20.0


def run_demo(out: Path, json_file: str | None) -> None:
    """Show the main job; where its answer goes to standard output, the story is left out."""
    with redirect_stdout(io.StringIO()) if json_file == "-" else nullcontext():
        body = _demo(out)
    answer("demo", body, json_file)


def _demo(out: Path) -> dict[str, Any]:
    """Stream a session with a hidden effect into the service, find and add it; then show what published ones share.

    Returns:
        Answer of every step, each as its own command or request gives it.
    """
    began = time.perf_counter()
    with TemporaryDirectory(prefix="fingertwin-demo-") as folder, service(Path(folder)) as url, Client(url) as twin:
        say(
            f"1. A recorded bench session ({RECORDED}): raw load-cell readings of 96 load cases, and something is wrong"
        )
        report = check(RECORDED)
        verdict = "usable" if report.ok else "NOT usable"
        say(f"   check: {verdict}, {len(report.errors)} errors, {len(report.warnings)} warnings")
        say(f"   replayed through the DAQ into the model service at {url}:")
        replay_session(RECORDED, url, None, "max", None, None)
        for name in PUBLISHED:
            twin.upload(name)
        refit = twin.session(RECORDED).refit(model=None)
        together = twin.diagnose(PUBLISHED, model=None)
        steps = _story(twin, RECORDED, refit, out / "recorded")
        say("")
        say("2. Four published specimens (Synek et al. 2019): averaged forces of cadaver fingers, all loaded alike")
        shared = _together(together, out / "published")
    seconds = time.perf_counter() - began
    pages = out / "recorded" / "diagnose.html", out / "published" / "shared.html"
    say(f"Done in {seconds:.0f} s. Open {pages[0]}")
    say(f"                and {pages[1]} in a browser.")
    recorded = {"check": report.as_dict()} | steps
    return {"recorded": recorded, "published": shared, "pages": [str(p) for p in pages], "seconds": seconds}


@contextmanager
def service(folder: Path) -> Iterator[str]:
    """Run a service on a free port of this machine, with its data in a folder; yield its address.

    Raises:
        InputError: it does not start.
    """
    program = "from server.cli import main; main()"
    arguments = ["serve", "--port", "0", "--data", str(folder / "service"), "--json", "-"]
    environment = os.environ | {"FINGERTWIN_WORKERS": str(WORKERS), "FINGERTWIN_LOG_LEVEL": "warning"}
    # Its two jobs are asked for at once: each worker compiles for one of them.
    environment["FINGERTWIN_WARM_WORKERS"] = "false"
    log = folder / "service.log"
    with log.open("wb") as errors:
        process = subprocess.Popen(  # noqa: S603 - this very program
            [sys.executable, "-c", program, *arguments], stdout=subprocess.PIPE, stderr=errors, env=environment
        )
        try:
            yield _address(process, log)
        finally:
            process.terminate()
            try:
                process.wait(_STOP_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
            if process.stdout is not None:
                process.stdout.close()


def _address(process: subprocess.Popen[bytes], log: Path) -> str:
    """Read the address that a service prints once it answers: an object of JSON, over several lines."""
    assert process.stdout is not None  # noqa: S101 - it was asked for
    text = b""
    for line in process.stdout:
        text += line
        if line.rstrip() == b"}":
            return str(json.loads(text)["url"])
    said = log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
    raise InputError(f"the service has not started ({said[-1] if said else 'it said nothing'})", "a service that runs")


def _story(twin: Client, name: str, refit: Job[Fit], folder: Path) -> dict[str, Any]:
    """Compare, refit, diagnose, add what was found (or what is likeliest), and show the error fall."""
    session = twin.session(name)
    first = session.compare(model=None)
    diagnosing = session.diagnose(model=None)
    with progress("Refitting (the first time on a machine, the model is compiled)") as tell:
        fit = refit.result(lambda done, _: tell(done))
    say("   Refit: tendon points, hood fractions and the rig's small errors, all at once")
    say(f"   {fit.body['outcome']} in {fit.body['evaluations']} evaluations, {fit.body['seconds']:.2f} s")
    with progress("Diagnosing") as tell:
        finding = diagnosing.result(lambda done, _: tell(done))
    say(f"   {finding.sentence}")
    for reason in finding.reasons[:2]:
        say(f"   {reason}")
    names = _to_add(finding)
    with progress("Adding and refitting") as tell:
        revision = session.add(*names, model=fit.body["model"]).result(lambda done, _: tell(done))
    plane = finding.judged_in
    _errors(
        f"{name}: RMSE of the forces [N], {'in the sagittal plane' if plane == 'sagittal' else 'in space'}",
        plane,
        [
            ("normative model", first.summary),
            ("refitted", revision.before),
            (f"with {' + '.join(names)}", revision.after),
        ],
    )
    history: list[dict[str, Any]] = revision.body["history"]
    print_history(history)
    draw_diagnosis(finding.body, folder, history, static=False)
    return {"compare": first.body, "refit": fit.body, "diagnose": finding.body, "revision": revision.body}


def _together(job: Job[dict[str, Any]], folder: Path) -> dict[str, Any]:
    """Say what the specimens share that no effect describes, and what it is worth on the one left out."""
    with progress("Diagnosing four specimens, and what they share") as tell:
        body = job.result(lambda done, _: tell(done))
    for name, own in body["each"].items():
        say(f"   {name}: {own['sentence']}")
    say_shared(body["shared"])
    laws = body["shared"]["laws"]
    if laws:
        rows = [
            [name, laws[0]["left_out_gain"][name], *(e for p in ("tip", "bone") for e in errors[p].values())]
            for name, errors in laws[0]["unseen_rmse_N"].items()
        ]
        header = ["left out", "gain [nat]", "unseen tip before", "after", "unseen bone before", "after"]
        table(f"{laws[0]['formula']}, learned from the other three: RMSE [N]", header, rows)
        rises = [n for n, e in laws[0]["unseen_rmse_N"].items() if e["bone"]["after"] > e["bone"]["before"]]
        if rises:
            say(f"   It does not mend the bone loads: their error rises in {', '.join(rises)}.")
        if rises and laws[0]["formula"].startswith("torque"):
            say(
                "   Why: a torque at a joint reaches the metacarpal only through the tip force. It shifts the bone "
                "load by what the tip force changes, whatever that load lacks: another cause, which is not found."
            )
    draw_shared(body, folder, static=False)
    return body


def _to_add(finding: Finding) -> list[str]:
    """Return the effects that the verdict names, or else the likeliest single one, to show its fall of the error."""
    if finding.verdict == "found":
        return list(finding.body["ranking"][0]["candidates"])
    singles = [r for r in finding.body["ranking"] if len(r["candidates"]) == 1]
    best = max(singles, key=lambda r: r["log_evidence_gain"] or float("-inf"))
    name = str(best["candidates"][0])
    say(f"   No effect stands; the likeliest single one, {name}, is added to see how far it goes.")
    return [name]


def _errors(title: str, plane: str, steps: list[tuple[str, Summary]]) -> None:
    rows: list[list[Any]] = []
    for name in steps[0][1]:
        errors = [getattr(summary[name], plane).rmse_N for _, summary in steps]
        seen = "fitted" if name.startswith("identification") else "never fitted"
        rows.append([name, seen, *errors, _bar(errors)])
    table(title, ["cases", "", *(label for label, _ in steps), "what is left"], rows)


def _bar(errors: list[float | None]) -> str:
    """Return the last error as a share of the first, drawn."""
    first, last = errors[0], errors[-1]
    if not first or last is None:
        return ""
    share = last / first
    return "#" * max(1, min(30, round(30 * share))) + f" {100 * share:.0f} %"
