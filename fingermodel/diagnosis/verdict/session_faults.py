"""Faults of a whole session, as explanations of their own: its labels or units put right, and the base model fitted.

Two tendons exchanged throughout, the side mirrored, the sign of an angle, a unit, one mount's gain. Each is one way
in which what was entered differs from what was done in every case at once.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Literal, get_args

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from fingermodel.comparison.observations import Observations
from fingermodel.diagnosis.model_free.frames import rig_mistake
from fingermodel.diagnosis.posterior.fitting import Fitter
from fingermodel.diagnosis.posterior.marginals import Posterior, weighed
from fingermodel.diagnosis.session_model.bad_cases import gain_if_bad
from fingermodel.diagnosis.session_model.candidates import NOTHING, Candidates
from fingermodel.diagnosis.session_model.session import Session, session_of
from fingermodel.diagnosis.settings import GAIN_SPREAD, P_FAULT, SUSPECT

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


@dataclass(frozen=True, eq=False)
class _Corrected:
    """The session with one fault put right."""

    kind: Kind
    words: str
    observations: Observations
    # Log of how many times less a unit of the readings is than one of those stated, summed over those fitted.
    log_density: float = 0.0


def session_faults(session: Session, candidates: Candidates, posterior: Posterior) -> list[SessionFault]:
    """Weigh faults of the whole session against everything that was found without them.

    Args:
        session: as it was entered.
        candidates: of the diagnosis.
        posterior: of the session as entered.

    Returns:
        What is more probable than not, most probable first.
    """
    offers, gains = list(_corrected(session)), list(_gains(session, posterior))
    # Each kind is as probable as any other, and so is each fault of its kind.
    counts = Counter([o.kind for o in offers] + [kind for (kind, _), _ in gains])
    share = {k: float(np.log(P_FAULT / len(get_args(Kind)) / max(counts[k], 1))) for k in get_args(Kind)}
    found = [(g, share[g[0]] + log) for g, log in gains]
    missed = {offer: _missed(session, offer.observations) for offer in offers}
    as_entered = _missed(session, session.observations)
    nearest = [offer for offer in sorted(offers, key=lambda o: missed[o]) if missed[offer] < as_entered]
    found += [
        ((offer.kind, offer.words), share[offer.kind] + _log_weight(session, candidates, posterior, offer))
        for offer in [*_frames(session), *nearest[:_FITTED]]
    ]
    total = float(logsumexp([posterior.log_norm, *(log for _, log in found)]))
    out = [SessionFault(kind, words, float(np.exp(log - total))) for (kind, words), log in found]
    return sorted((f for f in out if f.probability >= SUSPECT), key=lambda f: -f.probability)


def _log_weight(session: Session, candidates: Candidates, posterior: Posterior, offer: _Corrected) -> float:
    """Log weight of the base model with a fault put right, and of one effect beside it; without the fault's share."""
    other = session_of(session.model, offer.observations, session.plane)
    other = replace(other, problem=replace(other.problem, free=session.problem.free))
    nothing = posterior.nothing
    fitter = Fitter(other, candidates, nothing.hyper)
    first = fitter.fit(NOTHING, session.problem.centre, nothing.hyper.start(0))
    again = replace(fitter, session=other.seen_from(first.theta))
    base = again.fit(NOTHING, first.theta, first.mode)
    alone = weighed(base.log_posterior + offer.log_density, base.log_prior)
    if alone < posterior.weight(nothing):
        return alone
    # An effect may act as well: the one that the base promises most.
    node = base.hyper.without_smooth(base.best)
    promised = base.promises(candidates.singles, [base.best, node])
    best = candidates.singles[int(np.argmax(promised + [candidates.log_prior(e) for e in candidates.singles]))]
    beside = again.fit(best, base.expected(best, node), node)
    return float(np.logaddexp(alone, weighed(beside.log_posterior + offer.log_density, beside.log_prior)))


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


def _gains(session: Session, posterior: Posterior) -> Iterator[tuple[tuple[Kind, str], float]]:
    """Log weight of another gain of either mount alone, beside the base model; without the fault's share."""
    nothing = posterior.nothing
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
        words = f"the cell at the {place} has a gain of {value:.2f}"
        yield ("gain", words), weighed(nothing.log_posterior + gain, nothing.log_prior)


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
