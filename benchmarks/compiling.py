"""What a first diagnosis compiles: tracing, lowering and compiling each program, and how long it then runs."""

from __future__ import annotations

from itertools import pairwise
from time import perf_counter, process_time
from typing import Any

import jax
import numpy as np

from benchmarks.machine import table
from fingermodel.compiled.programs import Stored
from fingermodel.fitting.identification import _slopes
from fingermodel.model import predict_batch
from fingermodel.session import Session
from tests.stated import stated_problem

TARGET = 8.0
CALLS = 200


def main() -> None:
    """Print the table."""
    bench = Session.open("DEV-08")
    jax.config.update("jax_enable_compilation_cache", False)
    problem = stated_problem(bench.model, bench.observations)
    model, fitted = problem.model, problem.fitted_readings
    structure = model.compact.structure
    none = np.array([effect.always for effect in model.structure.effects])
    few, every = none.copy(), np.ones_like(none)
    few[np.flatnonzero(~none)[[0, -1]]] = True
    rows = []
    for name, program, cases in (
        ("predictions", predict_batch, fitted.every_case),
        ("slopes", _slopes, fitted.differentiated.cases),
    ):
        before = model.given(cases, problem.centre)[0]
        stages, compiled = _stages(program, structure, (*before, none))
        runs = [f"{1e3 * _least(compiled, (*before, active)):.2f}" for active in (none, few, every)]
        rows.append([name, *(f"{wall:.2f} ({own:.2f})" for wall, own in stages), *runs])
    table(
        f"Programs of a first diagnosis of DEV-08 (target: {TARGET:.0f} s for both)",
        ["", "tracing [s]", "lowering [s]", "compiling [s]", "a call [ms]", "with two effects", "with all"],
        rows,
        "Seconds of the wall clock, in brackets of the processor: XLA compiles on all cores. In a diagnosis the first "
        "program is compiled while the second is traced.",
    )


def _stages(program: Stored[Any], structure: Any, arguments: tuple[Any, ...]) -> tuple[list[tuple[float, float]], Any]:
    """Wall and processor time [s] of tracing, lowering and compiling, and what was compiled."""
    marks = [(perf_counter(), process_time())]
    traced = program.jitted.trace(structure, *arguments)
    marks.append((perf_counter(), process_time()))
    lowered = traced.lower()
    marks.append((perf_counter(), process_time()))
    compiled = lowered.compile(compiler_options=program.options)
    marks.append((perf_counter(), process_time()))
    return [(b[0] - a[0], b[1] - a[1]) for a, b in pairwise(marks)], compiled


def _least(compiled: Any, arguments: tuple[Any, ...]) -> float:
    """Shortest time of a call [s]."""
    best = np.inf
    for _ in range(CALLS):
        began = perf_counter()
        jax.block_until_ready(compiled(*arguments))
        best = min(best, perf_counter() - began)
    return float(best)


if __name__ == "__main__":
    main()
