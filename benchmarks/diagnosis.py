"""How long a diagnosis takes, against refitting each candidate by SLSQP with finite differences.

    python -m benchmarks.diagnosis

Of the recorded sessions of 96 load cases, and of simulated ones of 24, 96 and 665, each in a process of its own.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from benchmarks.machine import most_memory_bytes, repeat, table, wait_until_quiet
from fingermodel.compiled.compilation import prepare_jax
from fingermodel.diagnosis.diagnose import diagnose
from fingermodel.diagnosis.session_model.candidates import Candidates, Explanation, Member, free_mask
from fingermodel.fitting.identification import refit_map
from fingermodel.fitting.problems import Problem, objective_at
from fingermodel.session import Session
from tests.simulator import draw_session
from tests.simulator.protocols import Protocol
from tests.stated import stated_problem

Floats = NDArray[np.float64]

SESSIONS = ("DEV-01", "DEV-02", "DEV-04", "DEV-05", "DEV-08", "DEV-11", "DEV-12")
TARGET_S, COLD_S = 1.5, 3.0
SIZES, SIZES_S, SIZES_MB = (24, 96, 665), 15.0, 1000
# Refitted by the rival: a tension effect, a reading effect and a geometry effect; the others take as long.
REFITTED = ("hanger_mass", "zero_offset.bone", "bowstringing")
ITERATIONS = 200


def main() -> None:
    """Time them and print the tables."""
    prepare_jax()
    benches = {name: Session.open(name) for name in SESSIONS}
    fits = {name: diagnose(b.model, b.observations) for name, b in benches.items()}
    wait_until_quiet()
    rows, seconds = [], {}
    for name, bench in benches.items():
        timing = repeat(partial(diagnose, bench.model, bench.observations), 5)
        seconds[name] = timing.median
        found = fits[name]
        rows.append(
            [
                name,
                " + ".join(found.verdict.effects) or found.verdict.kind,
                f"{timing.least:.2f}",
                f"{timing.median:.2f}",
                str(len(found.searched.fits)),
                f"{100 * timing.own_share:.0f} %",
            ]
        )
    cold = [_cold("DEV-08") for _ in range(3)]
    rows.append(["DEV-08, a cold process, warm cache", "", f"{min(cold):.2f}", f"{np.median(cold):.2f}", "", ""])
    table(
        f"Diagnosis of 96 load cases on one core (aim: {TARGET_S:g} s warm, {COLD_S:g} s from a cold process)",
        ["session", "verdict", "best [s]", "median [s]", "explanations fitted", "of the core"],
        rows,
        "Fitted is what the linearised model promises to come near the most probable explanation. The cold process "
        "is `fingertwin diagnose DEV-08`, next load cases and answer included.",
    )
    _sizes()
    _rival(seconds["DEV-08"])


def _sizes() -> None:
    rows = []
    for size in SIZES:
        command = [sys.executable, "-m", "benchmarks.diagnosis", str(size)]
        told = subprocess.run(command, check=True, capture_output=True, text=True)
        rows.append([str(size), *told.stdout.split()])
    table(
        f"Sessions of other sizes, hangers of 40 g hidden (aim: 665 cases in {SIZES_S:g} s and {SIZES_MB} MB)",
        ["load cases", "verdict", "first [s]", "warm [s]", "peak memory [MB]"],
        rows,
        "Of the independent simulator. The first includes compiling what no other session of that size has compiled.",
    )


def one_size(count: int) -> None:
    """Diagnose a session of so many load cases twice, and print what it took."""
    prepare_jax()
    with tempfile.TemporaryDirectory() as folder:
        draw_session(
            Path(folder), 77, {"hanger_mass": 40.0}, nuisance_scale=1.0, done=lambda plan: (sized(plan, count),) * 2
        )
        bench = Session.open(folder)
        seconds = []
        for _ in range(2):
            found = diagnose(bench.model, bench.observations)
            seconds.append(found.seconds)
    names = "+".join(found.verdict.effects) or found.verdict.kind
    print(names, *(f"{s:.1f}" for s in seconds), f"{most_memory_bytes() / 1e6:.0f}")


def sized(plan: Protocol, count: int) -> Protocol:
    """A protocol of so many load cases: some of it, or all again and again under loads a tenth smaller each time."""
    whole = len(plan.cases)
    if count <= whole:
        return replace(plan, cases=plan.cases[:: whole // count][:count])

    def later(span: tuple[float, float], by: float) -> tuple[float, float]:
        return span[0] + by, span[1] + by

    cases = []
    for k in range(-(-count // whole)):
        by = k * plan.end_s
        cases += [
            replace(
                c,
                id=f"{c.id}_{k}",
                masses_g={m: g * (1.0 - 0.1 * k) for m, g in c.masses_g.items()},
                unloaded_s=later(c.unloaded_s, by),
                loaded_s=later(c.loaded_s, by),
                block_start_s=c.block_start_s + by,
                load_start_s=c.load_start_s + by,
            )
            for c in plan.cases
        ]
    cases = cases[:count]
    return replace(plan, cases=tuple(cases), end_s=cases[-1].loaded_s[1] + 0.1)


def _cold(session: str) -> float:
    began = time.perf_counter()
    command = [sys.executable, "-m", "server.cli", "diagnose", session]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return time.perf_counter() - began


def _rival(ours_s: float) -> None:
    bench = Session.open("DEV-08")
    base = stated_problem(bench.model, bench.observations)
    candidates = Candidates.of(bench.model, sagittal=bench.model.finger.judged_in == "sagittal").all
    rows, each = [], []
    for candidate in candidates:
        if candidate.name not in REFITTED:
            continue
        problem = replace(base, free=base.free | free_mask(bench.model, Explanation((Member(candidate),))))
        free = np.flatnonzero(problem.free)
        low = (base.lower - base.centre)[free] / base.scale[free]
        high = (base.upper - base.centre)[free] / base.scale[free]
        ours = refit_map(problem)
        began = time.perf_counter()
        answer = minimize(
            _objective,
            np.zeros(len(free)),
            args=(problem, free),
            method="SLSQP",
            bounds=list(zip(low, high, strict=True)),
            options={"ftol": 1e-8, "maxiter": ITERATIONS},
        )
        each.append(time.perf_counter() - began)
        rows.append(
            [
                candidate.name,
                f"{each[-1]:.1f}",
                f"{ours.seconds:.3f}",
                f"{answer.fun:.1f}",
                f"{ours.objective:.1f}",
                str(answer.nfev),
            ]
        )
    whole = float(np.mean(each)) * len(candidates)
    table(
        f"Refitting a candidate with SLSQP and finite differences (DEV-08, {len(candidates)} candidates)",
        ["candidate", "SLSQP [s]", "ours [s]", "its objective", "our objective", "its evaluations"],
        rows,
        f"SLSQP from SciPy on our compiled model, from the priors' centre, at most {ITERATIONS} iterations. All "
        f"singles alone would take it {whole:.0f} s, {whole / ours_s:.0f} times our whole diagnosis, pairs included.",
    )


def _objective(x: Floats, problem: Problem, free: NDArray[np.intp]) -> float:
    theta = problem.centre.copy()
    theta[free] += problem.scale[free] * x
    return objective_at(problem, theta)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        one_size(int(sys.argv[1]))
    else:
        main()
