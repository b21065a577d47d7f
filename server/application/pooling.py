"""The answer of several sessions that were diagnosed together, and the law that they share."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fingermodel.diagnosis.several_sessions.several import Pooled
    from fingermodel.diagnosis.several_sessions.several_verdict import SharedEffect


def pooled_body(pooled: Pooled) -> dict[str, Any]:
    """Return the contract's answer for the sessions together."""
    verdict = pooled.verdict
    effect_of = {c.name: c.effect for c in pooled.diagnoses[0].candidates.all}
    named = verdict.names if verdict.kind in ("found", "one_of") else ()
    return {
        "sessions": list(pooled.sessions),
        "warnings": [f.as_warning() for f in pooled.findings],
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
        "shared": None if pooled.shared is None else pooled.shared.as_dict(),
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


def write_law(file: Path, shared: dict[str, Any] | None) -> str | None:
    """Write the best shared law that is no effect of the catalogue as a user's effect; None where there is none."""
    import yaml

    found = next((w["effect"] for w in (shared or {}).get("laws", []) if w["effect"]), None)
    if found is None:
        return None
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(yaml.safe_dump(found, sort_keys=False, allow_unicode=True), encoding="utf-8")
    return str(file)
