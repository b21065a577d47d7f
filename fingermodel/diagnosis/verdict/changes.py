"""What may be another than was entered by an amount: a mount's gain, a weight, a pull, an angle, what was left hanging.

Each is of many cases alike.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations, product
from typing import Literal

import numpy as np

from fingermodel.arrays import Floats, Ints, Mask
from fingermodel.diagnosis.posterior.gaussian import Quadratic
from fingermodel.diagnosis.posterior.hyper import Node
from fingermodel.diagnosis.posterior.optimum import Optimum
from fingermodel.diagnosis.session_model.reading_changes import MOST_BLOCKS, of_label, postures_in_use, set_up_once
from fingermodel.diagnosis.session_model.session import Session
from fingermodel.diagnosis.settings import AMOUNT, GAIN_SPREAD, LEAST_AMOUNT, LEAST_ANGLE_RAD, LEVER_MM, WRONG_ANGLE_RAD

Kind = Literal[
    "tendon_labels",
    "rows",
    "side",
    "posture",
    "mount",
    "mass_unit",
    "axes",
    "unit",
    "gain",
    "weight",
    "tension",
    "tare",
    "tare_weight",
    "zero",
]


# Cases of a tendon, or of a mount, from which on something may change at a new setting alone: else it may at each.
_MOST_STARTS = 100
# How far the zero of some cases may be off in each component, and by how much together at least [N].
_ZERO_N, _LEAST_ZERO_N = 0.5, 0.1
# Of a component's zero, what 1 N is [N, N mm].
_PER_NEWTON = np.array([1.0] * 3 + [LEVER_MM] * 3)


@dataclass(frozen=True)
class Amend:
    """One amendment of a block of cases."""

    cases: str  # the block, as `daq.sessions.amendments.block_of` has it
    tendons: dict[str, str] = field(default_factory=dict)  # the tendon that bore a weight, by the one that was entered
    weights_g: dict[float, float] = field(default_factory=dict)  # what a weight really weighs [g], by what was entered
    masses_g: dict[str, float] = field(default_factory=dict)  # what really hung on a tendon [g], 0 for nothing
    posture: str | None = None  # that was really set; None where it was as entered
    location: str | None = None  # of the cell, as `posture`


@dataclass(frozen=True, eq=False)
class Change:
    """What is another than was entered by an amount: a gain, a weight, two exchanged ones, an angle, a tare's load."""

    kind: Kind  # of fault; of a posture the amount is an angle [rad], of a zero its size [N], else it is relative
    saying: str  # what is said of it; the value goes into the braces, if there are any
    entered: float  # the value then; of an angle [deg]; of a load that was left hanging, what the amount is relative to
    spread: float  # standard deviation of the amount's prior about 0; 0 where the amount is known to be 1
    least: float  # that the amount is at least
    # (cases, muscles) relative change of tensions per unit of the amount, (cases, 1) of readings, or (cases, rotations)
    # of joint angles; of a load that the readings lack (cases, muscles) its tension [N], less than 0 where it is more;
    # (cases, 6) of a zero, whose direction the readings tell with its size.
    acts: Floats
    above: float = -1.0  # that the amount is more than
    lacks: bool = False  # whether it is a load that the readings lack
    amend: tuple[Amend, ...] = ()  # amendments that put it right; none where its amount is only estimated
    amount: float = 0.0  # as the readings tell it; 0 where nothing is put right

    @property
    def words(self) -> str:
        """What is said of it."""
        if self.kind == "posture":
            return self.saying.format(self.entered + np.rad2deg(self.amount))
        if self.kind == "zero":
            return self.saying.format(*(self.amount * self.direction)[:3])
        return self.saying.format(self.entered * (self.amount + (not self.is_sum)))

    @property
    def unit(self) -> float:
        """Of the amount, by which it is told further once it is put right."""
        return 1.0 if self.is_sum else 1.0 + self.amount

    @property
    def is_sum(self) -> bool:
        """Whether the amount is added to what was entered, which else is multiplied."""
        return self.lacks or self.kind in ("posture", "zero")

    @property
    def direction(self) -> Floats:
        """(6,) change of the readings by a unit of a zero [N, N mm]."""
        return self.acts[int(np.argmax(self.cases))]

    @property
    def cases(self) -> Mask:
        """(cases,) in which of them it acts."""
        return np.any(self.acts != 0.0, axis=1)

    @property
    def counts(self) -> bool:
        """Whether it is far enough from what was entered, and can be."""
        return self.amount > self.above and abs(self.amount) >= self.least


def changes(session: Session) -> list[Change]:
    """What may be another by an amount."""
    of_entries = [*_gains(session), *_weights(session), *_joint_angles(session)]
    return [*of_entries, *_left_hanging(session), *_pulls(session), *_zeros(session)]


def _gains(session: Session) -> Iterator[Change]:
    """The gain of either mount."""
    locations = np.array(session.observations.locations)
    places = dict.fromkeys(locations[session.rows[session.fitted] // 6])
    for place in places if len(places) > 1 else ():
        here = (locations == place)[:, None].astype(float)
        yield Change("gain", f"the cell at the {place} has a gain of {{:.2f}}", 1.0, GAIN_SPREAD, 0.0, here)


def _weights(session: Session) -> Iterator[Change]:
    """Each weight, on one tendon or all; a piece of all heavier loads; all of one tendon; two exchanged.

    What all loads have besides is a hanger, an effect; what all lack is not. Friction cannot make all of a tendon more.
    """
    muscles = session.model.finger.topology.muscles
    mass_g = np.array([[of_case.get(m, 0.0) for m in muscles] for of_case in session.observations.masses_g])
    used = np.unique(mass_g[mass_g > 0.0]).tolist()
    hangs = {weight: (mass_g == weight).astype(float) for weight in (used if len(used) <= MOST_BLOCKS else ())}
    for weight, here in hangs.items():
        on = np.flatnonzero(here.any(axis=0)).tolist()
        words = f"the weight of {weight:g} g{{}} weighs {{{{:.0f}}}} g"
        yield Change("weight", words.format(""), weight, AMOUNT, LEAST_AMOUNT, here)
        for m in on if len(on) > 1 else ():
            alone = here * (np.arange(len(muscles)) == m)
            yield Change("weight", words.format(f" on {muscles[m]}"), weight, AMOUNT, LEAST_AMOUNT, alone)
    for weight in list(hangs)[1:-1]:
        # Of a relative error of the piece, heavier loads have a smaller share.
        here = np.divide(weight, mass_g, out=np.zeros_like(mass_g), where=mass_g >= weight)
        words = f"a piece that is in all loads of {weight:g} g and more is off: {weight:g} g weigh {{:.0f}} g"
        yield Change("weight", words, weight, AMOUNT, LEAST_AMOUNT, here)
    if used:
        lighter = np.where(mass_g > 0.0, used[0] * np.asarray(session.observations.inputs.weight)[:, None], 0.0)
        words = "every load is {:.0f} g lighter than entered, as by a hanger that is counted and does not hang"
        yield Change("weight", words, used[0], AMOUNT, LEAST_AMOUNT, lighter, above=0.0, lacks=True)
    for m, muscle in enumerate(muscles):
        if len(np.unique(mass_g[mass_g[:, m] > 0.0, m])) > 1:
            here = (mass_g > 0.0) * (np.arange(len(muscles)) == m).astype(float)
            words = f"all weights on {muscle} weigh {{:.2f}} times what was entered"
            yield Change("weight", words, 1.0, AMOUNT, LEAST_AMOUNT, here, above=0.0)
    for a, b in combinations(hangs, 2):
        if b / a - 1.0 < LEAST_AMOUNT:
            continue
        words = "the weights of {:g} g{} and {:g} g{} were exchanged throughout"
        on_a, on_b = (np.flatnonzero(hangs[w].any(axis=0)).tolist() for w in (a, b))
        every = [(m, n) for m, n in product(on_a, on_b) if m != n]
        acts = hangs[a] * (b / a - 1.0) + hangs[b] * (a / b - 1.0)
        amend = (Amend("all", weights_g={a: b, b: a}),)
        yield Change("weight", words.format(a, "", b, ""), 1.0, 0.0, 0.0, acts, amend=amend)
        # Of two tendons alone, where one of the two hangs on others, too.
        for m, n in every if len(on_a) + len(on_b) > 2 else ():
            alone = np.zeros_like(acts)
            alone[:, m], alone[:, n] = hangs[a][:, m] * (b / a - 1.0), hangs[b][:, n] * (a / b - 1.0)
            exchanged = words.format(a, f" on {muscles[m]}", b, f" on {muscles[n]}")
            yield Change("weight", exchanged, 1.0, 0.0, 0.0, alone)


def _joint_angles(session: Session) -> Iterator[Change]:
    """Each angle of each posture."""
    o, rotations = session.observations, session.model.finger.topology.rotations
    for name in postures_in_use(session.observations):
        for k, rotation in enumerate(rotations):
            here = of_label(o.postures, name)[:, None] * (np.arange(len(rotations)) == k).astype(float)
            entered = float(np.rad2deg(o.posture_angles[name][k]))
            words = f"{rotation} in {name} was about {{:.0f}}°, not {entered:g}°"
            yield Change("posture", words, entered, WRONG_ANGLE_RAD, LEAST_ANGLE_RAD, here, above=-np.pi)


def _left_hanging(session: Session) -> Iterator[Change]:
    """What hung on one tendon while a tare of several cases was taken, so that their readings lack it, or after it."""
    o, muscles = session.observations, session.model.finger.topology.muscles
    blocks = set_up_once(o, map(bytes, o.tared))
    blocks = [cases for cases in blocks if len(cases) > 1 and o.roles[cases[0]] != "check"]
    newton = np.asarray(o.inputs.weight)
    for m, muscle in enumerate(muscles) if len(blocks) <= MOST_BLOCKS else ():
        usual = float(np.median([masses[muscle] for masses in o.masses_g if masses.get(muscle)] or [0.0]))
        for cases in blocks if usual else ():
            pull = np.zeros((len(o.ids), len(muscles)))
            pull[cases, m] = usual * newton[cases]
            place = f"from {o.ids[cases[0]]} to {o.ids[cases[-1]]} ({o.postures[cases[0]]}, {o.locations[cases[0]]})"
            words = f"about {{:.0f}} g hung on {muscle} while the tare was taken for the cases {place}"
            yield Change("tare_weight", words, usual, 1.0, LEAST_AMOUNT, pull, above=0.0, lacks=True)
            words = f"about {{:.0f}} g hung on {muscle} besides in all cases {place}"
            yield Change("weight", words, usual, 1.0, LEAST_AMOUNT, -pull, above=0.0, lacks=True)


def _pulls(session: Session) -> Iterator[Change]:
    """What each tendon pulls from one of its load cases on, where its line slips, or in a posture, where it chafes."""
    o, muscles = session.observations, session.model.finger.topology.muscles
    tension, setting = np.asarray(o.inputs.tension), np.asarray(o.inputs.setting)
    order = np.argsort(np.asarray(o.inputs.elapsed), kind="stable")
    places = {f"in {name}": of_label(o.postures, name) for name in postures_in_use(o)}
    at_mounts = {mount: of_label(o.locations, mount) for mount in dict.fromkeys(o.locations)}
    for (where, here), (mount, there) in product(list(places.items()), at_mounts.items()):
        places[f"{where} at the {mount}"] = here & there
    for m, muscle in enumerate(muscles):
        pulls = tension[:, m] > 0.0
        pulling = order[pulls[order]].tolist()
        slips, chafes = "as where its line slips or a pulley jams", "as where its line chafes"
        blocks = {
            f"from {o.ids[pulling[k]]} on": (np.isin(np.arange(len(pulls)), pulling[k:]), slips)
            for k in _starts(pulling, setting)
        }
        blocks |= {where: (here & pulls, chafes) for where, here in places.items() if (pulls & ~here).any()}
        for where, (here, why) in blocks.items():
            acts = here[:, None] * (np.arange(len(muscles)) == m).astype(float)
            words = f"{where} {muscle} pulled {{:.2f}} times what was entered, {why}"
            yield Change("tension", words, 1.0, AMOUNT, LEAST_AMOUNT, acts)


def _zeros(session: Session) -> Iterator[Change]:
    """The zero of the cases of one setting at a mount, as with an old tare; or of a mount from one of its cases on."""
    o, setting = session.observations, np.asarray(session.observations.inputs.setting)
    order, checks = np.argsort(np.asarray(o.inputs.elapsed), kind="stable"), of_label(o.roles, "check")
    off, blocks = "was off by ({:+.2f}, {:+.2f}, {:+.2f}) N", list[tuple[str, list[int]]]()
    runs = [cases for cases in set_up_once(o) if not checks[cases[0]]]
    for cases in runs if len(runs) <= MOST_BLOCKS else ():
        where = f"the zero at the {o.locations[cases[0]]} {off} from {o.ids[cases[0]]} to {o.ids[cases[-1]]}"
        blocks.append((f"{where}, as with an old tare", cases))
    for mount in dict.fromkeys(o.locations):
        read = [case for case in order.tolist() if o.locations[case] == mount and not checks[case]]
        for k in _starts(read, setting):
            where = f"from {o.ids[read[k]]} on the zero at the {mount} {off}"
            blocks.append((f"{where}, as where the cell or its cable was moved", read[k:]))
    for saying, cases in blocks:
        # Of all cases of a mount it is an effect.
        if len(cases) < o.locations.count(o.locations[cases[0]]):
            acts = np.isin(np.arange(len(o.ids)), cases)[:, None] * _PER_NEWTON
            yield Change("zero", saying, 0.0, _ZERO_N, _LEAST_ZERO_N, acts)


def _starts(cases: Sequence[int], setting: Ints) -> list[int]:
    """Places among cases in their order from which on something may have changed."""
    places = range(1, len(cases))
    return [k for k in places if len(cases) <= _MOST_STARTS or setting[cases[k]] != setting[cases[k - 1]]]


def told(fit: Optimum, node: Node, changes: Sequence[Change]) -> list[tuple[Change, float]]:
    """Changes with which a session was fitted, as they are told there; and the log of what each gains over none.

    Args:
        fit: of the session with what they make of it, or as it was entered where each is 0.
        node: of the hyperparameters.
        changes: of it.
    """
    zeros = [change for change in changes if change.kind == "zero"]
    return [*_amounts(fit, node, [c for c in changes if c.kind != "zero"]), *_zeros_told(fit, node, zeros)]


def _amounts(fit: Optimum, node: Node, changes: Sequence[Change]) -> Iterator[tuple[Change, float]]:
    asked = fit.asked(_columns(fit.session, changes, fit.theta)[fit.session.fitted], node) if changes else ((), ())
    for change, information, score in zip(changes, *asked, strict=True):
        if not change.spread:
            yield replace(change, amount=1.0), float(score - 0.5 * information)
            continue
        # It is further off by w, of what it was taken for; the prior of its amount is N(0, spread²).
        mean, precision = -change.amount / change.unit, (change.unit / change.spread) ** 2
        best = (score + mean * precision) / (information + precision)
        log = 0.5 * (best**2 * (information + precision) - mean**2 * precision - np.log1p(information / precision))
        further = replace(change, amount=change.amount + change.unit * float(best))
        yield further, float(log) if further.counts else -np.inf


def _zeros_told(fit: Optimum, node: Node, zeros: Sequence[Change]) -> Iterator[tuple[Change, float]]:
    if not zeros:
        return
    rows = fit.session.rows[fit.session.fitted]
    per_newton = (np.eye(6) * _PER_NEWTON)[rows % 6]
    columns = np.concatenate([zero.cases[rows // 6, None] * per_newton for zero in zeros], axis=1)
    said = fit.quadratic_of(columns, node)
    for k, zero in enumerate(zeros):
        own, now = slice(6 * k, 6 * k + 6), zero.amount * zero.direction / _PER_NEWTON
        alone = Quadratic(0.0, said.gradient[own], said.hessian[own, own], 0.0)
        found = alone.freed(np.full(6, zero.spread), now, 6)
        size = float(np.linalg.norm(found.mean))
        direction = found.mean * _PER_NEWTON / max(size, np.finfo(float).tiny)
        further = replace(zero, amount=size, acts=zero.cases[:, None] * direction) if size > 0.0 else zero
        yield further, found.log_evidence if further.counts else -np.inf


def _columns(session: Session, changes: Sequence[Change], theta: Floats) -> Floats:
    """(n, k) change of the readings per unit of a further amount of each, at some parameters."""
    out = list[Floats]()
    reading = session.changes.readings(theta)
    of = session.changes
    slopes = {"weight": of.by_tension, "tension": of.by_tension, "posture": of.by_angle, "lacks": of.less_by_newton}
    inputs = ["lacks" if change.lacks else change.kind for change in changes]
    by_input = {name: slopes_at(theta) for name, slopes_at in slopes.items() if name in inputs}
    for change, name in zip(changes, inputs, strict=True):
        by_unit = by_input.get(name)
        changed = reading * change.acts if by_unit is None else np.einsum("crk,ck->cr", by_unit, change.acts)
        out.append(changed.reshape(-1)[session.rows])
    return np.array(out).reshape(-1, len(session.rows)).T
