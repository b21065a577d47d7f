"""A diagnosis as the contract's answer: plain values, units in the names, null for what is unknown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, logsumexp

from fingermodel.diagnosis.answer.effect_size import effect_size
from fingermodel.diagnosis.answer.rig import of_rig, remarks
from fingermodel.diagnosis.answer.where import where
from fingermodel.diagnosis.diagnose import Diagnosis
from fingermodel.diagnosis.posterior.marginals import Posterior
from fingermodel.diagnosis.posterior.optimum import Optimum
from fingermodel.diagnosis.session_model.candidates import Explanation
from fingermodel.diagnosis.session_model.slips import Explained
from fingermodel.diagnosis.settings import LIVE
from fingermodel.diagnosis.verdict.own_curve import curve_answer
from fingermodel.diagnosis.verdict.predictive import holding, together
from fingermodel.diagnosis.verdict.verdict import misfits
from fingermodel.parameters import with_unit

Floats = NDArray[np.float64]

# Effects are shown from this probability on.
_SHOWN = 1e-4
# Of what is known beyond the catalogue.
_OFFERED = 0.05
# Slips of a suspect that are shown at most, and from which probability.
_SLIPS, _SLIP = 3, 0.05


def answer(diagnosis: Diagnosis) -> dict[str, Any]:
    """Everything that one session's diagnosis says, without nulls and next load cases (their modules give those).

    Args:
        diagnosis: of `diagnose`.
    """
    d, posterior, best = diagnosis, diagnosis.posterior, diagnosis.best
    nothing, verdict = posterior.nothing, diagnosis.verdict
    before, after = d.comparisons[nothing.explanation], d.comparisons[best.explanation]
    rows = len(nothing.residual)
    alone, added = misfits(d.stated, best if best.explanation.size else d.stated)
    after_where = where(d.session.problem, d.theta_of(best)) | {"added": list(best.explanation.names)}
    return {
        "verdict": verdict.kind,
        "effects": list(verdict.effects),
        "candidates": list(verdict.names),
        "probability": min(verdict.probability, 1.0),
        "probability_of": meaning(d),
        "confirmed": None,
        "sentence": sentence(d),
        "reasons": [*verdict.reasons, *(f"Short of more: {s}." for s in verdict.short), *remarks(d)],
        "robustness": d.sensitivity.as_dict(),
        "ranking": ranking(d),
        "inclusion": {name: p for name, p in posterior.inclusion.items() if p >= _SHOWN},
        "where": where(d.session.problem, d.refitted.theta) | {"added": []},
        "where_after": after_where,
        "hints": [h.as_dict() for h in d.hints],
        "curve": curve_answer(d.curves),
        "trend": d.trend.as_dict() if d.trend else None,
        "ready_made": ready_made(d),
        "suspects": suspects(d),
        "outliers": [d.session.observations.ids[case] for case in d.outliers],
        "session_faults": [asdict(f) | {"amend": [asdict(a) for a in f.amend]} for f in d.faults],
        "beyond": {
            "probability": posterior.p_beyond,
            "amplitude_N": posterior.beyond_newton,
            "of_one_alone": {carrier: p for carrier, p in posterior.carriers.items() if p >= LIVE},
        },
        **of_rig(d, [row["name"] for row in after_where["bent"]]),
        "predictive_check": predictive(d),
        "size": effect_size(d) if verdict.kind == "found" else None,
        # Of all cases but suspects and outliers.
        "before": d.comparison(nothing).summary(),
        "after": d.comparison(best).summary(),
        "chi_square": {
            "value": alone,
            "degrees_of_freedom": rows,
            "p_value": float(chdtrc(rows, alone)),
            "after": added,
            "after_p_value": float(chdtrc(rows, added)),
            "budget_factor": float(best.hyper.values(best.best).budget),
            "after_allowing_for_form_and_budget": best.misfit(best.best),
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
        "candidates_searched": len(posterior.fits) + len(d.searched.promised),
        "seconds": d.seconds,
    }


def meaning(d: Diagnosis) -> str:
    """What the verdict's probability is the probability of, in words."""
    names, several = " and ".join(d.verdict.names), len(d.verdict.names) > 1
    kinds = {
        "found": f"{names} {'act by their known laws' if several else 'acts by its known law'}, whatever else does",
        "one_of": f"one or more of {', '.join(d.verdict.names)} acts",
        "none_of_catalogue": "something acts that no effect of the catalogue describes, whatever else does",
        "nothing_missing": "no effect acts, and nothing unknown",
    }
    if d.verdict.kind != "undecided":
        return kinds[d.verdict.kind]
    # Its probability is that of what would be said if it were sure.
    single = {kinds["nothing_missing"]: d.posterior.p_nothing, kinds["none_of_catalogue"]: d.posterior.p_beyond}
    single |= {f"{name} acts": p for name, p in d.posterior.inclusion.items()}
    single |= {kinds["found"]: d.posterior.of_names(d.verdict.names)} if several else {}
    likeliest = min(single, key=lambda words: abs(single[words] - d.verdict.probability))
    return f"{likeliest} (the likeliest single statement)"


def nulls_beside(d: Diagnosis, held: Sequence[str]) -> str:
    """Say how tests that fail go together with the verdict; empty where none fails.

    Args:
        d: the diagnosis.
        held: parameters of effects that the model holds already.
    """
    if all(n.verdict != "violated" for n in d.nulls):
        return ""
    first = "These tests hold readings against readings, and know of no effect."
    kind, names = d.verdict.kind, " and ".join(dict.fromkeys(n.split(".")[0] for n in held))
    if kind == "found":
        found = d.verdict.names
        explain = "explain" if len(found) > 1 else "explains"
        return f"{first} What fails shows that something acts; {' and '.join(found)} {explain} it."
    if kind != "nothing_missing":
        return f"{first} What fails shows that something acts, not what."
    if names:
        return f"{first} What fails is the work of {names}, which the model holds: with it nothing is left to explain."
    return (
        f"{first} They allow for noise and budget alone; with scatter of the tensions and something smooth the model "
        "explains the same readings, so what fails is no finding by itself."
    )


def suspects(d: Diagnosis) -> list[dict[str, Any]]:
    """Cases that are more probably bad than not, the likeliest first; the verdict stands without them."""
    observations, verdict = d.session.observations, d.verdict
    without = {"verdict": verdict.kind, "effects": list(verdict.effects), "probability": min(verdict.probability, 1.0)}
    return [
        {
            "case": observations.ids[case],
            "role": observations.roles[case],
            "probability": p,
            "reads_like": [] if slips is None else reads_like(slips, observations.ids),
            "verdict_without": without,
        }
        for case, (p, slips) in d.suspects.items()
    ]


def reads_like(explained: Explained, ids: Sequence[str]) -> list[dict[str, Any]]:
    """What would make a suspect's reading expected, the most probable first; empty where nothing known does."""
    return [
        {
            "kind": slip.kind,
            "words": slip.words,
            "masses_g": dict(slip.masses_g),
            "posture": slip.posture,
            "exchanged_with": None if slip.partner is None else ids[slip.partner],
            "probability": probability,
            "chi_square": chi_square,
        }
        for slip, probability, chi_square in explained.slips[:_SLIPS]
        if probability >= _SLIP
    ]


def predictive(d: Diagnosis) -> dict[str, Any]:
    """The predictive check on the validation cases, of the model without any effect and of what would be added."""
    before = d.checks[d.posterior.nothing.explanation]
    judged = d.best if d.best.explanation in d.checks else d.posterior.leader
    after, shares = d.checks[judged.explanation], holding(d.posterior, judged)
    return {
        "log_density_before": before.log_density,
        "p_value_before": before.p_value,
        "log_density_after": after.log_density,
        # As the verdict counts it: whichever explanation with these effects holds.
        "p_value_after": together(d.checks, shares) if shares.keys() <= d.checks.keys() else after.p_value,
        "missed_after": [d.session.observations.ids[case] for case in after.missed],
    }


def ready_made(d: Diagnosis) -> list[dict[str, Any]]:
    """What rigs are known to do beyond the catalogue and these readings show, most probable first."""
    posterior = d.posterior
    out: list[dict[str, Any]] = []
    fits = [f for f in posterior.fits.values() if any(m.candidate.outside for m in f.explanation.members)]
    for fit in sorted(fits, key=posterior.weight, reverse=True):
        for member in fit.explanation.members:
            name = member.candidate.effect
            if not member.candidate.outside or any(o["effect"] == name for o in out):
                continue
            probability = _of_effect(posterior, name)
            if probability >= _OFFERED:
                title = next(e.title for e in d.session.model.effects if e.name == name)
                out.append(
                    {
                        "effect": name,
                        "title": title,
                        "where": member.candidate.name,
                        "probability": probability,
                        "log_evidence_gain": _gain(posterior, fit),
                        "size_N": fit.sizes_newton[member.candidate.name],
                        "misfit": fit.misfit(fit.best),
                        "text": f"Known to happen in rigs: {title}; probability {probability:.2f}",
                    }
                )
    return out


def _of_effect(posterior: Posterior, effect: str) -> float:
    return posterior.probability(lambda e: effect in e.explanation.effects)


def _gain(posterior: Posterior, fit: Optimum) -> float:
    """Log evidence over nothing at all."""
    return fit.log_posterior - fit.log_prior - _of_nothing(posterior) if fit.explanation.size else 0.0


def _of_nothing(posterior: Posterior) -> float:
    """Log evidence of no effect and nothing smooth, which "nothing missing" stands for."""
    fit = posterior.nothing
    plain = [value for node, value in fit.nodes.items() if not fit.hyper.smooth_blocks(node)]
    whole = logsumexp(plain) if plain else fit.log_joint(fit.hyper.without_smooth(fit.best))
    return float(whole) - fit.log_prior


def ranking(d: Diagnosis) -> list[dict[str, Any]]:
    """Every explanation that was fitted, best first, with nothing missing and something else in their places."""
    posterior = d.posterior
    probability = posterior.of_explanations()
    fits: dict[tuple[str, ...], Optimum] = {}
    for fit in sorted(posterior.fits.values(), key=posterior.weight, reverse=True):
        fits.setdefault(fit.explanation.names, fit)
    rows = [_row(d, fit, probability.get(names, 0.0)) for names, fit in fits.items()]
    rows.append(
        {
            "effects": ["none_of_catalogue"],
            "candidates": [],
            "probability": probability[None],
            "log_evidence_gain": _unnamed_gain(d),
            "validation_rmse_N": {"before": d.validation_rmse(posterior.nothing), "after": None},
            "parameters": [],
            "indistinguishable_from": [],
            "size_N": posterior.beyond_newton,
        }
    )
    return sorted(rows, key=lambda r: -r["probability"])


def _unnamed_gain(d: Diagnosis) -> float | None:
    """Log evidence over nothing at all of what counts as something else; None where that is not in question.

    Its hypotheses are an explanation, what is smooth beside it, and what carries that; each has its own prior.
    """
    joint: list[float] = []
    prior: dict[tuple[Explanation, tuple[str, ...]], float] = {}
    for e in d.posterior.entries:
        if not e.unnamed:
            continue
        if e.fit is None or e.node is None:
            promise = d.searched.promised[e.explanation]
            joint.append(promise.log_posterior)
            prior[e.explanation, ()] = promise.log_prior
        else:
            joint.append(e.fit.nodes[e.node])
            smooth = tuple(e.fit.hyper.smooth_blocks(e.node))
            prior[e.explanation, smooth] = e.fit.log_prior + e.fit.hyper.log_prior_of_smooth(e.node)
    return float(logsumexp(joint) - logsumexp([*prior.values()])) - _of_nothing(d.posterior) if joint else None


def _row(d: Diagnosis, fit: Optimum, probability: float) -> dict[str, Any]:
    explanation = fit.explanation
    strength = _strength(fit)
    spread = 1.96 / strength if strength else None
    size = sum(v**2 for v in fit.sizes_newton.values()) ** 0.5
    alike = dict.fromkeys(a for n in explanation.names for a in d.confounding.alike(n))
    errors = fit.hyper.values(fit.best).forms
    table, theta = d.session.model.parameters, d.theta_of(fit)
    return {
        "effects": list(explanation.effects),
        "candidates": list(explanation.names),
        "probability": probability,
        "log_evidence_gain": _gain(d.posterior, fit),
        "validation_rmse_N": {"before": d.validation_rmse(d.posterior.nothing), "after": d.validation_rmse(fit)},
        "parameters": parameters_of(fit),
        "indistinguishable_from": [a for a in alike if a not in explanation.names],
        "variant": _variant(explanation),
        "size_N": size,
        "size_low_N": size * max(1.0 - spread, 0.0) if spread else None,
        "size_high_N": size * (1.0 + spread) if spread else None,
        "in_range": _in_range(fit),
        "detectability": _detectability(d, explanation),
        "form_error": float(errors.max(initial=0.0)),
        "misfit": fit.misfit(fit.best),
        # What the fit moved, so that any residual after it can be computed again.
        "fit": {table.names[i]: float(f"{theta[i]:.9g}") for i in np.flatnonzero(theta != table.initial)},
    }


def parameters_of(fit: Optimum) -> list[dict[str, Any]]:
    """An explanation's own parameters: their mean and standard deviation, everything else left open."""
    theta, covariance, index = fit.parameter_posterior(fit.best)
    table, scale = fit.session.model.parameters, fit.session.problem.scale
    sd = dict(zip(index.tolist(), (np.sqrt(np.diag(covariance)) * scale[index]).tolist(), strict=True))
    return [
        {"name": table.names[i], "value": float(theta[i]), "sd": sd.get(i), "unit": table.parameters[i].unit}
        for i in fit.explanation.parameters
    ]


def _strength(fit: Optimum) -> float:
    """How many standard deviations an explanation's parameters together lie from their null."""
    if not fit.explanation.size:
        return 0.0
    freed, _ = fit.freed(fit.best)
    return float(np.sqrt(freed.mean @ np.linalg.solve(freed.covariance, freed.mean)))


def _in_range(fit: Optimum) -> bool:
    """Whether all of an explanation's values lie within one and a half times their plausible ranges."""
    for i in fit.explanation.parameters:
        p = fit.session.model.parameters.parameters[i]
        low, high = p.plausible or (p.lower, p.upper)
        if (
            not p.initial - 1.5 * (p.initial - low) - 1e-9
            <= fit.theta[i]
            <= p.initial + 1.5 * (high - p.initial) + 1e-9
        ):
            return False
    return True


def _variant(explanation: Explanation) -> str | None:
    parts = [
        f"{m.candidate.name}: form {m.form + 1} of {len(m.candidate.forms)}"
        for m in explanation.members
        if len(m.candidate.forms) > 1
    ]
    return "; ".join(parts) or None


def _detectability(d: Diagnosis, explanation: Explanation) -> float | None:
    values = [d.confounding.detectability.get(n) for n in explanation.names]
    known = [v for v in values if v is not None]
    return min(known) if known else None


def sentence(d: Diagnosis) -> str:
    """The verdict in one plain sentence, a fault of the whole session before it."""
    verdict = d.verdict
    if d.faults:
        fault = d.faults[0]
        words = f"{fault.words[0].upper()}{fault.words[1:]}"
        return (
            f"A fault of the whole session (probability {fault.probability:.2f}): {words}. Correct the session first."
        )
    titles = {e.name: e.title for e in d.session.model.effects}
    effect_of = {c.name: c.effect for c in d.candidates.all}
    named = [f"{titles.get(effect_of[n], n)} ({n})" for n in verdict.names]
    if verdict.kind == "found":
        values = ", ".join(
            with_unit(f"{p['name']} = {p['value']:.3g}" + (f" ± {p['sd']:.2g}" if p["sd"] else ""), p["unit"])
            for p in parameters_of(d.best)[:3]
        )
        return f"Found: {' and '.join(named)}; {values}; probability {verdict.probability:.2f}."
    if verdict.kind == "one_of":
        return f"One of these, which the load cases do not tell apart: {'; '.join(named)}."
    if verdict.kind == "none_of_catalogue":
        if d.trend:
            return f"Something is missing that no effect here describes; it {d.trend.words}."
        known = ready_made(d)[:1]
        if known and known[0]["probability"] >= 0.5:
            like = f"{known[0]['title']} ({known[0]['effect']})"
            return f"Something is missing that no effect of the catalogue describes; it looks like this: {like}."
        offered = " and the formulas offered" if d.hints else ""
        return f"Something is missing that no effect here describes; see where it lies{offered}."
    if verdict.kind == "nothing_missing":
        return "Nothing is missing: noise, scatter and the small errors that every rig has explain the readings."
    leader = f" Most likely: {' and '.join(named)}, but it is not sure." if named else ""
    seen = f" What is left {d.trend.words}." if d.trend else ""
    return f"Undecided.{leader}{seen}"
