"""A diagnosis as the contract's answer: plain values, units in the names, null for what is unknown."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from fingermodel.diagnosis.calibration import calibrate
from fingermodel.diagnosis.candidates import Explanation
from fingermodel.diagnosis.diagnose import Diagnosis
from fingermodel.diagnosis.evidence import Weighed
from fingermodel.diagnosis.fitted import Fitted
from fingermodel.diagnosis.verdict import inclusion, out_of_range
from fingermodel.diagnosis.where import where
from fingermodel.effects.user import load_effect
from fingermodel.parameters import with_unit

Floats = NDArray[np.float64]

# What is known beyond the catalogue is offered from this probability on.
SHOWN = 0.05


def answer(diagnosis: Diagnosis) -> dict[str, Any]:
    """Everything that one session's diagnosis says, without nulls and next load cases (their modules give those).

    Args:
        diagnosis: of `diagnose`.
    """
    d, evidence = diagnosis, diagnosis.evidence
    nothing, best = evidence.nothing, d.best
    verdict, robust = d.verdict, d.robustness
    before, after = d.comparisons[()], d.comparisons[best.explanation.names]
    calibration = calibrate(d.search.nothing.everything, d.candidates)
    rows = len(d.problem.rows)
    return {
        "verdict": verdict.kind,
        "effects": list(verdict.effects),
        "candidates": list(verdict.names),
        # A sum over many explanations may come out above 1 by its rounding.
        "probability": min(verdict.probability, 1.0),
        "confirmed": None,
        "sentence": sentence(d),
        "reasons": [*verdict.reasons, *(f"Short of more: {s}." for s in verdict.short)],
        "robustness": {
            "flips_when": list(robust.flips_when),
            "rests_on": list(robust.rests_on),
            "budget_multiple_at_which_it_fails": robust.budget_multiple_at_which_it_fails,
            "sagittal_alone": robust.sagittal_alone,
        },
        "ranking": ranking(d),
        "inclusion": {name: min(p, 1.0) for name, p in inclusion(evidence.probability).items() if p >= 1e-4},
        "where": where(d.problem, nothing.fitted.theta),
        "hints": [h.as_dict() for h in d.hints],
        "ready_made": ready_made(d),
        "before": before.summary(),
        "after": after.summary(),
        "chi_square": {
            "value": nothing.fitted.objective,
            "degrees_of_freedom": rows,
            "p_value": float(chdtrc(rows, nothing.fitted.objective)),
            "after": best.fitted.objective,
            "after_p_value": float(chdtrc(rows, best.fitted.objective)),
            "budget_factor": best.budget_factor,
            "after_allowing_for_form_and_budget": best.misfit,
        },
        "cases": [
            {
                "id": old.id,
                "role": old.role,
                "posture": old.posture,
                "location": old.location,
                "masses_g": old.masses_g,
                "measured_N": old.measured_N.tolist(),
                "measured_sd_N": old.measured_sd_N.tolist(),
                "before_N": old.predicted_N.tolist(),
                "after_N": new.predicted_N.tolist(),
            }
            for old, new in zip(before.cases, after.cases, strict=True)
        ],
        "confounding": d.confounding.as_dict(),
        "detectability": {k: round(v, 3) for k, v in d.confounding.detectability.items()},
        "candidates_searched": d.search.searched,
        "false_finding_rate": calibration.false_finding_rate,
        "calibration": calibration.as_dict(),
        "seconds": d.seconds,
    }


def ready_made(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """What rigs are known to do beyond the catalogue and these readings show, most probable first.

    Each is an effect that comes ready-made, to be added by its name.
    """
    d, evidence = diagnosis, diagnosis.evidence
    if d.verdict.kind not in ("none_of_catalogue", "undecided"):
        return []
    out = []
    for known, share in evidence.other.known:
        probability = share * evidence.probability[None]
        if probability >= SHOWN:
            title = load_effect(Path(known.name)).title
            out.append(
                {
                    "effect": known.name,
                    "title": title,
                    "where": known.words,
                    "probability": min(probability, 1.0),
                    "log_evidence_gain": known.log_evidence - evidence.nothing.log_evidence,
                    "size_N": known.size_N,
                    "misfit": known.misfit,
                    "text": f"Known to happen in rigs: {title} ({known.words}); it would leave a misfit of "
                    f"{known.misfit:.0f} for {len(d.problem.rows)} readings",
                }
            )
    return out


def ranking(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """Every explanation that was fitted, best first, with nothing missing and something else in their places."""
    d, evidence = diagnosis, diagnosis.evidence
    rows, seen = [], set()
    for weighed in evidence.weighed:
        names = weighed.explanation.names
        if names not in seen:
            seen.add(names)
            rows.append(_row(d, weighed))
    rows.append(
        {
            "effects": ["none_of_catalogue"],
            "candidates": [],
            "probability": evidence.probability[None],
            "log_evidence_gain": evidence.other.log_evidence - evidence.nothing.log_evidence,
            "validation_rmse_N": {"before": d.validation_rmse(evidence.nothing), "after": None},
            "parameters": [],
            "indistinguishable_from": [],
            "size_N": evidence.other.amplitude_N,
        }
    )
    rows.sort(key=lambda r: -r["probability"])
    others = sorted(d.search.fitted, key=lambda f: -f.log_evidence)
    for fitted in others:
        names = fitted.explanation.names
        if names not in seen:
            seen.add(names)
            rows.append(_unweighed(d, fitted))
    return rows


def _row(d: Diagnosis, weighed: Weighed) -> dict[str, Any]:
    nothing, fitted = d.evidence.nothing, weighed.fitted
    parameters = _parameters(fitted, weighed)
    strength = fitted.strength(fitted.explanation.parameters)
    spread = 1.96 / strength if strength else None
    alike = [a for n in weighed.explanation.names for a in d.confounding.alike(n)]
    return {
        "effects": list(weighed.explanation.effects),
        "candidates": list(weighed.explanation.names),
        "probability": d.evidence.probability[weighed.explanation.names],
        "log_evidence_gain": weighed.log_evidence - nothing.log_evidence,
        "validation_rmse_N": {"before": d.validation_rmse(nothing), "after": d.validation_rmse(weighed)},
        "parameters": parameters,
        "indistinguishable_from": [a for a in alike if a not in weighed.explanation.names],
        "variant": _variant(d, weighed.explanation),
        "size_N": weighed.size_N,
        "size_low_N": weighed.size_N * max(1.0 - spread, 0.0) if spread else None,
        "size_high_N": weighed.size_N * (1.0 + spread) if spread else None,
        "in_range": not out_of_range(weighed),
        "detectability": _detectability(d, weighed.explanation),
        "form_error": weighed.form_error,
        "misfit": weighed.misfit,
        "largest_abs_z": _largest_z(fitted),
    }


def _unweighed(d: Diagnosis, fitted: Fitted) -> dict[str, Any]:
    return {
        "effects": list(fitted.explanation.effects),
        "candidates": list(fitted.explanation.names),
        "probability": 0.0,
        # Too far behind to be weighed with the budget's size and the form left open, so on no common footing.
        "log_evidence_gain": None,
        "validation_rmse_N": {"before": d.validation_rmse(d.evidence.nothing), "after": None},
        "parameters": _parameters(fitted),
        "indistinguishable_from": [a for n in fitted.explanation.names for a in d.confounding.alike(n)],
        "detectability": _detectability(d, fitted.explanation),
    }


def _parameters(fitted: Fitted, weighed: Weighed | None = None) -> list[dict[str, Any]]:
    table, of = fitted.problem.model.parameters.parameters, weighed or fitted
    return [
        {"name": table[i].name, "value": float(fitted.theta[i]), "sd": of.sd(i), "unit": table[i].unit}
        for i in fitted.explanation.parameters
    ]


def _variant(d: Diagnosis, explanation: Explanation) -> str | None:
    by_name = {c.name: c for c in d.candidates}
    parts = [
        f"{name}: form {k + 1} of {len(by_name[name].alternatives)}"
        for name, k in zip(explanation.names, explanation.alternative, strict=True)
        if len(by_name[name].alternatives) > 1
    ]
    return "; ".join(parts) or None


def _detectability(d: Diagnosis, explanation: Explanation) -> float | None:
    values = [d.confounding.detectability.get(n) for n in explanation.names]
    known = [v for v in values if v is not None]
    return min(known) if known else None


def _largest_z(fitted: Fitted) -> float:
    """Largest whitened residual after the fit: what a posterior predictive check would stumble over."""
    return float(np.abs(fitted.residual).max(initial=0.0))


def sentence(d: Diagnosis) -> str:
    """The verdict in one plain sentence."""
    verdict = d.verdict
    titles = {e.name: e.title for e in d.problem.model.effects}
    named = [f"{titles.get(e, e)} ({n})" for e, n in _named(d)]
    if verdict.kind == "found":
        values = ", ".join(
            with_unit(f"{p['name']} = {p['value']:.3g}" + (f" ± {p['sd']:.2g}" if p["sd"] else ""), p["unit"])
            for p in _parameters(d.best.fitted, d.best)[:3]
        )
        return f"Found: {' and '.join(named)}; {values}; probability {verdict.probability:.2f}."
    if verdict.kind == "one_of":
        return f"One of these, which the load cases do not tell apart: {'; '.join(named)}."
    if verdict.kind == "none_of_catalogue":
        offered = " and the formulas offered" if d.hints else ""
        known = ready_made(d)[:1]
        if known and d.evidence.other.likely:
            like = f"{known[0]['title']} ({known[0]['effect']}, {known[0]['where']})"
            return f"Something is missing that no effect of the catalogue describes; it looks like this: {like}."
        return f"Something is missing that no effect here describes; see where it lies{offered}."
    if verdict.kind == "nothing_missing":
        return "Nothing is missing: noise and the small errors that every rig has explain the readings."
    leader = f" Most likely: {' and '.join(named)}, but it does not stand." if named else ""
    return f"Undecided.{leader}"


def _named(d: Diagnosis) -> list[tuple[str, str]]:
    by_name = {c.name: c.effect for c in d.candidates}
    return [(by_name[n], n) for n in d.verdict.names]
