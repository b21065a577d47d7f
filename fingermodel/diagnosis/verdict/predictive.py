"""Predictive check: how well an explanation predicts the validation cases, which are never fitted."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import chdtrc, expit, logit, logsumexp

from fingermodel.arrays import Floats, Ints
from fingermodel.comparison.comparison import rmse
from fingermodel.diagnosis.posterior.hyper import Node
from fingermodel.diagnosis.posterior.marginals import Posterior
from fingermodel.diagnosis.posterior.optimum import Optimum
from fingermodel.diagnosis.session_model.bad_cases import LOG_PRIOR_ODDS, Apart, Explained, SlipsAbout, chance_of
from fingermodel.diagnosis.session_model.candidates import Explanation
from fingermodel.diagnosis.session_model.session import Session
from fingermodel.diagnosis.settings import EVIDENCE_POWER, FORM_NAMED, P_UNLIKE, P_VALUE
from fingermodel.fitting.roots import root_of

# Hyperparameters and explanations count from this probability on.
_WEIGHT = 0.02
# So often the validation readings are linearised anew at most; and an error of that [N] which no reading notices.
_TIMES, _LINEAR_N = 4, 1e-3
_LOG_UNLIKE = float(np.log(P_UNLIKE))


@dataclass(frozen=True, eq=False)
class Prediction:
    """Some readings as an explanation predicts them, everything known of the rest taken into account."""

    away: Floats  # (n,) readings less their prediction [N, N mm]
    covariance: Floats  # (n, n) of it: noise, scatter, parameters, errors of form, something smooth
    cases: Ints  # (n,) case of each reading
    bad_size: Floats  # (n,) how far each may be off in a bad case [N, N mm]
    x: Floats  # (parameters,) where the rest has the parameters, in prior widths about the priors' centre
    free: Ints  # (k,) indices of those that are free
    across: Floats  # (k, n) covariance of these and the readings

    @property
    def with_readings(self) -> Floats:
        """(parameters,) where these readings have them as well; a case that stands apart says nothing of it."""
        factor, out = root_of(self.covariance + _spoilt(self, _standing_apart(self))), self.x.copy()
        out[self.free] += self.across @ np.linalg.solve(factor.T, np.linalg.solve(factor, self.away))
        return out


@dataclass(frozen=True)
class PredictiveCheck:
    """What the validation cases say of an explanation."""

    log_density: float | None  # of those that are not bad; None where there are none
    p_value: float | None  # that they would be missed so far; None where there are none
    bad: dict[int, float]  # log odds of the cases that are more probably bad than not, by index of the case
    slips: dict[int, Explained]  # what may have been done in these instead of what was entered
    missed: tuple[int, ...] = ()  # those that are not bad, and by themselves out of the question
    log_evidence: float = 0.0  # for the explanation by all of them, whichever are bad
    # Of them, with the weight of each node of the hyperparameters.
    predictions: tuple[tuple[float, Prediction], ...] = field(default=(), repr=False)

    @property
    def vetoes(self) -> bool:
        """Whether the explanation does not predict them."""
        return self.p_value is not None and self.p_value < P_VALUE

    def setting_apart(self, bad: dict[int, float], slips: dict[int, Explained]) -> PredictiveCheck:
        """The same with these cases for the bad ones."""
        if not self.predictions:
            return self
        cases = self.predictions[0][1].cases
        sound = ~np.isin(cases, list(bad))
        each = [(w, *log_normal(p.away[sound], p.covariance[np.ix_(sound, sound)])) for w, p in self.predictions]
        log_density = float(logsumexp([np.log(w) + log for w, log, _ in each]))
        # So many slips among so few cases are none either: then the explanation misses them.
        exchanged = {frozenset((c, s.partner)) for c, s in slips.items() if s.partner in bad}
        many = float(chance_of(len(bad) - len(exchanged), len(np.unique(cases))))
        p_value = min(sum(w * float(chdtrc(int(sound.sum()), misfit)) for w, _, misfit in each), many)
        missed = tuple(case for case in _standing_apart(self.predictions[0][1]) if case not in bad)
        return replace(self, log_density=log_density, p_value=p_value, bad=bad, slips=slips, missed=missed)


def log_normal(away: Floats, covariance: Floats) -> tuple[float, float]:
    """Log density and misfit of some readings (n,) under a covariance (n, n)."""
    factor = root_of(covariance)
    z = np.linalg.solve(factor, away)
    misfit = float(z @ z)
    return -0.5 * misfit - float(np.log(np.diag(factor)).sum()) - 0.5 * len(z) * float(np.log(2.0 * np.pi)), misfit


def predicted(
    fit: Optimum, node: Node | None = None, about: Floats | None = None, change: Floats | None = None
) -> Prediction:
    """Predict the validation readings at some hyperparameters, by default at the most probable ones.

    Args:
        fit: that predicts.
        node: of the hyperparameters.
        about: (parameters,) in prior widths about the priors' centre, where the readings are linearised; by default
            where the fit is.
        change: (cases, 6) of all readings by something that acts besides [N, N mm]; none by default.
    """
    node, about = node or fit.best, fit.x if about is None else about
    session, unseen = fit.session, ~fit.session.fitted
    reading, slopes = fit.unseen_about(about)
    measured, moved = session.measured, fit
    if change is not None:
        by_row = change.reshape(-1)[session.rows]
        measured, moved = measured - by_row, fit.but(residual=fit.residual - by_row[session.fitted])
    found = moved.everything(node)
    columns = np.concatenate([fit.block(name, unseen, slopes) for name in found.names], axis=1)
    index, at = found.parameters
    place = np.zeros(len(found.mean))
    place[at] = about[index]
    away = measured[unseen] - reading - columns @ (found.mean - place)
    # Tares that they share with fitted readings are known by what these leave.
    fitted, residual = moved.whitened_at(found.names, node)
    known, tares = moved.whitening(node) @ session.changes.tares[session.fitted], session.changes.tares[unseen]
    away -= tares @ (known.T @ (residual - fitted @ (found.mean - found.place)))
    values = fit.hyper.values(node)
    moving = columns - tares @ (known.T @ fitted)
    of_weights = moving @ found.covariance
    covariance = of_weights @ moving.T + tares @ (np.eye(tares.shape[1]) - known.T @ known) @ tares.T
    noise = session.noise_of(unseen)
    for rows, own in noise.covariances(values.errors, ()):
        covariance[rows[:, :, None], rows[:, None, :]] += own
    # Where nothing alike is fitted, an effect may be off by as much as its name allows.
    of_form = FORM_NAMED * fit.form_errors_unseen
    covariance += of_form @ of_form.T
    x, by_reading = about.copy(), of_weights.T[at]
    x[index] = found.mean[at]
    return Prediction(away, covariance, noise.cases, noise.bad_size, x, index, by_reading)


def _standing_apart(prediction: Prediction) -> list[int]:
    """Cases whose own readings are out of the question."""
    out = []
    for case in np.unique(prediction.cases).tolist():
        own = np.flatnonzero(prediction.cases == case)
        misfit = log_normal(prediction.away[own], prediction.covariance[np.ix_(own, own)])[1]
        if chdtrc(len(own), misfit) < P_VALUE:
            out.append(case)
    return out


def whereabouts(fit: Optimum) -> Floats:
    """(parameters,) about which the validation readings are linearised, in prior widths: where they lie themselves.

    The angles of a posture that no fitted case has are known by these readings alone. Of some steps, that is taken
    whose linearisation comes nearest to the model where it says that they lie.
    """
    session, problem, about = fit.session, fit.session.problem, fit.x
    lower, upper = ((limit - problem.centre) / problem.scale for limit in (problem.lower, problem.upper))
    unit, tried = session.changes.places.unit[~session.fitted], list[tuple[float, Floats]]()
    for _ in range(_TIMES):
        reading, slopes = fit.unseen_about(about)
        there = np.clip(predicted(fit, about=about).with_readings, lower, upper)
        off = (fit.unseen_about(there)[0] - reading - slopes @ (there - about)) / unit
        tried.append((float(np.abs(off).max()), about))
        if tried[-1][0] < _LINEAR_N:
            break
        about = there
    return min(tried, key=lambda one: one[0])[1]


def _predictions(fit: Optimum) -> tuple[tuple[float, Prediction], ...]:
    """Predict at the most probable hyperparameters, and at others as far as they are probable."""
    total = float(logsumexp(list(fit.nodes.values())))
    weights = {node: float(np.exp(value - total)) for node, value in fit.nodes.items()}
    kept = sorted((n for n, w in weights.items() if w >= _WEIGHT or n == fit.best), key=lambda n: -weights[n])
    whole, about = sum(weights[n] for n in kept), whereabouts(fit)
    return tuple((weights[n] / whole, predicted(fit, n, about)) for n in kept)


def check(fit: Optimum) -> PredictiveCheck:
    """Hold the validation cases against an explanation; single bad ones are set apart, and named."""
    session = fit.session
    if session.fitted.all():
        return PredictiveCheck(None, None, {}, {})
    predictions = _predictions(fit)
    p = predictions[0][1]
    about, scatter = SlipsAbout(session.changes, fit.theta), fit.hyper.values(fit.best).errors.scatter
    bad, strange = set[int](), set[int]()
    for _ in range(1 + len(np.unique(p.cases)) // 4):
        apart = bad | strange
        sound = _apart(session, p, apart, set(p.cases.tolist()) - apart)
        could = {case: one for case, one in sound.items() if one.misfit > -LOG_PRIOR_ODDS}
        found = about.explain(could, scatter)
        odds = {case: LOG_PRIOR_ODDS + could[case].anything + found[case].gain for case in could}
        unlike = {case: _LOG_UNLIKE + could[case].anything for case in could.keys() & session.unlike_fitted}
        either = {case: max(o, unlike.get(case, o)) for case, o in odds.items()}
        worst = max(either, key=lambda c: either[c], default=None)
        if worst is None or either[worst] < 0.0:
            break
        partner = found[worst].partner
        if either[worst] > odds[worst]:
            strange.add(worst)
        else:
            bad |= {worst} if partner is None else {worst, partner}
    # Held against one another while all seemed sound, bad cases make each other look worse, or better.
    while True:
        held = _apart(session, p, bad | strange, bad)
        explained = about.explain(held, scatter)
        odds = {case: _log_odds(session, held[case], explained[case].gain) for case in held}
        least = min(odds, key=lambda c: odds[c], default=None)
        if least is None or odds[least] >= 0.0:
            break
        bad.remove(least)
    log_density = _log_density(predictions, bad)
    if new := session.unlike_fitted - bad:
        log_density = float(np.logaddexp(log_density, _LOG_UNLIKE + _log_density(predictions, bad | new)))
    log_evidence = log_density + sum(LOG_PRIOR_ODDS + one.gain for one in explained.values())
    return PredictiveCheck(None, None, {}, {}, (), log_evidence, predictions).setting_apart(odds, explained)


def _log_density(predictions: Iterable[tuple[float, Prediction]], spoilt: Collection[int]) -> float:
    """Log density of all readings, of which those of some cases may be anything."""
    each = [np.log(w) + log_normal(p.away, p.covariance + _spoilt(p, spoilt))[0] for w, p in predictions]
    return float(logsumexp(each))


def _log_odds(session: Session, case: Apart, gain: float) -> float:
    """Log odds of a case to be bad, with what a slip gains over anything.

    In a case unlike any fitted one something may act that none of these shows: that is no fault of the case.
    """
    sound = float(np.logaddexp(0.0, _LOG_UNLIKE + case.anything)) if case.case in session.unlike_fitted else 0.0
    return LOG_PRIOR_ODDS + case.anything + gain - sound


def _spoilt(prediction: Prediction, bad: Collection[int]) -> Floats:
    """Covariance (n, n) by which the readings of bad cases may be off."""
    return np.diag(np.isin(prediction.cases, list(bad)) * prediction.bad_size**2)


def _apart(session: Session, prediction: Prediction, bad: Collection[int], cases: Collection[int]) -> dict[int, Apart]:
    """Some cases, each against all others, of which some are bad."""
    if not cases:
        return {}
    p, component = prediction, session.rows[~session.fitted] % 6
    inverse = np.linalg.inv(root_of(p.covariance + _spoilt(p, bad)))
    precision = inverse.T @ inverse
    score, out = precision @ p.away, {}
    for case in sorted(cases):
        at = np.flatnonzero(p.cases == case)
        out[case] = Apart.of(case, component[at], p.bad_size[at], precision[np.ix_(at, at)], score[at], bad=case in bad)
    return out


def checks(posterior: Posterior, chosen: Iterable[Optimum]) -> dict[Explanation, PredictiveCheck]:
    """Check some explanations; bad are cases that are so whichever explanation holds, all of them weighed.

    A case may be as one explanation expects it and a slip under another. How probable each is, it says itself.
    """
    out = {fit.explanation: check(fit) for fit in chosen}
    if not any(c.bad for c in out.values()):
        return out
    asked = out | {e: check(fit) for e, fit in posterior.fits.items() if e not in out}
    log = {e: posterior.weights[e] + EVIDENCE_POWER * c.log_evidence for e, c in asked.items()}
    top = float(logsumexp(list(log.values())))
    bad: dict[int, float] = {}
    slips: dict[int, Explained] = {}
    for case in dict.fromkeys(case for c in asked.values() for case in c.bad):
        p = [(float(np.exp(log[e] - top)), expit(c.bad.get(case, -np.inf)), c) for e, c in asked.items()]
        odds = float(logit(min(sum(weight * one for weight, one, _ in p), 1.0 - 1e-15)))
        if odds >= 0.0:
            bad[case] = odds
            slips[case] = max(p, key=lambda entry: entry[0] * entry[1])[2].slips[case]
    return {e: c.setting_apart(bad, slips) for e, c in out.items()}


def holding(posterior: Posterior, fit: Optimum) -> dict[Explanation, float]:
    """Explanations in which all candidates of a fit act, as far as they are probable, with their share; the fit's own.

    Where no candidate acts there is one such explanation.
    """
    names = set(fit.explanation.names)
    log = {e: posterior.weights[e] for e in posterior.fits if names <= set(e.names) and (names or not e.size)}
    total = float(logsumexp(list(log.values())))
    share = {e: float(np.exp(v - total)) for e, v in log.items()}
    kept = {e: w for e, w in share.items() if w >= _WEIGHT or e == fit.explanation}
    return {e: w / sum(kept.values()) for e, w in kept.items()}


def together(checked: Mapping[Explanation, PredictiveCheck], shares: Mapping[Explanation, float]) -> float | None:
    """Chance that the validation cases are missed so far by explanations with these shares; None without any."""
    each = [(share, checked[e].p_value) for e, share in shares.items()]
    known = [share * p for share, p in each if p is not None]
    return sum(known) if len(known) == len(each) else None


def unseen_errors(fit: Optimum, node: Node, change: Floats) -> dict[str, tuple[float, float]]:
    """RMSE [N] of the validation forces' components by mount, without and with a change of the readings.

    Args:
        fit: that predicts them.
        node: of the hyperparameters.
        change: (cases, 6) of all readings by something that acts besides [N, N mm].
    """
    session = fit.session
    if session.fitted.all():
        return {}
    observations = session.observations
    out: dict[str, tuple[float, float]] = {}
    unseen = session.rows[~session.fitted]
    force = unseen % 6 < 3
    before, after = predicted(fit, node).away, predicted(fit, node, change=change).away
    for place in dict.fromkeys(observations.locations):
        here = force & np.array([observations.locations[i] == place for i in unseen // 6])
        if here.any():
            out[place] = (rmse(before[here]), rmse(after[here]))
    return out
