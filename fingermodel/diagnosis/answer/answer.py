"""A diagnosis as the contract's answer: plain values, units in the names, null for what is unknown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from scipy.special import chdtrc

from fingermodel.diagnosis.answer.ranking import effect_size, parameters_of, ranking, ready_made
from fingermodel.diagnosis.answer.where import bent, where
from fingermodel.diagnosis.diagnose import Diagnosis
from fingermodel.diagnosis.posterior.curves import curve_answer
from fingermodel.diagnosis.posterior.hyper import ANATOMY, BUDGET, NOISE, SCATTER
from fingermodel.diagnosis.session_model.bad_cases import Explained
from fingermodel.diagnosis.settings import LIVE, P_VALUE, SURE
from fingermodel.diagnosis.verdict.far_off import remarkable
from fingermodel.diagnosis.verdict.instruments import FAULT_REMEDY
from fingermodel.diagnosis.verdict.predictive import holding, together
from fingermodel.diagnosis.verdict.verdict import misfits, words
from fingermodel.fitting.reading_errors import OTHER_SCATTER, other_scatter
from fingermodel.parameters import with_unit

# Effects are shown from this probability on.
_SHOWN = 1e-4
# Keys of a compared case that are shown.
_OF_CASE = ("id", "role", "posture", "location", "masses_g", "measured_N", "measured_sd_N")
# Slips of a suspect that are shown at most, and from which probability.
_SLIPS, _SLIP = 3, 0.05


def answer(diagnosis: Diagnosis) -> dict[str, Any]:
    """Everything that one session's diagnosis says, without nulls and next load cases (their modules give those)."""
    d, posterior, best = diagnosis, diagnosis.posterior, diagnosis.best
    nothing, verdict = posterior.nothing, diagnosis.verdict
    before, after = d.comparisons[nothing.explanation], d.comparisons[best.explanation]
    rows = len(nothing.residual)
    alone, added = misfits(d.stated, best if best.explanation.size else d.stated)
    apart = d.standing_apart
    fails, fails_after = (
        where(d.session.problem, theta, apart)
        | {"without": [d.session.observations.ids[case] for case in apart], "added": list(names)}
        for theta, names in ((d.refitted.theta, ()), (d.theta_of(best), best.explanation.names))
    )
    return {
        "verdict": verdict.kind,
        "effects": list(verdict.effects),
        "candidates": list(verdict.names),
        "probability": min(verdict.probability, 1.0),
        "probability_of": meaning(d),
        "confirmed": None,
        "sentence": sentence(d),
        "reasons": [*verdict.reasons, *(f"Short of more: {s}." for s in verdict.short), *_missed(d), *remarks(d)],
        "robustness": d.sensitivity.as_dict(),
        "ranking": ranking(d),
        "inclusion": {name: p for name, p in posterior.inclusion.items() if p >= _SHOWN},
        "where": fails,
        "where_after": fails_after,
        "hints": [h.as_dict() for h in d.hints],
        "curve": curve_answer(d.curves),
        "trend": d.trend.as_dict() if d.trend else None,
        "ready_made": ready_made(d),
        "suspects": suspects(d),
        "outliers": [d.session.observations.ids[case] for case in d.outliers],
        "session_faults": [
            asdict(f) | {"amend": [asdict(a) for a in f.amend], "settled_by": FAULT_REMEDY[f.kind]} for f in d.faults
        ],
        "beyond": {
            "probability": posterior.p_beyond,
            "amplitude_N": posterior.beyond_newton,
            "of_one_alone": {carrier: p for carrier, p in posterior.carriers.items() if p >= LIVE},
        },
        **of_rig(d, [row["name"] for row in fails_after["bent"]]),
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
            {key: value for key, value in old.as_dict().items() if key in _OF_CASE}
            | {"before_N": old.predicted_N.tolist(), "after_N": new.predicted_N.tolist()}
            for old, new in zip(before.cases, after.cases, strict=True)
        ],
        "confounding": d.confounding.as_dict(),
        "detectability": {k: round(v, 3) for k, v in d.confounding.detectability.items()},
        "candidates_searched": len(posterior.weights),
        "seconds": d.seconds,
    }


def meaning(d: Diagnosis) -> str:
    """What the verdict's probability is the probability of, in words."""
    if d.faults:
        return d.faults[0].words
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
    # Of what refutes it the posterior knows nothing.
    p_value = _p_as_judged(d)
    others = " of the other cases" if d.unlike else ""
    refuted = p_value is not None and p_value < P_VALUE
    of = " of the fitted cases by themselves" if refuted else others
    return f"{likeliest} (the likeliest single statement{of})"


def nulls_beside(d: Diagnosis, held: Sequence[str]) -> str:
    """Say how tests that fail go together with the verdict, beside held effects' parameters; empty where none fails."""
    if all(n.verdict != "violated" for n in d.nulls):
        return ""
    apart = words([d.session.observations.ids[case] for case in d.suspects])
    rest = f", but for {apart}" if apart else ""
    first = "These tests hold readings of all cases against each other, and know of no effect."
    kind, names = d.verdict.kind, " and ".join(dict.fromkeys(n.split(".")[0] for n in held))
    if kind == "found":
        found = d.verdict.names
        explain = "explain" if len(found) > 1 else "explains"
        return f"{first} What fails shows that something acts; {' and '.join(found)} {explain} it{rest}."
    if kind != "nothing_missing" and d.posterior.p_nothing < 0.5:
        return f"{first} What fails shows that something acts, not what."
    if names:
        left = f"with it nothing is left to explain{rest}"
        return f"{first} What fails is the work of {names}, which the model holds: {left}."
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
            "location": slip.location,
            # Where the loads alone were, each case is put right by its own masses.
            "exchanged_with": None if slip.partner is None or slip.like != slip.partner else ids[slip.partner],
            "probability": probability,
            "chi_square": chi_square,
        }
        for slip, probability, chi_square in explained.slips[:_SLIPS]
        if probability >= _SLIP
    ]


def predictive(d: Diagnosis) -> dict[str, Any]:
    """The predictive check on the validation cases, of the model without any effect and of what would be added."""
    before = d.checks[d.posterior.nothing.explanation]
    after = d.checks[d.judged.explanation]
    return {
        "log_density_before": before.log_density,
        "p_value_before": before.p_value,
        "log_density_after": after.log_density,
        "p_value_after": _p_as_judged(d),
        "missed_after": [d.session.observations.ids[case] for case in after.missed],
    }


def _p_as_judged(d: Diagnosis) -> float | None:
    """P-value as the verdict counts it: whichever explanation with these effects holds."""
    shares = holding(d.posterior, d.judged)
    return together(d.checks, shares) if shares.keys() <= d.checks.keys() else d.checks[d.judged.explanation].p_value


def _missed(d: Diagnosis) -> list[str]:
    """What is said of validation cases that are off by themselves, whatever all of them say together."""
    missed = [d.session.observations.ids[case] for case in d.checks[d.judged.explanation].missed]
    if not missed or d.faults or d.verdict.short:
        return []
    listed = f"{', '.join(missed[:3])}{f' and {len(missed) - 3} others' if len(missed) > 3 else ''}"
    return [f"By themselves these validation cases are not as predicted: {listed}. Measure them again."]


def sentence(d: Diagnosis) -> str:
    """The verdict in one plain sentence, a fault of the whole session before it."""
    verdict = d.verdict
    if d.faults:
        fault = d.faults[0]
        words = f"{fault.words[0].upper()}{fault.words[1:]}"
        return (
            f"A fault of the whole session (probability {fault.probability:.2f}): {words}. To be sure, "
            f"{FAULT_REMEDY[fault.kind]}; then correct the session."
        )
    named = [f"{d.candidates.by_name[n].title} ({n})" for n in verdict.names]
    if verdict.kind == "found":
        values = ", ".join(
            with_unit(f"{p['name']} = {p['value']:.3g}" + (f" ± {p['sd']:.2g}" if p["sd"] else ""), p["unit"])
            for p in parameters_of(d.best)[:3]
        )
        return f"Found: {' and '.join(named)}; {values}; probability {verdict.probability:.2f}."
    if verdict.kind == "one_of":
        return f"One of these, which the load cases do not tell apart: {'; '.join(named)}."
    if verdict.kind == "none_of_catalogue":
        known = next((k for k in ready_made(d) if k["probability"] >= 0.5), None)
        # The trend is of what is left: where something known acts, that alone is left of it.
        if d.trend and not (known and known["size_N"] > d.trend.size_N):
            return f"Something is missing that no effect here describes; it {d.trend.words}."
        if known:
            like = f"{known['title']} ({known['effect']})"
            return f"Something is missing that no effect of the catalogue describes; it looks like this: {like}."
        offered = " and the formulas offered" if d.hints else ""
        return f"Something is missing that no effect here describes; see where it lies{offered}."
    if verdict.kind == "nothing_missing":
        return "Nothing is missing: noise, scatter and the small errors that every rig has explain the readings."
    unknown = d.posterior.p_beyond >= SURE
    beyond = " Something acts that no effect here describes." if unknown else ""
    beside = "Beside it, most likely" if unknown else "Most likely"
    leader = f" {beside}: {' and '.join(named)}, but that is not sure." if named else ""
    seen = f" What is left {d.trend.words}." if d.trend else ""
    return f"Undecided.{beyond}{leader}{seen}"


def of_rig(d: Diagnosis, bent_most: Sequence[str]) -> dict[str, Any]:
    """Return the keys of repeatability, budget (and which of its parameters are bent most), anatomy and noise."""
    assumed = d.session.observations.noise_assumed
    scatter, budget, anatomy, noise = map(d.posterior.hyperparameter, (SCATTER, BUDGET, ANATOMY, NOISE))
    repeatability: dict[str, float | None] = {f"{key}_pct": 100.0 * v for key, v in _with_sd(scatter).items()}
    repeatability["stated_pct"] = 100.0 * d.session.stated_scatter
    others = d.posterior.other_scatter
    for name, (key, unit, factor, *_) in OTHER_SCATTER.items():
        both = [factor * v for v in others[name]] if name in others else [None, None]
        repeatability |= dict(zip((f"{key}_{unit}", f"{key}_sd_{unit}"), both, strict=True))
    return {
        "repeatability": repeatability,
        "budget_multiple": _with_sd(budget) | {"carried_by": list(bent_most)},
        "anatomy_multiple": _with_sd(anatomy),
        "noise_multiple": _with_sd(noise if assumed else (1.0, 0.0)) | {"assumed": assumed},
        "extra_noise_N": None if assumed else _with_sd(noise),
    }


def _with_sd(of: tuple[float, float]) -> dict[str, Any]:
    return dict(zip(("value", "sd"), of, strict=True))


def remarks(d: Diagnosis) -> list[str]:
    """Say what fits hold fixed elsewhere, and what repeatability, budget, anatomy and noise the readings want."""
    out, posterior = d.session.model.parameters.fixed_elsewhere, d.posterior
    if d.faults:
        return out  # what they cause says nothing of the rig
    if d.trend and d.trend.sentence not in d.verdict.short:
        out.append(f"{d.trend.sentence}.")
    axes = SCATTER, BUDGET, ANATOMY, NOISE
    scatter, multiple, anatomy, noise = (posterior.hyperparameter(axis)[0] for axis in axes)
    stated = d.session.stated_scatter
    if scatter > max(0.004, 1.5 * stated):
        than = f", where {100 * stated:.1f} % is stated" if stated else ", where none is stated"
        out.append(f"The cases repeat to {100 * scatter:.1f} % of their tensions{than}.")
    if others := other_scatter({kind: value for kind, (value, _) in posterior.other_scatter.items()}):
        out.append(f"Besides, the readings scatter by {', by '.join(others)}.")
    if multiple > 1.5:
        carried = ", ".join(row["name"] for row in bent(d.session.problem, d.theta_of(d.best))[:3])
        out.append(
            f"The readings want a budget {multiple:.1f} times as large as stated"
            + (f"; it is bent most in {carried}." if carried else ".")
        )
    if anatomy > 1.5:
        out.append(
            f"The specimen differs {anatomy:.1f} times as much from the finger of its file as the anatomy's priors say."
        )
    out += [f"To be looked at: {said}." for said in remarkable(d.best) if said not in d.verdict.short]
    if d.outliers:
        ids = ", ".join(d.session.observations.ids[case] for case in d.outliers)
        out.append(f"Not counted: {ids}, off by more than usual noise, and by less than a slip would explain.")
    if d.session.observations.noise_assumed:
        out.append(
            f"The readings state no uncertainty; this rests on {noise * d.session.model.budget.reading_sd_N:.3f} N a "
            "component, as the readings have it."
        )
    elif noise >= 0.002:
        out.append(f"Each reading scatters by {1000.0 * noise:.0f} mN beside the noise of its plateau and its tare.")
    return out
