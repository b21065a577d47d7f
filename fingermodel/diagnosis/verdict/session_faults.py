"""Faults of a whole session, as explanations of their own: its labels or units put right, and the base model fitted.

Two tendons exchanged throughout, the side mirrored, the sign of an angle, a unit, one mount's gain. Each is one way
in which what was entered differs from what was done in every case at once.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
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
from fingermodel.diagnosis.session_model.bad_cases import gain_if_bad
from fingermodel.diagnosis.session_model.candidates import NOTHING, Candidates
from fingermodel.diagnosis.session_model.session import Session, session_of
from fingermodel.diagnosis.settings import GAIN_SPREAD, P_FAULT, SURE, SUSPECT

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
# Faults that are fitted, of those that bring the readings nearest to the finger as it was measured.
_FITTED = 3
# What readings miss by may be this share of them, whatever the fault, when faults are put in order.
_SHARE = 0.1


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


def put_right(candidates: Candidates, nothing: Optimum) -> list[PutRight]:
    """Put faults of the whole session right, one at a time, and fit the base model again.

    Args:
        candidates: of the diagnosis.
        nothing: the base model of the session as it was entered.
    """
    session = nothing.session
    by_balance = list(_frames(session))
    offers = list(_corrected(session)) + ([] if by_balance else [_turned(session.observations)])
    missed = {offer: _missed(session, offer.observations) for offer in offers}
    as_entered = _missed(session, session.observations)
    nearest = [offer for offer in sorted(offers, key=lambda o: missed[o]) if missed[offer] < as_entered]
    counts = Counter(o.kind for o in offers)
    return [
        PutRight(o.kind, o.words, _log_share(counts[o.kind]) + _log_posterior(session, candidates, nothing, o))
        for o in [*by_balance, *nearest[:_FITTED]]
    ]


def session_faults(found: Sequence[PutRight], posterior: Posterior) -> list[SessionFault]:
    """Weigh faults of the whole session against everything that was found without them.

    Args:
        found: of `put_right`.
        posterior: of the session as entered.

    Returns:
        What is more probable than not, most probable first.
    """
    gains = list(_gains(posterior))
    found = [*found, *(PutRight("gain", words, _log_share(len(gains)) + log) for words, log in gains)]
    # As a slip in one case it is weighed by the whole likelihood, not by a power of it.
    as_it_is = [fit.log_posterior for fit in posterior.fits.values()]
    total = float(logsumexp([*as_it_is, *(f.log_posterior for f in found)]))
    out = [SessionFault(f.kind, f.words, float(np.exp(f.log_posterior - total))) for f in found]
    return sorted((f for f in out if f.probability >= SUSPECT), key=lambda f: -f.probability)


def outdoes(found: Sequence[PutRight], log_posterior: float) -> bool:
    """Whether a fault is sure whatever may act, if nothing that acts has a higher log posterior than this."""
    return any(f.log_posterior - log_posterior > logit(SURE) for f in found)


def _log_share(alike: int) -> float:
    """Log prior of a fault: each kind is as probable as any other, and so is each fault of its kind."""
    return float(np.log(P_FAULT / len(get_args(Kind)) / max(alike, 1)))


def _log_posterior(session: Session, candidates: Candidates, nothing: Optimum, offer: _Corrected) -> float:
    """Of the base model with a fault put right, and of one effect beside it; without the fault's share."""
    other = session_of(session.model, offer.observations, session.plane)
    other = replace(other, problem=replace(other.problem, free=session.problem.free))
    fitter = Fitter(other, candidates, nothing.hyper)
    first = fitter.fit(NOTHING, session.problem.centre, nothing.hyper.start(0))
    again = replace(fitter, session=other.seen_from(first.theta))
    base = again.fit(NOTHING, first.theta, first.mode)
    alone = base.log_posterior + offer.log_density
    if alone < nothing.log_posterior:
        return alone
    # An effect may act as well: the one that the base promises most.
    node = base.hyper.without_smooth(base.best)
    promised = base.promises(candidates.singles, [base.best, node])
    best = candidates.singles[int(np.argmax(promised + [candidates.log_prior(e) for e in candidates.singles]))]
    beside = again.fit(best, base.expected(best, node), node)
    return float(np.logaddexp(alone, beside.log_posterior + offer.log_density))


def _missed(session: Session, observations: Observations) -> float:
    """Misfit of the fitted readings to the finger as it was measured, coarsely weighed."""
    rows = session.rows[session.fitted]
    inputs = observations.inputs
    predicted = np.asarray(session.model.predict(inputs, session.problem.centre).reading).reshape(-1)[rows]
    measured = np.nan_to_num(observations.wrench).reshape(-1)[rows]
    moment, entered = session.places.moment[session.fitted], session.measured[session.fitted]
    size = np.array([np.sqrt(np.mean(entered[moment == m] ** 2)) if (moment == m).any() else 1.0 for m in (0, 1)])
    width = np.maximum(_SHARE * size, 1e-9)[moment.astype(int)]
    # Heavy tails: a few cases that miss by much say no more than a few that miss.
    return float(np.log1p(((measured - predicted) / width) ** 2).sum())


def _gains(posterior: Posterior) -> Iterator[tuple[str, float]]:
    """Log posterior of another gain of either mount alone, beside the base model; without the fault's share."""
    nothing, session = posterior.nothing, posterior.nothing.session
    observations, rows = session.observations, session.rows[session.fitted]
    predicted = np.asarray(session.model.predict(observations.inputs, nothing.theta).reading).reshape(-1)[rows]
    for place in dict.fromkeys(observations.locations):
        at = np.array([p == place for p in observations.locations])[rows // 6]
        if not at.any() or at.all():
            continue
        information, score = nothing.asked((predicted * at)[:, None], nothing.best)
        width = GAIN_SPREAD
        gain = float(gain_if_bad(information[:, None] * width**2, score * width))
        value = 1.0 + float(score[0] / (information[0] + width**-2))
        yield f"the cell at the {place} has a gain of {value:.2f}", nothing.log_posterior + gain


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
    yield from _angles(session)
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


def _angles(session: Session) -> Iterator[_Corrected]:
    """One angle of one posture with the other sign; all angles of a posture in radians."""
    o = session.observations
    angles, rotations = np.asarray(o.inputs.posture), session.model.finger.topology.rotations
    for name, posture in o.posture_angles.items():
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
