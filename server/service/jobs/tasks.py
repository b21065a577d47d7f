"""Computations of workers for one session: the answers of the command line, with a revision where one arises.

Each function takes a payload and `Tell`, and returns plain data: `{"body": …}`, with `revision` or `frozen` beside it
as the document that the command line would have written to a file.
"""

from __future__ import annotations

from typing import Any

from daq.plain_json import clean
from fingermodel import api
from fingermodel.comparing import compare
from fingermodel.diagnosis.diagnose import Diagnosis
from fingermodel.diagnosis.next_cases.next_cases import plan_next
from fingermodel.diagnosis.several_sessions.several import diagnose_pooled
from fingermodel.revisions import describe_revision
from fingermodel.session import Session
from server.application.additions import add_bench, addition_body, addition_step, refitted_alone, resolved_effects
from server.application.diagnosing import bare_verdict, diagnosis_answer, run_diagnosis
from server.application.planning import frozen_plan, plan_body
from server.application.pooling import pooled_body
from server.application.provenance import provenance
from server.application.refitting import fit_body, refit_compared
from server.reproduce.study import reproduce as compute
from server.reproduce.study import study_of
from server.service.jobs.bench_input import BenchInput
from server.service.jobs.inputs import AddInput, DiagnoseInput, NextInput, PooledInput, RefitInput, ReproduceInput
from server.service.jobs.worker import Tell

Answer = dict[str, Any]

# Averaged forces, so nothing but the model takes time.
_WARM_SESSION = "synek2019_H01"


def refit(payload: RefitInput, tell: Tell) -> Answer:
    """Refit the model, and return `body` and `revision`."""
    tell(0.0, "loading")
    bench = payload.bench.open(catalogue=True)
    tell(0.1, "refitting")
    before, fit, after = refit_compared(
        bench, payload.method, payload.plane, lambda done: tell(0.1 + 0.85 * done, "refitting")
    )
    revision = describe_revision(bench, fit, before.summary(), after.summary(), payload.bench.readings_sha256)
    body = provenance(bench) | fit_body(bench, fit, before, after) | {"model": revision["id"]}
    return _answer("refit", body, payload.bench, revision=revision)


def add(payload: AddInput, tell: Tell) -> Answer:
    """Add effects and take others out, refit, and return `body` and `revision`."""
    tell(0.0, "loading")
    names, own = resolved_effects(payload.effects, files=False)
    bench = payload.bench.open(catalogue=True, effects=own)
    tell(0.1, "refitting")
    before, addition, after = add_bench(
        bench, names, payload.without, lambda done: tell(0.1 + 0.85 * done, "refitting")
    )
    alone = refitted_alone(bench, addition)
    revision = describe_revision(
        bench,
        addition.fit,
        before.summary(),
        after.summary(),
        payload.bench.readings_sha256,
        addition_step(addition, payload.without, alone),
    )
    body = addition_body(bench, addition, before, alone, after, payload.without)
    body |= {"history": revision["history"], "model": revision["id"]}
    return _answer("add", body, payload.bench, revision=revision)


def diagnose(payload: DiagnoseInput, tell: Tell) -> Answer:
    """Say where the model fails and what is missing, and return `body`."""
    bench, diagnosis = _diagnosed(payload.bench, payload.thorough, tell)
    body = diagnosis_answer(bench, diagnosis, payload.frozen)
    if bench.measured.session.has_amended_entries:
        entered = payload.bench.open(catalogue=True, as_entered=True)
        body["without_amendments"] = bare_verdict(run_diagnosis(entered, payload.thorough))
    return _answer("diagnose", body, payload.bench)


def pooled(payload: PooledInput, tell: Tell) -> Answer:
    """Diagnose sessions by themselves and together, and return `body`."""
    tell(0.0, "loading")
    benches = [given.open(catalogue=True) for given in payload.benches]
    found = diagnose_pooled(
        benches,
        thorough=payload.thorough,
        progress=lambda done: tell(0.05 + 0.9 * done, "fitting every effect to every session"),
    )
    pairs = zip(benches, found.diagnoses, strict=True)
    each = {bench.measured.session.id: diagnosis_answer(bench, one) for bench, one in pairs}
    return _answer("diagnose", pooled_body(found) | {"each": each}, *payload.benches)


def next_cases(payload: NextInput, tell: Tell) -> Answer:
    """Rank what could be measured next, and return `body` and `frozen`, None where that was not asked for."""
    bench, diagnosis = _diagnosed(payload.bench, False, tell)
    plan = plan_next(diagnosis)
    frozen = frozen_plan(bench, plan, payload.bench.readings_sha256) if payload.freeze else None
    body = plan_body(bench, diagnosis, plan) | {"frozen": frozen["sha256"] if frozen else None}
    return _answer("next", body, payload.bench, frozen=frozen)


def reproduce(payload: ReproduceInput, tell: Tell) -> Answer:
    """Compute a published study again, and return `body`, its figures among it."""
    from importlib.metadata import version

    import orjson

    study = study_of(payload.study)
    tell(0.0, "computing")
    done = compute(study.name, lambda share: tell(0.9 * share, "computing"))
    tell(0.9, "drawing")
    figures = [
        {"name": p.name, "heading": p.heading, "caption": p.caption, "figure": orjson.loads(p.figure.to_json())}
        for p in (done.plots() if done.plots is not None else ())
    ]
    body = {"study": study.name, "citation": study.citation, "about": study.about} | done.as_dict()
    body |= {"figures": figures, "version": version("fingertwin")}
    return {"body": clean({"schema": "fingertwin/reproduce/1"} | body)}


def warm() -> None:
    """Load the array compiler and the compiled models, so that a worker's first job finds them there."""
    bench = Session.open(_WARM_SESSION)
    compare(bench)
    api.refit(bench, starts=1)


def _diagnosed(given: BenchInput, thorough: bool, tell: Tell) -> tuple[Session, Diagnosis]:
    tell(0.0, "loading")
    bench = given.open(catalogue=True)
    diagnosis = run_diagnosis(bench, thorough, lambda done: tell(0.05 + 0.9 * done, "fitting every effect"))
    tell(0.95, "weighing load cases")
    return bench, diagnosis


def _answer(command: str, body: Answer, *benches: BenchInput, **documents: Answer | None) -> Answer:
    origins = [dict(b.provenance) for b in benches]
    origin = origins[0] if len(origins) == 1 else {"sessions": origins}
    return {"body": clean({"schema": f"fingertwin/{command}/1"} | body), "provenance": origin} | documents
