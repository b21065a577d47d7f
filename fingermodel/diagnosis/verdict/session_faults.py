"""Faults of a whole session, as explanations of their own: its labels or units put right, and the base model fitted.

Two tendons exchanged throughout, the side mirrored, the sign of an angle, a unit, one mount's gain. Each is one way
in which what was entered differs from what was done in every case at once.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Literal, get_args

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy.special import logit, logsumexp

from fingermodel.comparison.observations import Observations
from fingermodel.diagnosis.model_free.frames import rig_mistake
from fingermodel.diagnosis.posterior.fitting import Fitter
from fingermodel.diagnosis.posterior.marginals import Posterior
from fingermodel.diagnosis.posterior.optimum import Optimum
from fingermodel.diagnosis.session_model.candidates import NOTHING, Candidates, Explanation
from fingermodel.diagnosis.session_model.session import Session, session_of
from fingermodel.diagnosis.settings import GAIN_SPREAD, P_FAULT, SURE, SUSPECT
from fingermodel.diagnosis.verdict.predictive import PredictiveCheck, check

Floats = NDArray[np.float64]
Kind = Literal["tendon_labels", "side", "posture", "mass_unit", "axes", "unit", "gain", "tare"]

# Masses in another unit: what one that was entered as a gram is in grams.
_UNITS_G = {
    "kilograms": 1000.0,
    "pounds": 453.592,
    "ounces": 28.3495,
    "newtons": 101.972,
    "milligrams": 1e-3,
    "grams, ten times too many": 0.1,
    "grams, ten times too few": 10.0,
}
# A wrench of the other hand.
_MIRROR = np.array([1.0, 1.0, -1.0, -1.0, -1.0, 1.0])
# Faults that are fitted, of those that promise most.
_FITTED = 3


@dataclass(frozen=True)
class SessionFault:
    """A fault of the whole session.

    Attributes:
        kind: of fault.
        words: what was done instead of what was entered.
        probability: that it is so.
    """

    kind: Kind
    words: str
    probability: float


@dataclass(frozen=True)
class PutRight:
    """How well the readings are explained with one fault put right.

    Attributes:
        kind: of fault.
        words: what was done instead of what was entered.
        log_posterior: of the base model, and of one effect beside it; the fault's own prior included.
    """

    kind: Kind
    words: str
    log_posterior: float


@dataclass(frozen=True, eq=False)
class _Corrected:
    """The session with one fault put right."""

    kind: Kind
    words: str
    observations: Observations
    # Log of how many times less a unit of the readings is than one of those stated, summed over those fitted.
    log_density: float = 0.0
    # The mount whose readings were divided by a gain, and that gain.
    gain: tuple[str, float] | None = None


def put_right(candidates: Candidates, nothing: Optimum) -> list[PutRight]:
    """Put faults of the whole session right, one at a time, and fit the base model again.

    Those that balance shows are all fitted; of the others, those that promise most where the finger is as measured.

    Args:
        candidates: of the diagnosis.
        nothing: the base model of the session as it was entered.
    """
    session, hyper = nothing.session, nothing.hyper
    as_measured = Fitter(session, candidates, hyper).linearised(
        NOTHING, session.problem.centre, hyper.usual, frozenset(), 0.0, converged=True
    )
    by_balance = list(_frames(session))
    offers = [*_corrected(session), *_gains(as_measured), *([] if by_balance else [_turned(session.observations)])]
    away = np.array([_residual(session, session.observations), *(_as_stated(session, offer) for offer in offers)])
    # What readings miss the finger by as it was measured may be taken for noise or something smooth as well.
    nodes = {hyper.usual, nothing.best, hyper.with_smooth(nothing.best)}
    as_entered, *values = np.max([as_measured.log_joints_of(away.T, node) for node in nodes], axis=0)
    counts = Counter(o.kind for o in [*offers, *by_balance])
    prior = {kind: _log_share(count) for kind, count in counts.items()}
    promised = {o: prior[o.kind] + value for o, value in zip(offers, values, strict=True)}
    best = [o for o in sorted(offers, key=lambda o: -promised[o]) if promised[o] > as_entered]
    return [_fitted(session, candidates, nothing, o, prior[o.kind]) for o in [*by_balance, *best[:_FITTED]]]


def session_faults(found: Sequence[PutRight], posterior: Posterior) -> list[SessionFault]:
    """Weigh faults of the whole session against everything that was found without them.

    Args:
        found: of `put_right`.
        posterior: of the session as entered.

    Returns:
        What is more probable than not, most probable first.
    """
    # As a slip in one case it is weighed by the whole likelihood, not by a power of it.
    as_it_is = [fit.log_posterior for fit in posterior.fits.values()]
    return _probable(found, [f.log_posterior for f in found], as_it_is)


def unseen_postures(
    candidates: Candidates, posterior: Posterior, checked: Mapping[Explanation, PredictiveCheck]
) -> list[SessionFault]:
    """Faults of postures that only validation cases use, by how well these are predicted once one is put right.

    Args:
        candidates: of the diagnosis.
        posterior: of the session as entered.
        checked: validation cases as entered, by explanation, the most probable one among them.

    Returns:
        As `session_faults`; none where the cases are as the most probable explanation predicts them.
    """
    leader = posterior.leader
    session, as_entered = leader.session, checked[leader.explanation]
    if not (as_entered.vetoes or as_entered.bad):
        return []
    offers = list(_angles(session, _postures(session, ~session.fitted) - _postures(session, session.fitted)))
    values = []
    for offer in offers:
        fitter = Fitter(_with_readings(session, offer.observations).seen_from(leader.theta), candidates, leader.hyper)
        again = fitter.linearised(
            leader.explanation, leader.theta, leader.node, leader.bad, leader.log_prior, converged=True
        )
        values.append(posterior.weight(leader) + check(again).log_evidence + _log_share(len(offers)))
    rest = [posterior.weights[e] + c.log_evidence for e, c in checked.items()]
    return _probable(offers, values, rest)


def outdoes(found: Sequence[PutRight], log_posterior: float) -> bool:
    """Whether a fault is sure whatever may act, if nothing that acts has a higher log posterior than this."""
    return any(f.log_posterior - log_posterior > logit(SURE) for f in found)


def _probable(
    found: Sequence[PutRight | _Corrected], log_posterior: Sequence[float], rest: Sequence[float]
) -> list[SessionFault]:
    """Faults that are more probable than not, most probable first; `rest` are log posteriors without any fault."""
    total = float(logsumexp([*rest, *log_posterior]))
    out = [SessionFault(f.kind, f.words, float(np.exp(v - total))) for f, v in zip(found, log_posterior, strict=True)]
    return sorted((f for f in out if f.probability >= SUSPECT), key=lambda f: -f.probability)


def _with_readings(session: Session, observations: Observations) -> Session:
    """The session with other observations of the same cases."""
    other = session_of(session.model, observations, session.plane)
    return replace(other, problem=replace(other.problem, free=session.problem.free))


def _log_share(alike: int) -> float:
    """Log prior of a fault: each kind is as probable as any other, and so is each fault of its kind."""
    return float(np.log(P_FAULT / len(get_args(Kind)) / max(alike, 1)))


def _fitted(
    session: Session, candidates: Candidates, nothing: Optimum, offer: _Corrected, log_share: float
) -> PutRight:
    """Fit the base model with a fault put right, and one effect beside it."""
    other = _with_readings(session, offer.observations)
    fitter = Fitter(other, candidates, nothing.hyper)
    first = fitter.fit(NOTHING, session.problem.centre, nothing.hyper.start(0))
    again = replace(fitter, session=other.seen_from(first.theta))
    best = again.fit(NOTHING, first.theta, first.mode)
    alone = log_posterior = best.log_posterior
    if alone + offer.log_density >= nothing.log_posterior:
        # An effect may act as well: the one that the base promises most.
        node = best.hyper.without_smooth(best.best)
        promised = best.promises(candidates.singles, [best.best, node])
        single = candidates.singles[int(np.argmax(promised + [candidates.log_prior(e) for e in candidates.singles]))]
        beside = again.fit(single, best.expected(single, node), node)
        log_posterior = float(np.logaddexp(alone, beside.log_posterior))
        best = max(best, beside, key=lambda fit: fit.log_posterior)
    words, log_gain = offer.words, 0.0
    if offer.gain:
        words, log_gain = _regained(best, *offer.gain)
    return PutRight(offer.kind, words, log_share + offer.log_density + log_posterior + log_gain)


def _residual(session: Session, observations: Observations) -> Floats:
    """(n,) fitted readings less the finger as it was measured [N, N mm]."""
    predicted = np.asarray(session.model.predict(observations.inputs, session.problem.centre).reading)
    out: Floats = (np.nan_to_num(observations.wrench) - predicted).reshape(-1)[session.rows[session.fitted]]
    return out


def _as_stated(session: Session, offer: _Corrected) -> Floats:
    """The same with a fault put right, in the units of the readings as they were entered."""
    away = _residual(session, offer.observations)
    if offer.gain is None:
        return away
    place, gain = offer.gain
    return np.where(_read_at(session, place), gain * away, away)


def _read_at(session: Session, place: str) -> NDArray[np.bool_]:
    """(n,) which fitted readings are of a mount."""
    here: NDArray[np.bool_] = np.array(session.observations.locations)[session.rows[session.fitted] // 6] == place
    return here


def _gains(fit: Optimum) -> Iterator[_Corrected]:
    """Another gain of either mount alone, where the readings want it most about a fit."""
    o, fitted = fit.session.observations, fit.session.fitted
    density = Counter(np.array(o.locations)[fit.session.rows[fitted] // 6].tolist())
    for place in density if len(density) > 1 else ():
        information, score = fit.asked(_of_mount(fit, place), fit.node)
        gain = 1.0 + float(score[0] / (information[0] + GAIN_SPREAD**-2))
        if gain <= 0.0:
            continue
        factor = np.where(np.array(o.locations) == place, 1.0 / gain, 1.0)
        noise = o.noise.turned(factor[:, None, None] * np.eye(6))
        right = replace(o, wrench=o.wrench * factor[:, None], noise=noise)
        yield _Corrected("gain", "", right, -density[place] * float(np.log(gain)), (place, gain))


def _regained(fit: Optimum, place: str, gain: float) -> tuple[str, float]:
    """A gain about which a session was fitted: in words, and the log of its prior summed over what it may be."""
    information, score = (float(value[0]) for value in fit.asked(_of_mount(fit, place), fit.best))
    # The gain is what it was taken for times 1 + w; its prior is N(1, GAIN_SPREAD²).
    mean, precision = (1.0 - gain) / gain, (gain / GAIN_SPREAD) ** 2
    best = (score + mean * precision) / (information + precision)
    log = 0.5 * (best**2 * (information + precision) - mean**2 * precision - np.log1p(information / precision))
    return f"the cell at the {place} has a gain of {gain * (1.0 + best):.2f}", float(log)


def _of_mount(fit: Optimum, place: str) -> Floats:
    """(n, 1) fitted readings of one mount as predicted at a fit, and 0 for the other."""
    session = fit.session
    rows = session.rows[session.fitted]
    predicted = np.asarray(session.model.predict(session.observations.inputs, fit.theta).reading).reshape(-1)[rows]
    return (predicted * _read_at(session, place))[:, None]


def _corrected(session: Session) -> Iterator[_Corrected]:
    o, muscles = session.observations, session.model.finger.topology.muscles
    tension = np.asarray(o.inputs.tension)
    loaded = np.flatnonzero(tension.any(axis=0))
    for a, b in combinations(loaded.tolist(), 2):
        order = np.arange(len(muscles))
        order[[a, b]] = b, a
        words = f"{muscles[a]} and {muscles[b]} were exchanged throughout"
        yield _Corrected("tendon_labels", words, _with(o, tension=tension[:, order]))
    yield _Corrected("side", "the side is the other one (readings are mirrored)", _mirrored(o))
    yield from _angles(session, _postures(session, session.fitted))
    yield from _tares(session)
    for unit, grams in _UNITS_G.items():
        yield _Corrected("mass_unit", f"masses are in {unit}", _with(o, tension=tension * grams))


def _tares(session: Session) -> Iterator[_Corrected]:
    """Readings that were tared already when the tare was taken away, or one tare of each mount for all its cases."""
    o = session.observations
    if not o.tared.any():
        return
    yield _Corrected(
        "tare",
        "the readings were tared already, and the tare was taken away twice",
        replace(o, wrench=o.wrench + o.tared),
    )
    first = np.array([o.tared[o.locations.index(place)] for place in o.locations])
    if not np.allclose(first, o.tared):
        again = replace(o, wrench=o.wrench + o.tared - first)
        yield _Corrected("tare", "one tare of each mount serves all its cases", again)


def _frames(session: Session) -> Iterator[_Corrected]:
    """Axes exchanged or turned round, or another unit of the readings, where balance shows it."""
    mistake = rig_mistake(session.model, session.observations)
    if mistake is not None:
        words = f"{mistake.words[0].upper()}{mistake.words[1:]}"
        density = float(session.fitted.sum() * np.log(mistake.factor))
        yield _Corrected("unit" if mistake.unit else "axes", words, mistake.put_right(session.observations), density)


def _turned(observations: Observations) -> _Corrected:
    """Forces on the finger, entered as those that it exerts: what balance shows only where both mounts were read."""
    words = "the readings are what the cell exerts on the finger: every sign is turned"
    return _Corrected("axes", words, replace(observations, wrench=-observations.wrench))


def _postures(session: Session, chosen: NDArray[np.bool_]) -> set[str]:
    """Names of the postures of some readings (n,)."""
    return {session.observations.postures[case] for case in session.rows[chosen] // 6}


def _angles(session: Session, names: Collection[str]) -> Iterator[_Corrected]:
    """One angle of one of some postures with the other sign; all its angles in radians."""
    o = session.observations
    angles, rotations = np.asarray(o.inputs.posture), session.model.finger.topology.rotations
    for name, posture in o.posture_angles.items():
        if name not in names:
            continue
        here = np.array([p == name for p in o.postures])
        for k, rotation in enumerate(rotations):
            if posture[k] != 0.0:
                turned = angles.copy()
                turned[here, k] *= -1.0
                words = f"{rotation} in {name} has the other sign ({-np.rad2deg(posture[k]):g}°)"
                yield _Corrected("posture", words, _with(o, posture=turned))
        if 0.0 < np.rad2deg(np.abs(posture).max()) < np.pi:
            turned = np.where(here[:, None], np.rad2deg(angles), angles)
            yield _Corrected("posture", f"the angles of {name} are in radians", _with(o, posture=turned))


def _with(observations: Observations, **columns: Floats) -> Observations:
    """The same readings of other loads or postures."""
    inputs = observations.inputs._replace(**{name: jnp.asarray(column) for name, column in columns.items()})
    return replace(observations, inputs=inputs)


def _mirrored(observations: Observations) -> Observations:
    """The readings of the other hand."""
    turn = np.tile(np.diag(_MIRROR), (len(observations.ids), 1, 1))
    return replace(observations, wrench=observations.wrench * _MIRROR, noise=observations.noise.turned(turn))
