"""`fingertwin diagnose` of several sessions: each by itself, and all together."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from daq.errors import InputError
from fingermodel.parameters import with_unit
from server.commands.diagnosis import diagnosis_body
from server.commands.twin import say_first
from server.console import answer, progress, say, table
from server.workflow import open_bench

if TYPE_CHECKING:
    from fingermodel.diagnosis.several import Pooled
    from fingermodel.diagnosis.several_verdict import SharedEffect


def diagnose_sessions(
    sessions: list[str],
    model: str | None,
    thorough: bool,
    effects: list[str],
    figures: Path | None,
    json: str | None,
) -> None:
    """Diagnose several sessions and what they share."""
    from fingermodel.diagnosis.several import diagnose_pooled

    if len(set(sessions)) < len(sessions):
        twice = next(s for s in sessions if sessions.count(s) > 1)
        raise InputError(f"session {twice} is given twice", "each session once")
    benches = []
    for name in sessions:
        with progress(f"Reading {name}") as tell:
            benches.append(open_bench(name, model, tell, catalogue=True, effects=effects))
    with progress("Fitting every effect to every session") as tell:
        pooled = diagnose_pooled(
            [(b.measured.session.id, b.model, b.observations) for b in benches], thorough=thorough, progress=tell
        )
    each = {
        bench.measured.session.id: diagnosis_body(bench, d) for bench, d in zip(benches, pooled.diagnoses, strict=True)
    }
    body = pooled_body(pooled) | {"each": each}
    if figures:
        from server.diagnosis_report import draw_diagnosis

        body["figures"] = [str(draw_diagnosis(own, figures / name)) for name, own in each.items()]
    if answer("diagnose", body, json):
        return
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
    table(
        f"Shared by {', '.join(pooled.sessions)}",
        ["effect", "probability", "ln evidence, one size", "own sizes", "value of all", "by session"],
        rows,
        f"nothing shared {pooled.p_apart:.3f}; of that, nothing missing in any {pooled.p_nothing:.3f}, something else "
        f"in each {pooled.p_other:.3f}",
    )
    for name, own in each.items():
        say(f"{name}: {own['sentence']}")
        say_first(own)
        for reason in own["reasons"]:
            say(f"    {reason}")
    for page in body.get("figures", []):
        say(f"Report: {page}")


def pooled_body(pooled: Pooled) -> dict[str, Any]:
    """The contract's answer for the sessions together."""
    verdict = pooled.verdict
    effect_of = {c.name: c.effect for c in pooled.diagnoses[0].candidates.all}
    named = verdict.names if verdict.kind in ("found", "one_of") else ()
    return {
        "sessions": list(pooled.sessions),
        "verdict": verdict.kind,
        "effects": list(dict.fromkeys(effect_of[n] for n in named)),
        "candidates": list(verdict.names),
        "probability": verdict.probability,
        "confirmed": None,
        "sentence": verdict.sentence,
        "short": list(verdict.short),
        "rests_on": list(verdict.rests_on),
        "p_nothing_shared": pooled.p_apart,
        "p_nothing": pooled.p_nothing,
        "p_other": pooled.p_other,
        "ranking": [_row(pooled, e) for e in pooled.ranking],
        "seconds": pooled.seconds,
    }


def _row(pooled: Pooled, effect: SharedEffect) -> dict[str, Any]:
    return {
        "effects": list(effect.explanation.effects),
        "candidates": list(effect.names),
        "probability": effect.probability,
        "log_evidence_gain": effect.log_evidence_shared,
        "log_evidence_gain_own_sizes": effect.log_evidence_own,
        "same_in_all": effect.one_size,
        "one_size": list(effect.names) if effect.one_size else [],
        "parameters": [
            {"name": p.name, "value": float(v), "sd": float(s), "unit": p.unit}
            for p, v, s in zip(effect.parameters, effect.value, effect.sd, strict=True)
        ],
        "each": {
            session: {
                "log_evidence_gain": each.gain,
                "values": [float(v) for v in each.values],
                "sd": [float(s) if s == s else None for s in each.sd],  # noqa: PLR0124 - NaN is not equal to itself
                "beside": None if each.own is None else list(each.own),
            }
            for session, each in zip(pooled.sessions, effect.each, strict=True)
        },
    }
