"""Every explanation of a diagnosis as the answer's rows: how probable, how large, and with which values.

Of a finding also how large it is as a function of load and posture, with a band.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.special import logsumexp

from fingermodel.diagnosis.diagnose import Diagnosis
from fingermodel.diagnosis.next_cases.next_cases import PlannedReading, inputs_of, largest_loads
from fingermodel.diagnosis.posterior.marginals import summed
from fingermodel.diagnosis.posterior.optimum import Optimum
from fingermodel.diagnosis.session_model.candidates import Explanation
from fingermodel.diagnosis.session_model.reading_changes import CaseChanges
from fingermodel.diagnosis.settings import SEED
from fingermodel.fitting.roots import root_of

# Effects beyond the catalogue are shown from this probability on.
_OFFERED = 0.05
# Parameters drawn for a finding's band, and the shares of the largest load at which it is told.
_DRAWS, _LEVELS = 24, (0.25, 0.5, 0.75, 1.0)


def ready_made(d: Diagnosis) -> list[dict[str, Any]]:
    """What rigs are known to do beyond the catalogue and these readings show, most probable first."""
    posterior = d.posterior
    acting = summed((effect, e.probability) for e in posterior.entries for effect in {c.effect for c in e.known})
    out: list[dict[str, Any]] = []
    fits = [f for f in posterior.fits.values() if any(m.candidate.outside for m in f.explanation.members)]
    for fit in sorted(fits, key=posterior.weight, reverse=True):
        for member in fit.explanation.members:
            name, title = member.candidate.effect, member.candidate.title
            if not member.candidate.outside or any(o["effect"] == name for o in out):
                continue
            probability = min(acting.get(name, 0.0), 1.0)
            if probability >= _OFFERED:
                out.append(
                    {
                        "effect": name,
                        "title": title,
                        "where": member.candidate.name,
                        "probability": probability,
                        "log_evidence_gain": _gain(d, fit),
                        "size_N": fit.sizes_newton[member.candidate.name],
                        "misfit": fit.misfit(fit.best),
                        "text": f"Known to happen in rigs: {title}; probability {probability:.2f}",
                    }
                )
    return out


def _gain(d: Diagnosis, fit: Optimum) -> float:
    """Log evidence over nothing at all."""
    return fit.log_posterior - fit.log_prior - d.log_evidence_of_nothing if fit.explanation.size else 0.0


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
    return float(logsumexp(joint) - logsumexp([*prior.values()])) - d.log_evidence_of_nothing if joint else None


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
        "log_evidence_gain": _gain(d, fit),
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
    """An explanation's own parameters: their mean and standard deviation, everything else left open.

    What is furthest from its null in standard deviations comes first, that of each effect before all others.
    """
    theta, covariance, index = fit.parameter_posterior(fit.best)
    table, scale = fit.session.model.parameters, fit.session.problem.scale
    sd = dict(zip(index.tolist(), (np.sqrt(np.diag(covariance)) * scale[index]).tolist(), strict=True))
    strength = {i: abs(theta[i] - table.initial[i]) / (sd.get(i) or np.inf) for i in fit.explanation.parameters}
    ordered = sorted(strength, key=lambda i: -strength[i])
    first = {table.names[i].split(".")[0]: i for i in reversed(ordered)}
    ordered.sort(key=lambda i: i not in first.values())
    return [
        {"name": table.names[i], "value": float(theta[i]), "sd": sd.get(i), "unit": table.parameters[i].unit}
        for i in ordered
    ]


def _strength(fit: Optimum) -> float:
    """How many standard deviations an explanation's parameters together lie from their null."""
    if not fit.explanation.size:
        return 0.0
    freed = fit.freed(fit.best)
    return float(np.sqrt(freed.mean @ np.linalg.solve(freed.covariance, freed.mean)))


def _in_range(fit: Optimum) -> bool:
    """Whether all of an explanation's values lie within one and a half times their plausible ranges."""
    own = [(fit.session.model.parameters.parameters[i], fit.theta[i]) for i in fit.explanation.parameters]
    ranges = [(p.plausible or (p.lower, p.upper), p.initial, value) for p, value in own]
    return all(
        1.5 * (low - null) - 1e-9 <= value - null <= 1.5 * (high - null) + 1e-9 for (low, high), null, value in ranges
    )


def _variant(explanation: Explanation) -> str | None:
    parts = [
        f"{m.candidate.name}: form {m.form + 1} of {len(m.candidate.forms)}"
        for m in explanation.members
        if len(m.candidate.forms) > 1
    ]
    return "; ".join(parts) or None


def _detectability(d: Diagnosis, explanation: Explanation) -> float | None:
    known = d.confounding.detectability
    return min((known[name] for name in explanation.names if name in known), default=None)


def effect_size(d: Diagnosis) -> dict[str, Any]:
    """Change of the force [N] that a finding makes under each tendon alone: by posture, mount and load.

    Returns:
        `curves`: for each posture, mount and tendon the loads [g], the change's norm [N], and its 95 % band.
    """
    fit, session = d.best, d.session
    observations, model = session.observations, session.model
    set_up = zip(observations.postures, observations.locations, strict=True)
    places = dict.fromkeys((posture, location) for posture, location in set_up if posture)
    cases = [
        PlannedReading(posture, location, {muscle: mass * level})
        for posture, location in places
        for muscle, mass in largest_loads(d).items()
        for level in _LEVELS
    ]
    theta, covariance, index = fit.parameter_posterior(fit.best)
    own = list(fit.explanation.parameters)
    at = np.flatnonzero(np.isin(index, own))
    rng = np.random.default_rng(SEED)
    drawn = rng.normal(size=(_DRAWS, len(at))) @ root_of(covariance[np.ix_(at, at)]).T
    table, scale = model.parameters, session.problem.scale
    vectors = [theta]
    for draw in drawn:
        moved = theta.copy()
        moved[index[at]] += draw * scale[index[at]]
        vectors.append(np.clip(moved, table.lower, table.upper))
    planned, changes = CaseChanges(model, inputs_of(d, cases)), np.zeros((len(vectors), len(cases)))
    for k, vector in enumerate(vectors):
        without = vector.copy()
        without[own] = table.initial[own]
        change = planned.readings(vector) - planned.readings(without)
        changes[k] = np.linalg.norm(change[:, :3], axis=1)
    low, high = np.quantile(changes[1:], [0.025, 0.975], axis=0)
    levels = len(_LEVELS)
    return {
        "curves": [
            {
                "posture": cases[k].posture,
                "location": cases[k].location,
                "muscle": next(iter(cases[k].masses_g)),
                "load_g": [next(iter(c.masses_g.values())) for c in cases[k : k + levels]],
                "change_N": changes[0, k : k + levels].tolist(),
                "low_N": low[k : k + levels].tolist(),
                "high_N": high[k : k + levels].tolist(),
            }
            for k in range(0, len(cases), levels)
        ]
    }
