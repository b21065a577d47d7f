"""`fingertwin diagnose` of several sessions: each by itself, and all together."""

from __future__ import annotations

from math import sqrt
from pathlib import Path
from typing import Any

from daq.errors import InputError
from daq.files import require_writable
from daq.quoting import quoted
from daq.sessions import require_once
from fingermodel.diagnosis.settings import PERMUTATIONS
from fingermodel.diagnosis.several_sessions.several import Pooled, diagnose_pooled
from fingermodel.parameters import with_unit
from fingermodel.session import Session
from server.application.diagnosing import diagnosis_answer, frozen_documents
from server.application.diagnosis_report import draw_diagnosis, draw_shared
from server.application.pooling import pooled_body, write_law
from server.commands.console import answer, progress, say, table
from server.commands.diagnosis import suspects_of
from server.commands.twin import say_first
from server.figures.shared_law import NO_LAW

# More shuffles say nothing more.
MOST_PERMUTATIONS = 9999


def diagnose_sessions(
    sessions: list[str],
    model: str | None,
    thorough: bool,
    effects: list[str],
    figures: Path | None,
    json: str | None,
    permutations: int | None,
    law: Path | None,
) -> None:
    """Diagnose several sessions and what they share; write the best law that they share, where that is asked for."""
    require_once(sessions)
    permutations = PERMUTATIONS if permutations is None else permutations
    if not 0 <= permutations <= MOST_PERMUTATIONS:
        raise InputError(
            f"--permutations {permutations}", f"0 to {MOST_PERMUTATIONS}", "199 show one chance in a hundred"
        )
    if law is not None and law.exists():
        raise InputError(f"{law} is there already", "a new file", "Choose another name")
    if law is not None:
        require_writable(law)
    benches = []
    for name in sessions:
        with progress(f"Reading {name}") as tell:
            benches.append(Session.open(name, model, progress=tell, effects=effects))
    predictions = [frozen_documents(bench, None) for bench in benches]
    with progress("Fitting every effect to every session") as tell:
        pooled = diagnose_pooled(
            benches,
            thorough=thorough,
            permutations=permutations,
            progress=tell,
        )
    each = {
        bench.measured.session.id: diagnosis_answer(bench, d, documents)
        for bench, d, documents in zip(benches, pooled.diagnoses, predictions, strict=True)
    }
    body = pooled_body(pooled) | {"each": each}
    if figures:
        body["figures"] = [str(draw_shared(body, figures))]
        body["figures"] += [str(draw_diagnosis(own, figures / name)) for name, own in each.items()]
    if law is not None:
        body["law"] = write_law(law, body["shared"])
    if answer("diagnose", body, json):
        return
    _print(pooled, body)
    if law is not None and body["law"] is None:
        say("No law is written: none helps specimens that it was not learned from.")
    elif law is not None:
        file = quoted(law)
        say(f"Law: {law}   (fingertwin add {file} SESSION, or fingertwin diagnose SESSION --effect {file})")
    for page in body.get("figures", []):
        say(f"Report: {page}")


def _print(pooled: Pooled, body: dict[str, Any]) -> None:
    """Print what the sessions say together, and each by itself."""
    say_first(body)
    say(pooled.verdict.sentence)
    if pooled.verdict.short:
        say(f"  Short of more: {'; '.join(pooled.verdict.short)}.")
    if pooled.verdict.rests_on:
        say(f"  Without {' or '.join(pooled.verdict.rests_on)} it would not be found.")
    rows = [
        [
            " + ".join(e.names),
            e.probability,
            e.log_evidence_shared,
            e.log_evidence_own,
            ", ".join(
                with_unit(f"{v:.3g} ± {s:.2g}", p.unit)
                for v, s, p in zip(e.value[:3], e.sd[:3], e.parameters[:3], strict=True)
            ),
            " ".join(f"{each.gain:+.1f}" for each in e.each),
        ]
        for e in pooled.ranking[:8]
    ]
    if pooled.p_apart is not None:
        table(
            f"Shared by {', '.join(pooled.sessions)}",
            ["effect", "probability", "ln evidence, one size", "own sizes", "value of all", "by session"],
            rows,
            f"nothing shared {pooled.p_apart:.3f}; of that, nothing missing in any {pooled.p_nothing:.3f}, something "
            f"else in each {pooled.p_other:.3f}",
        )
        say_shared(body["shared"])
    for name, own in body["each"].items():
        say(f"{name}: {own['sentence']}")
        say_first(own)
        if suspects := suspects_of(own):
            say(f"    {suspects}")
        for reason in own["reasons"]:
            say(f"    {reason}")


def say_shared(shared: dict[str, Any] | None) -> None:
    """Print what the sessions share beyond the catalogue."""
    if shared is None:
        say(f"Beyond the catalogue: {NO_LAW}")
        return
    say(shared["sentence"])
    if shared["lacking"]:
        say(f"  It does not help {', '.join(shared['lacking'])}.")
    rows = []
    for found in shared["laws"]:
        tip, bone = (_unseen(found, place) for place in ("tip", "bone"))
        gains = " ".join(f"{g:+.1f}" for g in found["left_out_gain"].values())
        rivals = f"{len(found['rivals'])} more" if found["rivals"] else ""
        rows.append(
            [found["formula"], f"{found['value']:.3g} ± {found['sd']:.2g} {found['unit']}", gains, tip, bone, rivals]
        )
    if rows:
        table(
            "Laws that it resembles, each learned from the other specimens",
            ["law", "value of all", "gain where left out", "unseen tip", "unseen bone", "alike"],
            rows,
            "gain: ln density of the session left out with its specimen; unseen: RMSE [N] of its validation forces, "
            "before → after; alike: laws that these load cases cannot part from it",
        )

    if shared["would_decide"]["readings"]:
        say(f"Would decide between them, on a specimen like {shared['would_decide']['on']}:")
        for reading in shared["would_decide"]["readings"]:
            say(f"    {reading['text']}")


def _unseen(law: dict[str, Any], place: str) -> str:
    """Return RMS over the sessions, before and after, and in how many it falls."""
    errors = [e[place] for e in law["unseen_rmse_N"].values() if place in e]
    if not errors:
        return ""
    before, after = (sqrt(sum(e[key] ** 2 for e in errors) / len(errors)) for key in ("before", "after"))
    return f"{before:.3f} → {after:.3f}, falls in {sum(e['after'] < e['before'] for e in errors)} of {len(errors)}"
