"""Slips of the pen: what a load case may have been instead of what was entered.

A slip keeps the reading and changes the entry: another tendon, mass, posture or mount, two cases exchanged, a window of
the recording that holds something else. Each predicts a reading; a bad case of which nothing is known does not.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import jax
import numpy as np

from daq.vocabulary import OTHER_MOUNT
from fingermodel.arrays import Floats
from fingermodel.comparison.observations import Observations
from fingermodel.diagnosis.settings import LEVER_MM, SLIP_SHARES
from fingermodel.model import Model

Kind = Literal["tendon", "mass", "unloaded", "kept", "posture", "mount", "exchanged", "window", "amount"]

# No lever in a finger is longer [mm].
LONGEST_MM = 10.0 * LEVER_MM
# Factors by which a mass is entered wrongly in another unit, or with its decimal point in another place.
_UNITS = {
    1000.0: "kg were entered for g",
    10.0: "a digit is lacking",
    0.1: "a digit is too many",
}


@dataclass(frozen=True, eq=False)
class Slip:
    """One way in which a case may not be what was entered."""

    kind: Kind  # of slip
    words: str  # what was done instead
    masses_g: Mapping[str, float]  # that hung
    posture: str  # in which
    tension: Floats  # (muscles,) [N]
    like: int  # index of a case in that posture, whose setting is taken
    sign: float = 1.0  # of the reading: 0 where the tare holds the load too, -1 where tare and load are exchanged
    partner: int | None = None  # index of the case that it is exchanged with
    location: str | None = None  # of the cell; None where it was as entered
    open_Nmm: float = 0.0  # how large the moments may be of which it predicts nothing
    share: float = 0.0  # of this slip among all that can happen to the case


class PossibleSlips:
    """All slips of a session's cases, and the readings that they predict.

    Args:
        model: that predicts readings.
        observations: of the cases, as they were entered.
    """

    def __init__(self, model: Model, observations: Observations) -> None:
        self._model, self._observations = model, observations
        self.muscles = model.finger.topology.muscles
        self._tension = np.asarray(observations.inputs.tension)
        self._first = {name: observations.postures.index(name) for name in observations.posture_angles}
        self._weights = sorted({g for masses in observations.masses_g for g in masses.values()})
        self._known: dict[int, list[Slip]] = {}

    def of(self, case: int) -> list[Slip]:
        """Every slip of a case, their shares set; none of a check."""
        if case not in self._known:
            slips = [] if self._observations.roles[case] == "check" else list(self._all(case))
            alike = Counter(slip.kind for slip in slips)
            self._known[case] = [replace(s, share=SLIP_SHARES[s.kind] / alike[s.kind]) for s in slips]
        return self._known[case]

    def changes(self, slips: Sequence[tuple[int, Slip]], theta: Floats) -> Floats:
        """(k, 6) reading under each slip less that under the entry [N, N mm], given as (case, slip)."""
        if not slips:
            return np.zeros((0, 6))
        inputs = self._observations.inputs
        cases, like = np.array([c for c, _ in slips]), np.array([s.like for _, s in slips])
        done, other = inputs.rows(cases), inputs.rows(like)
        moved = np.array([s.location is not None for _, s in slips])
        tension, at_bone = np.array([s.tension for _, s in slips]), np.asarray(done.at_bone) ^ moved
        really = done._replace(
            posture=other.posture,
            setting=other.setting,
            tension=jax.device_put(tension),
            at_bone=jax.device_put(at_bone),
        )
        changed, sign = np.array(self._model.predict(really, theta).reading), np.array([s.sign for _, s in slips])
        turn = np.linalg.inv(self._observations.to_other_mount[cases[moved]])
        changed[moved] = (turn @ changed[moved, :, None])[..., 0]
        return sign[:, None] * changed - np.asarray(self._model.predict(inputs, theta).reading)[cases]

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
            for value, why in self._masses(grams).items():
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
        place = self._observations.locations[case]
        elsewhere = OTHER_MOUNT[place]
        lever = LONGEST_MM if elsewhere == "bone" else 0.0
        words = at_other_mount(place)
        pulled_N = float(self._tension[case].sum())
        yield hung("mount", words, loaded, location=elsewhere, open_Nmm=lever * pulled_N)
        yield hung("window", "the tare was taken with the weight on", loaded, sign=0.0)
        yield hung("window", "tare and load were exchanged", loaded, sign=-1.0)
        yield from self._exchanges(case)

    def _masses(self, grams: float) -> dict[float, str]:
        """Masses that may have hung where this one was entered, and why if they are none of those in use."""
        out = dict.fromkeys((weight for weight in self._weights if weight > 0.0), "")
        for factor, why in _UNITS.items():
            out.setdefault(grams * factor, f" ({why})")
        for value in _turned(grams):
            out.setdefault(value, " (digits exchanged)")
        return {value: why for value, why in out.items() if value != grams}

    def _exchanges(self, case: int) -> Iterator[Slip]:
        o = self._observations
        for other, name in enumerate(o.ids):
            if o.roles[other] == "check" or o.locations[other] != o.locations[case]:
                continue
            masses, tension = o.masses_g[other], self._tension[other]
            same_loads, same_posture = masses == o.masses_g[case], o.postures[other] == o.postures[case]
            if not (same_loads and same_posture):
                words = f"exchanged with {name}"
                yield Slip("exchanged", words, masses, o.postures[other], tension, other, 1.0, other)
            if not (same_loads or same_posture):
                words = f"the loads were exchanged with those of {name}"
                yield Slip("exchanged", words, masses, o.postures[case], tension, case, 1.0, other)


def at_other_mount(entered: str) -> str:
    """Say that the cell was at the other mount."""
    return f"the cell was at the {OTHER_MOUNT[entered]}, not the {entered}"


def _turned(grams: float) -> list[float]:
    """The same number with two neighbouring digits exchanged."""
    text = f"{grams:g}"
    if not text.isdigit():
        return []
    return [float(text[:k] + text[k + 1] + text[k] + text[k + 2 :]) for k in range(len(text) - 1) if text[k + 1] != "0"]
