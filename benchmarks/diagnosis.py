"""How long a diagnosis of 96 load cases takes, against refitting each candidate by SLSQP with finite differences."""

from __future__ import annotations

import subprocess
import sys
import time
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from benchmarks.machine import repeat, table, wait_until_quiet
from fingermodel.diagnosis.diagnose import diagnose
from fingermodel.diagnosis.session_model.candidates import Candidates, Explanation, Member, free_mask
from fingermodel.problems import Problem, map_problem, objective_at
from fingermodel.refit import refit_map
from server.workflow import open_bench, prepare_jax

Floats = NDArray[np.float64]

SESSIONS = ("DEV-01", "DEV-02", "DEV-04", "DEV-05", "DEV-08", "DEV-11", "DEV-12")
TARGET_S, LIMIT_S, COLD_S = 1.0, 3.0, 6.0
# Refitted by the rival: a tension effect, a reading effect and a geometry effect; the others take as long.
REFITTED = ("hanger_mass", "zero_offset.bone", "bowstringing")
ITERATIONS = 200


def main() -> None:
    """Time them and print the tables."""
    prepare_jax()
    benches = {name: open_bench(name, catalogue=True) for name in SESSIONS}
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
        "Diagnosis of 96 load cases on one core "
        f"(target about {TARGET_S:g} s warm, at most {LIMIT_S:g} s; {COLD_S:g} s from a cold process)",
        ["session", "verdict", "best [s]", "median [s]", "explanations fitted", "of the core"],
        rows,
        "Fitted is what the linearised model promises to come near the most probable explanation. The cold process "
        "is `fingertwin diagnose DEV-08`, next load cases and answer included.",
    )
    _rival(seconds["DEV-08"])


def _cold(session: str) -> float:
    began = time.perf_counter()
    command = [sys.executable, "-m", "server.cli", "diagnose", session]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return time.perf_counter() - began


def _rival(ours_s: float) -> None:
    bench = open_bench("DEV-08", catalogue=True)
    base = map_problem(bench.model, bench.observations)
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
    main()
