"""What may have been entered wrongly in many cases alike, and the session with it put right.

Tendons or postures exchanged, the side mirrored, an angle's sign, a unit, the axes, the tare, weights.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations, groupby, permutations
from typing import Literal

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from fingermodel.comparison.observations import Observations
from fingermodel.diagnosis.model_free.frames import rig_mistake
from fingermodel.diagnosis.session_model.session import Session
from fingermodel.diagnosis.settings import AMOUNT, GAIN_SPREAD, LEAST_AMOUNT

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
Kind = Literal["tendon_labels", "side", "posture", "mass_unit", "axes", "unit", "gain", "weight", "tare"]

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
# Postures, changes of posture or mount, and weights, from which on they are not looked at: there would be too many.
_MOST_BLOCKS = 20
# A wrench of the other hand.
_MIRROR = np.array([1.0, 1.0, -1.0, -1.0, -1.0, 1.0])


@dataclass(frozen=True)
class Amend:
    """One amendment of a block of cases.

    Attributes:
        cases: the block, as `daq.sessions.amendments.block_of` has it.
        tendons: the tendon that bore a weight, by the one that was entered.
        posture: that was really set; None where it was as entered.
    """

    cases: str
    tendons: dict[str, str] = field(default_factory=dict)
    posture: str | None = None


@dataclass(frozen=True, eq=False)
class Factor:
    """A number that is another than was entered: a mount's gain, or what one weight weighs.

    Attributes:
        saying: what is said of it; the value goes into the braces.
        entered: the value then.
        value: by which it is another.
        spread: standard deviation of its prior about 1.
        least: how far from 1 it is at least.
        acts: (cases, muscles) on which tensions, or (cases, 1) on which readings.
    """

    saying: str
    entered: float
    value: float
    spread: float
    least: float
    acts: Mask

    @property
    def words(self) -> str:
        """What is said of it."""
        return self.saying.format(self.entered * self.value)

    @property
    def kind(self) -> Kind:
        """Of the fault that it is."""
        return "weight" if self.acts.shape[1] > 1 else "gain"

    @property
    def cases(self) -> Mask:
        """(cases,) in which of them it acts."""
        out: Mask = np.any(self.acts, axis=1)
        return out

    @property
    def counts(self) -> bool:
        """Whether it is far enough from what was entered, and no less than nothing."""
        return self.value > 0.0 and abs(self.value - 1.0) >= self.least


@dataclass(frozen=True, eq=False)
class Corrected:
    """The session with one fault put right.

    Attributes:
        kind: of fault.
        words: what was done instead of what was entered.
        observations: with it put right.
        away: (n,) readings less the model then [N, N mm], in units of the readings as they were entered.
        log_density: log of how many times less a unit of the readings is than one of those stated, summed over those
            fitted.
        factor: by which something is another than was entered, where that is a number that the readings tell.
        amend: amendments that put it right; none where amendments cannot.
    """

    kind: Kind
    words: str
    observations: Observations
    away: Floats
    log_density: float = 0.0
    factor: Factor | None = None
    amend: tuple[Amend, ...] = ()


@dataclass(frozen=True, eq=False)
class Entries:
    """A session's entries, held against the model at some parameters.

    Attributes:
        session: as it was entered.
        theta: (parameters,).
    """

    session: Session
    theta: Floats

    @cached_property
    def away(self) -> Floats:
        """(n,) readings less the model, as they were entered [N, N mm]."""
        return self._residual(self.session.observations)

    def corrected(self) -> Iterator[Corrected]:
        """Every fault of labels and units that changes how well the readings are explained."""
        o = self.session.observations
        yield from self._tendons()
        yield from self._postures()
        yield from self._angles()
        yield self._one("side", "the side is the other one (readings are mirrored)", _mirrored(o))
        yield from self._tares()
        yield from self._weights()
        for unit, grams in _UNITS_G.items():
            tension = np.asarray(o.inputs.tension) * grams
            yield self._one("mass_unit", f"masses are in {unit}", _with(o, tension=tension))

    def frames(self) -> Iterator[Corrected]:
        """Axes exchanged or turned round, or another unit of the readings, where balance shows it."""
        o = self.session.observations
        mistake = rig_mistake(self.session.model, o)
        if mistake is not None:
            words = f"{mistake.words[0].upper()}{mistake.words[1:]}"
            density = float(self.session.fitted.sum() * np.log(mistake.factor))
            kind: Kind = "unit" if mistake.unit else "axes"
            yield replace(self._one(kind, words, mistake.put_right(o)), log_density=density)

    def turned(self) -> Corrected:
        """Forces on the finger, entered as those that it exerts; balance shows that where both mounts were read."""
        o = self.session.observations
        words = "the readings are what the cell exerts on the finger: every sign is turned"
        return self._one("axes", words, replace(o, wrench=-o.wrench))

    def factors(self) -> list[Factor]:
        """What may be another by any factor: the gain of either mount, and each weight, on one tendon or all."""
        o, out = self.session.observations, list[Factor]()
        places = dict.fromkeys(np.array(o.locations)[self.session.rows[self.session.fitted] // 6])
        for place in places if len(places) > 1 else ():
            words = f"the cell at the {place} has a gain of {{:.2f}}"
            out.append(Factor(words, 1.0, 1.0, GAIN_SPREAD, 0.0, of_label(o.locations, place)[:, None]))
        muscles, mass_g = self.session.model.finger.topology.muscles, self._mass_g
        for weight in self._weights_g:
            hangs = mass_g == weight
            on = np.flatnonzero(hangs.any(axis=0)).tolist()
            words = f"the weight of {weight:g} g{{}} weighs {{{{:.0f}}}} g"
            out.append(Factor(words.format(""), weight, 1.0, AMOUNT, LEAST_AMOUNT, hangs))
            for m in on if len(on) > 1 else ():
                alone = hangs & (np.arange(len(muscles)) == m)
                out.append(Factor(words.format(f" on {muscles[m]}"), weight, 1.0, AMOUNT, LEAST_AMOUNT, alone))
        return out

    def columns(self, factors: Sequence[Factor], theta: Floats) -> Floats:
        """(n, k) change of the fitted readings per unit of a further relative change of each, at some parameters."""
        session, out = self.session, list[Floats]()
        reading = session.readings(theta)
        by_tension = session.by_tension(theta) if any(f.kind == "weight" for f in factors) else None
        for factor in factors:
            acts = factor.acts
            if by_tension is None or factor.kind == "gain":
                changed = reading * acts
            else:
                changed = (by_tension * acts[:, None, :]).sum(axis=2)
            out.append(changed.reshape(-1)[session.rows[session.fitted]])
        return np.array(out).T

    def with_factor(self, factor: Factor) -> Corrected:
        """The session with something by a factor another than was entered."""
        o = self.session.observations
        if factor.kind == "weight":
            tension = np.where(factor.acts, factor.value, 1.0) * np.asarray(o.inputs.tension)
            return replace(self._one(factor.kind, "", _with(o, tension=tension)), factor=factor)
        by_case = np.where(factor.acts[:, 0], 1.0 / factor.value, 1.0)
        noise = o.noise.turned(by_case[:, None, None] * np.eye(6))
        here = factor.acts[self.session.rows // 6, 0]
        density = -float((here & self.session.fitted).sum() * np.log(factor.value))
        found = self._one(factor.kind, "", replace(o, wrench=o.wrench * by_case[:, None], noise=noise))
        away = np.where(here, factor.value, 1.0) * found.away
        return replace(found, away=away, log_density=density, factor=factor)

    def _one(self, kind: Kind, words: str, observations: Observations) -> Corrected:
        return Corrected(kind, words, observations, self._residual(observations))

    def _residual(self, observations: Observations) -> Floats:
        predicted = np.asarray(self.session.model.predict(observations.inputs, self.theta).reading)
        out: Floats = (np.nan_to_num(observations.wrench) - predicted).reshape(-1)[self.session.rows]
        return out

    def _tendons(self) -> Iterator[Corrected]:
        """Two tendons exchanged in all cases, in those of a mount or a posture, or from a change of either on."""
        o, muscles = self.session.observations, self.session.model.finger.topology.muscles
        tension, settings = np.asarray(o.inputs.tension), list(zip(o.postures, o.locations, strict=True))
        places = {"all": ("throughout", np.ones(len(settings), dtype=bool))}
        places |= {name: (f"in {name}", of_label(o.postures, name)) for name in self._used}
        places |= {p: (f"at the {p}", of_label(o.locations, p)) for p in o.locations}
        changes = [k for k in range(1, len(settings)) if settings[k] != settings[k - 1]]
        for k in changes if len(changes) <= _MOST_BLOCKS else ():
            places[f"{o.ids[k]}.."] = f"from {o.ids[k]} on", np.arange(len(settings)) >= k
        loaded = set(np.flatnonzero(tension.any(axis=0)).tolist())
        for a, b in combinations(range(len(muscles)), 2):
            if loaded & {a, b}:
                order, (one, other) = np.arange(len(muscles)), (muscles[a], muscles[b])
                order[[a, b]] = b, a
                exchanged, words = tension[:, order], f"{one} and {other} were exchanged"
                away, swap = self._residual(_with(o, tension=exchanged)), {one: other, other: one}
                for named, (where, here) in places.items():
                    amend = (Amend(named, swap),)
                    yield self._block("tendon_labels", f"{words} {where}", here, away, amend, tension=exchanged)

    def _postures(self) -> Iterator[Corrected]:
        """Two postures exchanged throughout; one that was another, in all its cases, at a mount, or once."""
        o, angles = self.session.observations, self.session.observations.posture_angles
        cases = {name: of_label(o.postures, name) for name in self._used}
        everywhere = {name: np.tile(angles[name], (len(o.ids), 1)) for name in cases}
        away = {name: self._residual(_with(o, posture=set_to)) for name, set_to in everywhere.items()}
        of_row = self.session.rows // 6
        for a, b in combinations(cases, 2):
            both, swap = np.logical_or(cases[a], cases[b]), (Amend(a, posture=b), Amend(b, posture=a))
            mixed = np.where(cases[a][of_row], away[b], away[a])
            exchanged = np.where(cases[a][:, None], everywhere[b], everywhere[a])
            words = f"{a} and {b} were exchanged throughout"
            yield self._block("posture", words, both, mixed, swap, posture=exchanged)
        for name, done in permutations(cases, 2):
            blocks = {"": (name, cases[name])}
            for p in dict.fromkeys(o.locations):
                blocks[f" at the {p}"] = f"{name},{p}", np.logical_and(cases[name], of_label(o.locations, p))
            blocks |= self._set_once.get(name, {})
            for where, (named, here) in blocks.items():
                words, amend = f"the posture was {done}, not {name}{where}", (Amend(named, posture=done),)
                yield self._block("posture", words, here, away[done], amend, posture=everywhere[done])

    @cached_property
    def _used(self) -> list[str]:
        """Postures of the cases; none where they are so many that a block of cases is hardly more than one."""
        names = [
            name for name in self.session.observations.posture_angles if name in self.session.observations.postures
        ]
        return names if len(names) <= _MOST_BLOCKS else []

    @cached_property
    def _set_once(self) -> dict[str, dict[str, tuple[str, Mask]]]:
        """Cases for which the finger was set up once, by posture and words, with the name of their block.

        Of postures that were set more than once at a mount.
        """
        o, out = self.session.observations, dict[str, dict[str, tuple[str, Mask]]]()
        each = list(zip(o.postures, o.locations, np.asarray(o.inputs.setting).tolist(), strict=True))
        stretches = [list(alike) for _, alike in groupby(range(len(each)), each.__getitem__)]
        times = Counter(each[cases[0]][:2] for cases in stretches)
        for cases in stretches if len(stretches) <= _MOST_BLOCKS else ():
            posture, place, _ = each[cases[0]]
            if times[posture, place] > 1:
                first, last = o.ids[cases[0]], o.ids[cases[-1]]
                here = f"{first}..{last}", np.isin(np.arange(len(each)), cases)
                out.setdefault(posture, {})[f" from {first} to {last}"] = here
        return out

    def _block(
        self, kind: Kind, words: str, here: Mask, away: Floats, amend: tuple[Amend, ...], **changed: Floats
    ) -> Corrected:
        """Change `tension` or `posture` (cases, k) in some cases; `away` (n,) is what all readings miss then."""
        o = self.session.observations
        columns = {n: np.where(here[:, None], new, np.asarray(getattr(o.inputs, n))) for n, new in changed.items()}
        there = np.where(here[self.session.rows // 6], away, self.away)
        return Corrected(kind, words, _with(o, **columns), there, amend=amend)

    def _angles(self) -> Iterator[Corrected]:
        """One angle of one posture with the other sign; all angles of one posture, or of every one, in radians."""
        o, rotations = self.session.observations, self.session.model.finger.topology.rotations
        angles = np.asarray(o.inputs.posture)
        for name, posture in o.posture_angles.items():
            here = of_label(o.postures, name)
            for k in np.flatnonzero(posture):
                turned = angles.copy()
                turned[here, k] *= -1.0
                words = f"{rotations[k]} in {name} has the other sign ({-np.rad2deg(posture[k]):g}°)"
                yield self._one("posture", words, _with(o, posture=turned))
            if 0.0 < np.rad2deg(np.abs(posture).max()) < np.pi:
                turned = np.where(here[:, None], np.rad2deg(angles), angles)
                yield self._one("posture", f"the angles of {name} are in radians", _with(o, posture=turned))
        if len(o.posture_angles) > 1 and 0.0 < np.rad2deg(np.abs(angles).max()) < np.pi:
            words = "the angles of all postures are in radians"
            yield self._one("posture", words, _with(o, posture=np.rad2deg(angles)))

    def _weights(self) -> Iterator[Corrected]:
        """Two weights exchanged throughout."""
        o, mass_g = self.session.observations, self._mass_g
        for a, b in [(a, b) for a, b in combinations(self._weights_g, 2) if b / a - 1.0 >= LEAST_AMOUNT]:
            factor = np.where(mass_g == a, b / a, np.where(mass_g == b, a / b, 1.0))
            words = f"the weights of {a:g} g and {b:g} g were exchanged throughout"
            yield self._one("weight", words, _with(o, tension=factor * np.asarray(o.inputs.tension)))

    @cached_property
    def _weights_g(self) -> list[float]:
        """Masses in use; none where they are so many that a weight hangs in hardly more than one case."""
        used = np.unique(self._mass_g[self._mass_g > 0.0]).tolist()
        return used if len(used) <= _MOST_BLOCKS else []

    @cached_property
    def _mass_g(self) -> Floats:
        """(cases, muscles) that hangs on each tendon."""
        muscles, masses = self.session.model.finger.topology.muscles, self.session.observations.masses_g
        return np.array([[of_case.get(m, 0.0) for m in muscles] for of_case in masses])

    def _tares(self) -> Iterator[Corrected]:
        """Readings that were tared already when the tare was taken away; one tare of each mount for all its cases."""
        o = self.session.observations
        if not o.tared.any():
            return
        words = "the readings were tared already, and the tare was taken away twice"
        yield self._one("tare", words, replace(o, wrench=o.wrench + o.tared))
        first = np.array([o.tared[o.locations.index(place)] for place in o.locations])
        if not np.allclose(first, o.tared):
            again = replace(o, wrench=o.wrench + o.tared - first)
            yield self._one("tare", "one tare of each mount serves all its cases", again)


def of_label(labels: Sequence[str], label: str) -> Mask:
    """(cases,) which of them have a label."""
    return np.array([one == label for one in labels])


def _with(observations: Observations, **columns: Floats) -> Observations:
    """The same readings of other loads or postures."""
    inputs = observations.inputs._replace(**{name: jnp.asarray(column) for name, column in columns.items()})
    return replace(observations, inputs=inputs)


def _mirrored(observations: Observations) -> Observations:
    """The readings of the other hand."""
    turn = np.tile(np.diag(_MIRROR), (len(observations.ids), 1, 1))
    return replace(observations, wrench=observations.wrench * _MIRROR, noise=observations.noise.turned(turn))
