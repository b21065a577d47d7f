"""What may have been entered wrongly in many cases alike, and the session with it put right.

Tendons, postures or mounts exchanged, the side mirrored, an angle's sign, a unit, the axes, the tare, weights.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations, permutations, product

import numpy as np

from daq.vocabulary import OTHER_MOUNT
from fingermodel.arrays import Floats, Mask
from fingermodel.comparison.observations import Observations
from fingermodel.diagnosis.model_free.frames import rig_mistake
from fingermodel.diagnosis.session_model.reading_changes import MOST_BLOCKS, of_label, postures_in_use, set_up_once
from fingermodel.diagnosis.session_model.session import Session
from fingermodel.diagnosis.session_model.slips import at_other_mount
from fingermodel.diagnosis.settings import LEAST_ANGLE_RAD
from fingermodel.diagnosis.verdict.changes import Amend, Change, Kind
from fingermodel.diagnosis.verdict.taken_for import (
    exchanged_columns,
    noise_at_most,
    read_at_other_mount,
    scaled,
    smooth_tares,
    with_inputs,
)

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
# What one that was entered as a newton millimetre is, by the unit.
_MOMENTS_NMM = {"in N mm": 1.0, "in N m": 1000.0, "in N cm": 10.0, "in kg mm": 9.80665}
# Cases that a slip changes at most: two, where they are exchanged. A fault of the session changes more.
OF_A_SLIP = 2
# Runs of rows, and cases from which on two tendons may have been exchanged, that are looked at.
_RUNS, _STARTS = 2, 3
# A wrench of the other hand.
_MIRROR = np.array([1.0, 1.0, -1.0, -1.0, -1.0, 1.0])


@dataclass(frozen=True, eq=False)
class Corrected:
    """The session with one fault put right."""

    kind: Kind  # of fault
    words: str  # what was done instead of what was entered
    observations: Observations  # with it put right
    away: Floats  # (n,) readings less the model then [N, N mm], in units of the readings as they were entered
    log_units: Floats  # (n,) log of how many times less a unit of each reading is than one of those stated
    change: Change | None = None  # that was put right, where the readings tell its amount
    amend: tuple[Amend, ...] = ()  # amendments that put it right; none where amendments cannot
    sound: Observations | None = None  # what it is held against; None for the session as it was entered

    @property
    def fault(self) -> str:
        """Which of its kind it is, whatever its amount."""
        return self.change.saying if self.change else self.words

    @property
    def again(self) -> frozenset[int]:
        """Cases to be measured again whatever they read: what their tare lacks is taken to scatter with their load."""
        if self.change is None or self.kind != "tare_weight":
            return frozenset()
        return frozenset(np.flatnonzero(self.change.cases).tolist())


@dataclass(frozen=True, eq=False)
class Entries:
    """A session's entries, held against the model at some parameters."""

    session: Session  # as it was entered
    theta: Floats  # (parameters,)

    @cached_property
    def away(self) -> Floats:
        """(n,) readings less the model, as they were entered [N, N mm]."""
        return self._residual(self.session.observations)

    def corrected(self) -> Iterator[Corrected]:
        """Every fault of labels and units that changes how well the readings are explained."""
        o = self.session.observations
        yield from self._tendons()
        yield from self._rows()
        yield from self._postures()
        yield from self._mounts()
        yield from self._angles()
        yield self._one("side", "the side is the other one (readings are mirrored)", scaled(o, _MIRROR))
        yield from self._moments()
        yield from self._tares()
        for unit, grams in _UNITS_G.items():
            tension = np.asarray(o.inputs.tension) * grams
            yield self._one("mass_unit", f"masses are in {unit}", with_inputs(o, tension=tension))

    def frames(self) -> Iterator[Corrected]:
        """Axes exchanged or turned round, or another unit of the readings, where balance shows it."""
        o = self.session.observations
        mistake = rig_mistake(self.session.model, o)
        if mistake is not None:
            words = f"{mistake.words[0].upper()}{mistake.words[1:]}"
            unit = np.full(len(self.session.rows), np.log(mistake.factor))
            kind: Kind = "unit" if mistake.unit else "axes"
            yield replace(self._one(kind, words, mistake.put_right(o)), log_units=unit)
            force = self.session.rows % 6 < 3
            if mistake.unit and not force.all():
                words = f"{words}. The moments are in the unit that is stated"
                of_forces = mistake.put_right(o, moments=False)
                yield replace(self._one(kind, words, of_forces), log_units=np.where(force, unit, 0.0))

    def signs(self) -> Iterator[Corrected]:
        """Forces of the other sign: all of them, or along one axis, at one mount or both.

        Where both mounts were read, balance shows those that are large.
        """
        o = self.session.observations
        words = "the readings are what the cell exerts on the finger: every sign is turned"
        yield self._one("axes", words, replace(o, wrench=-o.wrench))
        places = {"": ~of_label(o.roles, "check")}
        places |= {f" at the {mount}": of_label(o.locations, mount) for mount in dict.fromkeys(o.locations)}
        for (where, here), k in product(places.items(), range(3)):
            sign = np.where(here[:, None] & (np.arange(6) == k), -1.0, 1.0)
            yield self._one("axes", f"F{'xyz'[k]} has the other sign{where}", scaled(o, sign))

    def put_right(self, change: Change) -> Corrected:
        """The session with something by its amount another than was entered."""
        o, further = self.session.observations, change.amount * change.acts
        if change.kind == "zero":
            found = self._one(change.kind, change.words, replace(o, wrench=o.wrench - further))
            return replace(found, change=change)
        if change.kind != "gain":
            tension, posture = np.asarray(o.inputs.tension), np.asarray(o.inputs.posture)
            if change.kind == "posture":
                other = with_inputs(o, posture=posture + further)
            else:
                other = with_inputs(o, tension=tension - further if change.lacks else (1.0 + further) * tension)
            found = self._one(change.kind, change.words, other, change.amend)
            return replace(found, change=change if change.spread else None)
        here = 1.0 + further[self.session.rows // 6, 0]
        found = self._one(change.kind, change.words, scaled(o, 1.0 / (1.0 + further)))
        return replace(found, away=here * found.away, log_units=-np.log(here), change=change)

    def _one(self, kind: Kind, words: str, observations: Observations, amend: tuple[Amend, ...] = ()) -> Corrected:
        away = self._residual(observations)
        return Corrected(kind, words, observations, away, np.zeros(len(away)), amend=amend)

    def _residual(self, observations: Observations) -> Floats:
        predicted = np.asarray(self.session.model.predict(observations.inputs, self.theta).reading)
        return (np.nan_to_num(observations.wrench) - predicted).reshape(-1)[self.session.rows]

    def _by_case(self, away: Floats) -> Floats:
        """(cases,) sum of squares of readings less a model (n,), moments in units of their lever."""
        scaled = (away / self.session.changes.places.unit) ** 2
        return np.asarray(np.bincount(self.session.rows // 6, scaled, len(self.session.observations.ids)), dtype=float)

    def _tendons(self) -> Iterator[Corrected]:
        """Two tendons exchanged in all cases, in those of a mount or a posture, or from a case on."""
        o, muscles = self.session.observations, self.session.model.finger.topology.muscles
        tension, places = np.asarray(o.inputs.tension), {"all": ("throughout", np.ones(len(o.ids), dtype=bool))}
        places |= {name: (f"in {name}", of_label(o.postures, name)) for name in postures_in_use(o)}
        places |= {p: (f"at the {p}", of_label(o.locations, p)) for p in o.locations}
        loaded = set(np.flatnonzero(tension.any(axis=0)).tolist())
        for a, b in combinations(range(len(muscles)), 2):
            if loaded & {a, b}:
                one, other = muscles[a], muscles[b]
                exchanged, words = exchanged_columns(tension, a, b), f"{one} and {other} were exchanged"
                away, swap = self._residual(with_inputs(o, tension=exchanged)), {one: other, other: one}
                touched = np.flatnonzero((exchanged != tension).any(axis=1))
                less = np.cumsum((self._by_case(self.away) - self._by_case(away))[touched][::-1])[::-1]
                starts = [int(touched[k]) for k in np.argsort(-less[1:])[:_STARTS] + 1]
                further = {f"{o.ids[k]}..": (f"from {o.ids[k]} on", np.arange(len(o.ids)) >= k) for k in starts}
                for named, (where, here) in (places | further).items():
                    amend = (Amend(named, swap),)
                    yield self._block("tendon_labels", f"{words} {where}", here, away, amend, tension=exchanged)

    def _postures(self) -> Iterator[Corrected]:
        """Two postures exchanged, always or at a mount; one that was another, in all its cases, at a mount, or once."""
        o, angles = self.session.observations, self.session.observations.posture_angles
        cases = {name: of_label(o.postures, name) for name in postures_in_use(o)}
        everywhere = {name: np.tile(angles[name], (len(o.ids), 1)) for name in cases}
        away = {name: self._residual(with_inputs(o, posture=set_to)) for name, set_to in everywhere.items()}
        of_row, mounts = self.session.rows // 6, {p: of_label(o.locations, p) for p in o.locations}
        for a, b in combinations(cases, 2):
            both, swap = np.logical_or(cases[a], cases[b]), (Amend(a, posture=b), Amend(b, posture=a))
            mixed = np.where(cases[a][of_row], away[b], away[a])
            exchanged = np.where(cases[a][:, None], everywhere[b], everywhere[a])
            words = f"{a} and {b} were exchanged"
            yield self._block("posture", f"{words} throughout", both, mixed, swap, posture=exchanged)
            for p, here in mounts.items():
                there = tuple(replace(amend, cases=f"{amend.cases},{p}") for amend in swap)
                block = np.logical_and(both, here)
                yield self._block("posture", f"{words} at the {p}", block, mixed, there, posture=exchanged)
        for name, done in permutations(cases, 2):
            blocks = {"": (name, cases[name])}
            for p, here in mounts.items():
                blocks[f" at the {p}"] = f"{name},{p}", np.logical_and(cases[name], here)
            blocks |= self._set_once.get(name, {})
            for where, (named, here) in blocks.items():
                words, amend = f"the posture was {done}, not {name}{where}", (Amend(named, posture=done),)
                yield self._block("posture", words, here, away[done], amend, posture=everywhere[done])

    def _mounts(self) -> Iterator[Corrected]:
        """Cases that were read at the other mount: all, those of a posture, or some for which it was set once."""
        o, rows = self.session.observations, self.session.rows
        every = ~of_label(o.roles, "check")
        away = self._residual(read_at_other_mount(o, every))
        # Which moments there are at the bone nobody knows.
        away = np.where((rows % 6 >= 3) & of_label(o.locations, "tip")[rows // 6], 0.0, away)
        places = {"throughout": ("", every)}
        for name in postures_in_use(o):
            places[f"in {name}"] = f"{name},", of_label(o.postures, name)
        blocks = list[tuple[str, Mask, tuple[Amend, ...]]]()
        for where, (named, cases) in places.items():
            of_mount = {p: cases & of_label(o.locations, p) for p in dict.fromkeys(o.locations)}
            here = {p: moved for p, moved in of_mount.items() if moved.any()}
            amend = {p: Amend(f"{named}{p}", location=OTHER_MOUNT[p]) for p in here}
            blocks += [(f"{at_other_mount(p)}, {where}", moved, (amend[p],)) for p, moved in here.items()]
            if len(here) > 1:
                blocks.append((f"tip and bone were exchanged {where}", cases, tuple(amend.values())))
        for of_posture in self._set_once.values():
            for where, (named, moved) in of_posture.items():
                place = o.locations[int(np.argmax(moved))]
                blocks.append((f"{at_other_mount(place)},{where}", moved, (Amend(named, location=OTHER_MOUNT[place]),)))
        for words, moved, amendments in blocks:
            left = np.where(moved[rows // 6], away, self.away)
            yield Corrected("mount", words, read_at_other_mount(o, moved), left, np.zeros(len(rows)), amend=amendments)

    def _rows(self) -> Iterator[Corrected]:
        """Loads of some cases in a row entered one row too high or too low, as where one row was pasted elsewhere."""
        o, tension, found = self.session.observations, np.asarray(self.session.observations.inputs.tension), []
        for step in (1, -1):
            # What each case would be off less with the load that was entered for its neighbour.
            away = self._residual(with_inputs(o, tension=np.roll(tension, -step, axis=0)))
            less = self._by_case(self.away) - self._by_case(away)
            for alike in self._stretches:
                gain, first, last = _best_run(less[alike].tolist())
                ends = (first, last + 1) if step > 0 else (first - 1, last)
                found.append((gain, step, alike, *ends))
        for gain, step, alike, first, last in sorted(found, key=lambda of: -of[0])[:_RUNS]:
            # Where the finger is not as measured, a case at an end may gain by chance.
            every = product(range(first - 1, first + 2), range(last - 1, last + 2)) if gain > 0.0 else ()
            for begin, end in every:
                if 0 <= begin < end < len(alike):
                    yield self._moved(alike[begin : end + 1], step)

    def _moved(self, run: Sequence[int], step: int) -> Corrected:
        """Each load of some cases is that which was entered so many rows further."""
        o = self.session.observations
        tension, sources = np.array(o.inputs.tension), np.roll(run, -step).tolist()
        tension[run] = tension[sources]
        entries = [(o.ids[i], o.masses_g[i], o.masses_g[source]) for i, source in zip(run, sources, strict=True)]
        changed = [(case, dict.fromkeys(was, 0.0) | really) for case, was, really in entries if was != really]
        place = "low" if step > 0 else "high"
        words = f"from {o.ids[run[0]]} to {o.ids[run[-1]]} each load was entered one row too {place}"
        amend = tuple(Amend(case, masses_g=masses) for case, masses in changed)
        return self._one("rows", words, with_inputs(o, tension=tension), amend)

    @property
    def runs(self) -> int:
        """How many runs of rows may have been entered too high or too low."""
        return sum(len(alike) * (len(alike) - 1) for alike in self._stretches)

    @cached_property
    def _stretches(self) -> list[list[int]]:
        """Cases for which the finger was set up once, in their order; none where there are too many such stretches."""
        found = set_up_once(self.session.observations)
        return found if len(found) <= MOST_BLOCKS else []

    @cached_property
    def _set_once(self) -> dict[str, dict[str, tuple[str, Mask]]]:
        """Cases for which the finger was set up once, by posture and words, with the name of their block.

        Of postures that were set more than once at a mount.
        """
        o, out = self.session.observations, dict[str, dict[str, tuple[str, Mask]]]()
        times = Counter((o.postures[cases[0]], o.locations[cases[0]]) for cases in self._stretches)
        for cases in self._stretches:
            posture, place = o.postures[cases[0]], o.locations[cases[0]]
            if times[posture, place] > 1:
                first, last = o.ids[cases[0]], o.ids[cases[-1]]
                here = f"{first}..{last}", np.isin(np.arange(len(o.ids)), cases)
                out.setdefault(posture, {})[f" from {first} to {last}"] = here
        return out

    def _block(
        self, kind: Kind, words: str, here: Mask, away: Floats, amend: tuple[Amend, ...], **changed: Floats
    ) -> Corrected:
        """Change `tension` or `posture` (cases, k) in some cases; `away` (n,) is what all readings miss then."""
        o = self.session.observations
        columns = {n: np.where(here[:, None], new, np.asarray(getattr(o.inputs, n))) for n, new in changed.items()}
        there = np.where(here[self.session.rows // 6], away, self.away)
        return Corrected(kind, words, with_inputs(o, **columns), there, np.zeros(len(there)), amend=amend)

    def _angles(self) -> Iterator[Corrected]:
        """An angle with the other sign, or two exchanged; all angles in radians: of one posture, or of every one."""
        o, rotations = self.session.observations, self.session.model.finger.topology.rotations
        angles = np.asarray(o.inputs.posture)
        places = {name: of_label(o.postures, name) for name in o.posture_angles}
        if len(places) > 1:
            places["all postures"] = np.ones(len(angles), dtype=bool)
        for name, here in places.items():
            chosen = angles[here]
            bent = np.flatnonzero(chosen.any(axis=0)).tolist()
            done = {f"all angles of {name} have the other sign": -angles} if len(bent) > 1 else {}
            for k in bent:
                value = f" ({-np.rad2deg(chosen[0, k]):g}°)" if name in o.posture_angles else ""
                turned = angles * np.where(np.arange(len(rotations)) == k, -1.0, 1.0)
                done[f"{rotations[k]} has the other sign in {name}{value}"] = turned
            for a, b in combinations(bent, 2):
                if np.abs(chosen[:, a] - chosen[:, b]).max() >= LEAST_ANGLE_RAD:
                    done[f"{rotations[a]} and {rotations[b]} were exchanged in {name}"] = exchanged_columns(
                        angles, a, b
                    )
            if 0.0 < np.rad2deg(np.abs(chosen).max()) < np.pi:
                done[f"the angles of {name} are in radians"] = np.rad2deg(angles)
            for words, set_to in done.items():
                posture = np.where(here[:, None], set_to, angles)
                yield self._one("posture", words, with_inputs(o, posture=posture))

    def _moments(self) -> Iterator[Corrected]:
        """Moments alone in another unit, or of the other sign."""
        o, moment = self.session.observations, self.session.rows % 6 >= 3
        entered = self.session.measured[moment]
        predicted = entered - self.away[moment]
        along = float(entered @ predicted)
        each: list[tuple[str, Kind, float]] = [("of the other sign", "axes", -1.0)]
        if along:
            # Of the units the one in which the moments are nearest to the model's.
            scale = abs(along) / float(predicted @ predicted)
            unit, factor = min(_MOMENTS_NMM.items(), key=lambda of: abs(np.log(scale * of[1])))
            each += [(unit, "unit", factor)] if factor != 1.0 else []
        for words, kind, factor in each:
            turn = np.array([1.0] * 3 + [factor] * 3)
            found = self._one(kind, f"the moments are {words}", scaled(o, turn))
            units = np.where(moment, np.log(abs(factor)), 0.0)
            yield replace(found, away=np.where(moment, 1.0 / factor, 1.0) * found.away, log_units=units)

    def _tares(self) -> Iterator[Corrected]:
        """Readings that were tared already when the tare was taken away; one tare of each mount for all its cases."""
        o = self.session.observations
        if not o.tared.any():
            return
        # Without their tares readings have less noise, whether or not there is a fault: so have those of smooth tares.
        smooth = smooth_tares(o)
        sound = replace(o, wrench=o.wrench + o.tared - smooth)
        words = "the readings were tared already, and the tare was taken away twice"
        if (np.abs(smooth) > noise_at_most(o))[:, :3].any():
            yield replace(self._one("tare", words, replace(o, wrench=o.wrench + o.tared)), sound=sound)
        first = np.array([smooth[o.locations.index(place)] for place in o.locations])
        if np.count_nonzero((smooth != first).any(axis=1)) > OF_A_SLIP:
            again = replace(o, wrench=o.wrench + o.tared - first)
            yield replace(self._one("tare", "one tare of each mount serves all its cases", again), sound=sound)


def _best_run(gains: Iterable[float]) -> tuple[float, int, int]:
    """Sum, first and last index of the neighbours that gain most together."""
    best, start, total = (-np.inf, 0, 0), 0, 0.0
    for k, gain in enumerate(gains):
        start, total = (k, gain) if total <= 0.0 else (start, total + gain)
        best = max(best, (total, start, k), key=lambda of: of[0])
    return best
