"""Slips of the pen: what a load case may have been instead of what was entered, and how well that explains its reading.

A slip keeps the reading and changes the entry: another tendon, mass or posture, two cases exchanged, a window of
the recording that holds something else. Each predicts a reading; a bad case of which nothing is known does not.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal, Protocol

import jax
import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from fingermodel.comparison.observations import Observations
from fingermodel.diagnosis.session_model.bad_cases import LOG_PRIOR_ODDS, Apart
from fingermodel.diagnosis.session_model.session import Session
from fingermodel.diagnosis.settings import AMOUNT, FORM_SCALE, P_TAIL, SLIP_SHARES
from fingermodel.model import Model

Floats = NDArray[np.float64]
Kind = Literal["tendon", "mass", "unloaded", "kept", "posture", "exchanged", "window", "amount"]

# Factors by which a mass is entered wrongly in another unit, or with its decimal point in another place.
_UNITS = {
    1000.0: "kg were entered for g",
    10.0: "a digit is lacking",
    0.1: "a digit is too many",
}


@dataclass(frozen=True, eq=False)
class Slip:
    """One way in which a case may not be what was entered.

    Attributes:
        kind: of slip.
        words: what was done instead.
        masses_g: that hung.
        posture: in which.
        tension: (muscles,) [N].
        like: index of a case in that posture, whose setting is taken.
        sign: of the reading: 0 where the tare holds the load too, -1 where tare and load are exchanged.
        partner: index of the case that it is exchanged with.
        share: of this slip among all that can happen to the case.
    """

    kind: Kind
    words: str
    masses_g: Mapping[str, float]
    posture: str
    tension: Floats
    like: int
    sign: float = 1.0
    partner: int | None = None
    share: float = 0.0


@dataclass(frozen=True)
class Explained:
    """How probable each slip is, given that the case is bad.

    Attributes:
        gain: log evidence gained over a bad case of which nothing is known.
        is_slip: probability that the case stands apart by a slip, and not by the tail of the noise.
        slips: with their probability and chi-square, the most probable first; one whose `kind` is amount among them.
    """

    gain: float
    is_slip: float
    slips: tuple[tuple[Slip, float, float], ...]

    @property
    def partner(self) -> int | None:
        """The case that this one is more probably exchanged with than not."""
        slip, probability, _ = self.slips[0] if self.slips else (None, 0.0, 0.0)
        return slip.partner if slip is not None and probability >= 0.5 else None


class Entered(Protocol):
    """Cases as they were entered, with the model of what each would read."""

    @property
    def model(self) -> Model:
        """That predicts readings."""

    @property
    def observations(self) -> Observations:
        """Of the cases."""


class PossibleSlips:
    """All slips of a session's cases, and the readings that they predict.

    Args:
        entered: the cases.
    """

    def __init__(self, entered: Entered) -> None:
        model, observations = entered.model, entered.observations
        self._model, self._observations = model, observations
        self.muscles = model.finger.topology.muscles
        self._tension = np.asarray(observations.inputs.tension)
        self._first = {name: observations.postures.index(name) for name in observations.posture_angles}
        self._weights = sorted({g for masses in observations.masses_g for g in masses.values()})
        self._known: dict[int, list[Slip]] = {}

    def of(self, case: int) -> list[Slip]:
        """Every slip of a case, their shares set; none of a check."""
        if case not in self._known:
            self._known[case] = self._shared(case)
        return self._known[case]

    def _shared(self, case: int) -> list[Slip]:
        if self._observations.roles[case] == "check":
            return []
        by_kind: dict[Kind, list[Slip]] = {}
        for slip in self._all(case):
            by_kind.setdefault(slip.kind, []).append(slip)
        return [
            replace(slip, share=SLIP_SHARES[kind] / len(slips)) for kind, slips in by_kind.items() for slip in slips
        ]

    def changes(self, slips: Sequence[tuple[int, Slip]], theta: Floats) -> Floats:
        """(k, 6) reading under each slip less that under the entry [N, N mm], given as (case, slip)."""
        if not slips:
            return np.zeros((0, 6))
        inputs = self._observations.inputs
        cases, like = np.array([c for c, _ in slips]), np.array([s.like for _, s in slips])
        done, other = inputs.rows(cases), inputs.rows(like)
        tension = jax.device_put(np.array([s.tension for _, s in slips]))
        changed = self._model.predict(
            done._replace(posture=other.posture, setting=other.setting, tension=tension), theta
        )
        sign = np.array([s.sign for _, s in slips])[:, None]
        return sign * np.asarray(changed.reading) - np.asarray(self._model.predict(inputs, theta).reading)[cases]

    def _all(self, case: int) -> Iterator[Slip]:
        masses, posture = self._observations.masses_g[case], self._observations.postures[case]
        loaded = {m: g for m, g in masses.items() if g > 0.0}
        weight = float(np.asarray(self._observations.inputs.weight)[case])

        def hung(kind: Kind, words: str, new: Mapping[str, float], **more: object) -> Slip:
            tension = np.array([new.get(m, 0.0) * weight for m in self.muscles])
            return Slip(kind, words, dict(new), posture, tension, case, **more)  # type: ignore[arg-type]

        for muscle, grams in loaded.items():
            rest = {m: g for m, g in loaded.items() if m != muscle}
            for other in self.muscles:
                if other not in loaded:
                    yield hung("tendon", f"{other} was loaded, not {muscle}", {**rest, other: grams})
            for value, why in self._masses(grams):
                yield hung("mass", f"{muscle} bore {value:g} g, not {grams:g} g{why}", {**rest, muscle: value})
            if rest:
                yield hung("unloaded", f"{muscle} was not loaded", rest)
        if len(loaded) == 2:
            (a, x), (b, y) = loaded.items()
            if x != y:
                yield hung("tendon", f"the weights of {a} and {b} were exchanged", {a: y, b: x})
        if case > 0:
            before = {m: g for m, g in self._observations.masses_g[case - 1].items() if g > 0.0 and m not in loaded}
            if before:
                still = " and ".join(f"{m} {g:g} g" for m, g in before.items())
                yield hung("kept", f"{still} still hung from the case before", {**loaded, **before})
        for name, index in self._first.items():
            if name != posture:
                yield Slip(
                    "posture", f"the posture was {name}, not {posture}", loaded, name, self._tension[case], index
                )
        yield hung("window", "the tare was taken with the weight on", loaded, sign=0.0)
        yield hung("window", "tare and load were exchanged", loaded, sign=-1.0)
        yield from self._exchanges(case)

    def _masses(self, grams: float) -> Iterator[tuple[float, str]]:
        """Masses that may have hung where this one was entered."""
        seen = {grams}
        for value in self._weights:
            if value > 0.0 and value not in seen:
                seen.add(value)
                yield value, ""
        turned = _turned(grams)
        units = [(grams * factor, f" ({why})") for factor, why in _UNITS.items()]
        for value, why in [*units, *((v, " (digits exchanged)") for v in turned)]:
            if value not in seen:
                seen.add(value)
                yield value, why

    def _exchanges(self, case: int) -> Iterator[Slip]:
        o = self._observations
        for other in range(len(o.ids)):
            alike = o.masses_g[other] == o.masses_g[case] and o.postures[other] == o.postures[case]
            if o.roles[other] != "check" and o.locations[other] == o.locations[case] and not alike:
                words = f"exchanged with {o.ids[other]}"
                yield Slip(
                    "exchanged", words, o.masses_g[other], o.postures[other], self._tension[other], other, 1.0, other
                )


class Slips(PossibleSlips):
    """The same, to be weighed against readings that may be anything.

    Args:
        session: whose cases.
    """

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self.session = session

    def about(self, theta: Floats) -> SlipsAbout:
        """Weigh them about a parameter vector (parameters,)."""
        return SlipsAbout(self, theta)


@dataclass(frozen=True, eq=False)
class SlipsAbout:
    """Slips whose readings are predicted about one parameter vector; each is predicted once, when it is asked for.

    Attributes:
        slips: of a session.
        theta: (parameters,).
    """

    slips: Slips
    theta: Floats
    _known: dict[Slip, Floats] = field(default_factory=dict, repr=False)

    def explain(self, apart: Mapping[int, Apart], scatter: float) -> dict[int, Explained]:
        """Weigh every slip of some cases against a reading that may be anything.

        Args:
            apart: the cases, by index; a case may be exchanged with any of these only.
            scatter: of the tensions from case to case, relative.
        """
        if not apart:
            return {}
        pairs = [
            (case, slip)
            for case in apart
            for slip in self.slips.of(case)
            if slip.partner is None or slip.partner in apart
        ]
        changes, owners = self._changes(pairs), np.array([case for case, _ in pairs], dtype=np.intp)
        gains, misfits = np.empty(len(pairs)), np.empty(len(pairs))
        for case, one in apart.items():
            own = owners == case
            gains[own], misfits[own], _ = _gains(one, changes[own][:, one.rows], scatter)
        weighed = list(zip(pairs, gains.tolist(), misfits.tolist(), strict=True))
        found: dict[int, list[tuple[Slip, float, float]]] = {case: [] for case in apart}
        for (case, slip), gain, chi in weighed:
            if slip.partner is None:
                found[case].append((slip, float(np.log(slip.share)) + gain, chi))
        for case in apart:
            found[case] += self._amounts(apart[case], scatter)
        # Whatever else may have happened to a case, by itself: of two that are exchanged this is no longer to be paid.
        alone = {
            case: float(np.logaddexp(0.0, LOG_PRIOR_ODDS + _all_together(apart[case], slips)))
            for case, slips in found.items()
        }
        swapped = {(case, slip.partner): gain for (case, slip), gain, _ in weighed if slip.partner is not None}
        for (case, slip), gain, chi in weighed:
            if slip.partner is not None:
                both = gain + swapped[slip.partner, case] - alone[slip.partner]
                found[case].append((slip, float(np.log(slip.share)) + both, chi))
        return {case: _weighed(apart[case], slips) for case, slips in found.items()}

    def _changes(self, pairs: Sequence[tuple[int, Slip]]) -> Floats:
        """(k, 6) reading under each slip less that under the entry [N, N mm]."""
        new = [(case, slip) for case, slip in pairs if slip not in self._known]
        self._known.update(zip((slip for _, slip in new), self.slips.changes(new, self.theta), strict=True))
        return np.array([self._known[slip] for _, slip in pairs]).reshape(-1, 6)

    @cached_property
    def _along(self) -> Floats:
        """(cases, 6, muscles) change of every reading by the logarithm of each tension."""
        return self.slips.session.changes.by_tension(self.theta)

    def _amounts(self, apart: Apart, scatter: float) -> Iterator[tuple[Slip, float, float]]:
        """Another load on a tendon that was loaded, whatever it was: a weight that slipped, stuck or was another."""
        o, case = self.slips.session.observations, apart.case
        muscles, tension = self.slips.muscles, np.asarray(o.inputs.tension)[case]
        loaded = {m: g for m, g in o.masses_g[case].items() if g > 0.0}
        for muscle, grams in loaded.items():
            column = self._along[case][apart.rows, muscles.index(muscle)]
            solved = np.linalg.solve(apart.covariance, column)
            amount = float(solved @ apart.away) / (float(column @ solved) + AMOUNT**-2)
            if amount <= -1.0 or not column.any():
                continue
            found, (chi,), (grown,) = _gains(apart, amount * column[None, :], scatter)
            # What is lost by not having said beforehand how much it would be.
            spread = max(float(column @ np.linalg.solve(grown, column)), 0.0) * AMOUNT**2
            gain = float(found[0]) - 0.5 * (amount / AMOUNT) ** 2 - 0.5 * float(np.log1p(spread))
            value = float(f"{grams * (1.0 + amount):.2g}")
            words = f"{muscle} bore about {value:g} g, not {grams:g} g"
            share = SLIP_SHARES["amount"] / len(loaded)
            slip = Slip("amount", words, {**loaded, muscle: value}, o.postures[case], tension, case, share=share)
            yield slip, float(np.log(share)) + gain, float(chi)


def _turned(grams: float) -> list[float]:
    """The same number with two neighbouring digits exchanged."""
    text = f"{grams:g}"
    if not text.isdigit():
        return []
    return [float(text[:k] + text[k + 1] + text[k] + text[k + 2 :]) for k in range(len(text) - 1) if text[k + 1] != "0"]


def _gains(apart: Apart, changes: Floats, scatter: float) -> tuple[Floats, Floats, Floats]:
    """Log evidence (k,) gained by changes (k, L) of the prediction, chi-squares (k,) left, and covariances (k, L, L).

    The prediction of another load is as uncertain as the form of an effect, and scatters as the loads do.
    """
    moment = apart.rows >= 3
    sizes = np.where(
        moment, (changes[:, moment] ** 2).sum(axis=1)[:, None], (changes[:, ~moment] ** 2).sum(axis=1)[:, None]
    )
    grown = apart.covariance + (scatter**2 + FORM_SCALE**2) * sizes[:, :, None] * np.eye(len(moment))
    left = apart.away - changes
    after = (left * np.linalg.solve(grown, left[..., None])[..., 0]).sum(axis=1)
    determinants = np.linalg.slogdet(apart.covariance)[1] - np.linalg.slogdet(grown)[1]
    return 0.5 * (apart.misfit - after + determinants), after, grown


def _all_together(apart: Apart, slips: Sequence[tuple[Slip, float, float]]) -> float:
    """Log evidence gained over a sound case by a bad one, whatever has happened to it."""
    logs = [float(np.log(SLIP_SHARES["anything"])) + apart.anything, *(log for _, log, _ in slips)]
    return float(np.logaddexp.reduce(logs))


def _weighed(apart: Apart, slips: Sequence[tuple[Slip, float, float]]) -> Explained:
    total = _all_together(apart, slips)
    order = sorted(((s, float(np.exp(log - total)), chi) for s, log, chi in slips), key=lambda e: -e[1])
    is_slip = float(expit(LOG_PRIOR_ODDS + total - np.log(P_TAIL) - apart.tail))
    return Explained(total - apart.anything, is_slip, tuple(order))
