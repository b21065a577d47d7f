"""Mistakes of a whole rig: axes exchanged or turned round, forces in another frame or in another unit.

No effect of a finger looks like them, and no model fits readings that have one. They show where tip and bone together
should balance the tendons' pulls: put right, the readings do, whatever the finger.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import permutations, product

import numpy as np

from fingermodel.arrays import Floats
from fingermodel.comparison.observations import Observations
from fingermodel.diagnosis.model_free.answer import figure
from fingermodel.diagnosis.model_free.budget import Readings
from fingermodel.model import Model

# So many loads, in so many postures, must balance at once; fewer may by chance.
LEAST_LOADS, LEAST_POSTURES = 4, 2
# Of the pulls (RMS): from where it is looked for, what may be left once it is put right, and how many times less.
MUCH, LITTLE, TIMES = 0.15, 0.15, 4.0
# From here on a share of the pulls is no figure to be told.
FAR_OFF = 10.0
# What leaves no more than the best does but for this factor and this share of the pulls is as good.
ALIKE, ALIKE_TOO = 1.25, 0.005
# By friction and a wrong calibration forces are off by less.
ANOTHER_UNIT = 1.6
# Newtons in what may have been taken for newtons, and what friction and calibration may add to that.
UNITS_N = {
    "kilonewtons": 1e3,
    "kilograms-force": 9.80665,
    "pounds-force": 4.4482,
    "grams-force": 9.80665e-3,
    "millinewtons": 1e-3,
}
LIKE_THE_UNIT = 1.25
# Ways that cannot be told apart and are named together.
MOST_NAMED = 2
_AS_STATED = np.eye(3)
MINUS = "\N{MINUS SIGN}"


@dataclass(frozen=True, eq=False)
class _Way:
    """One way to read the cell."""

    tip: Floats  # (3, 3) what makes true forces of those stated at the tip
    bone: Floats  # (3, 3) likewise at the bone
    steps: int = 0  # how much would have gone wrong
    words: str = ""  # which forces would have to be read so, and what that is; empty, where they are read as stated
    tip_in_base: bool = False  # whether the tip's forces are along the metacarpal's axes


@dataclass(frozen=True, eq=False)
class RigMistake:
    """What went wrong with the readings of a whole session."""

    words: str  # a sentence's beginning: what would have to be done, and what it would bring
    unit: bool  # whether a factor is part of it
    factor: float  # on the forces as stated
    tip: Floats  # (cases, 3, 3) what makes forces at the tip of those stated, factor not counted
    bone: Floats  # (3, 3) likewise at the bone

    def put_right(self, observations: Observations, *, moments: bool = True) -> Observations:
        """The session's readings as they should have been stated; `moments` are in another unit as well, or not."""
        at_bone = np.array([place == "bone" for place in observations.locations])
        axes = np.where(at_bone[:, None, None], self.bone, self.tip)
        turn = np.zeros((len(at_bone), 6, 6))
        turn[:, :3, :3] = axes
        turn[:, 3:, 3:] = axes
        read = np.isfinite(observations.wrench)
        # A component that was not read may be turned into one that is asked for; then that is not known either.
        known = np.einsum("nij,nj->ni", np.abs(turn) > 1e-6, ~read) == 0
        turn[:, : 6 if moments else 3] *= self.factor
        wrench = np.einsum("nij,nj->ni", turn, np.nan_to_num(observations.wrench))
        return replace(observations, wrench=np.where(known, wrench, np.nan), noise=observations.noise.turned(turn))


def rig_mistake(model: Model, observations: Observations) -> RigMistake | None:
    """Find the mistake that, put right, would make tip and bone balance the tendons' pulls.

    Args:
        model: its joints and its sutures' direction are used, its tendons are not.
        observations: of one session.

    Returns:
        None where readings balance as they are, or no mistake known here makes them balance.
    """
    return mistake_in(Readings(model, observations.inputs, observations))


def mistake_in(r: Readings) -> RigMistake | None:
    """The same of readings."""
    pairs = [(t, b) for t, b in r.both_ends if r.read[[*t, *b], :3].all()]
    if len(pairs) < LEAST_LOADS or len({r.observations.postures[b[0]] for _, b in pairs}) < LEAST_POSTURES:
        return None
    tip = np.array([r.wrench[t, :3].mean(axis=0) for t, _ in pairs])
    bone = np.array([r.wrench[b, :3].mean(axis=0) for _, b in pairs])
    to_base = r.to_base[[t[0] for t, _ in pairs]]
    pull = r.tension[[b[0] for _, b in pairs]] @ np.asarray(r.model.finger.values.suture)
    size = float(np.sum(pull**2))

    def put_right(way: _Way) -> tuple[float, float, _Way] | None:
        """What a way leaves of the pulls, the factor it needs, and itself; none if it would push the tendons."""
        carried = _carried(way, tip, bone, to_base)
        gain = float(np.sum(carried * pull)) / size
        if gain <= 0.0:
            return None
        return float(np.sqrt(np.sum((carried / gain - pull) ** 2) / size)), 1.0 / gain, way

    plain = _Way(_AS_STATED, _AS_STATED)
    as_read = put_right(plain)
    # Axes right and a factor that friction or a calibration can make: no mistake, however much that leaves.
    if as_read is not None and not _another_unit(as_read[1]):
        stated = as_read[0]
    else:
        stated = float(np.sqrt(np.sum((_carried(plain, tip, bone, to_base) - pull) ** 2) / size))
    if stated < MUCH:
        return None
    found = [f for f in map(put_right, _ways()) if f is not None]
    least = min((left for left, _, _ in found), default=np.inf)
    if least > min(LITTLE, stated / TIMES):
        return None
    alike = [f for f in found if f[0] <= ALIKE * least + ALIKE_TOO]
    fewest = min(way.steps for _, _, way in alike)
    simplest = [f for f in alike if f[2].steps == fewest]
    if len(simplest) > MOST_NAMED:
        return None
    left = max(f[0] for f in simplest)
    missed = "are far off" if stated > FAR_OFF else f"miss them by {figure(100.0 * stated)} %"
    words = (
        f"{', or '.join(_worded(factor, way) for _, factor, way in simplest)}, tip and bone would balance the tendons' "
        f"pulls within {figure(100.0 * left)} % (RMS); as stated they {missed}"
    )
    _, factor, way = min(simplest, key=lambda f: f[0])
    turn = r.to_base if way.tip_in_base else np.broadcast_to(way.tip, r.to_base.shape)
    another = _another_unit(factor)
    return RigMistake(
        words, another, factor if another else 1.0, turn.swapaxes(1, 2) if way.tip_in_base else turn, way.bone
    )


def _carried(way: _Way, tip: Floats, bone: Floats, to_base: Floats) -> Floats:
    """(loads, 3) what tip and bone carry together, in the metacarpal's axes."""
    at_tip = tip @ way.tip.T
    turned = at_tip if way.tip_in_base else np.einsum("kab,kb->ka", to_base, at_tip)
    return turned + bone @ way.bone.T


def _ways() -> Iterator[_Way]:
    """Every way to exchange and turn axes, at both ends or at one, and the tip's forces in the other frame."""
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            axes = np.diag(signs) @ np.eye(3)[list(order)]
            # All turned round is one mistake, else each axis that is another is one.
            if np.array_equal(axes, -_AS_STATED):
                steps, words = 1, "turned round, as those on the finger have to be"
            else:
                steps = int(np.any(axes != _AS_STATED, axis=1).sum())
                names = [f"{'' if row.sum() > 0.0 else MINUS}{'xyz'[int(np.argmax(np.abs(row)))]}" for row in axes]
                words = f"taken as ({', '.join(names)}) instead of (x, y, z)"
            if not steps:
                yield _Way(axes, axes)
                continue
            yield _Way(axes, axes, steps, f"the forces {words}")
            yield _Way(axes, _AS_STATED, steps, f"the forces at the tip {words}")
            yield _Way(_AS_STATED, axes, steps, f"the forces at the bone {words}")
    words = "the forces at the tip taken as along the metacarpal's axes"
    yield _Way(_AS_STATED, _AS_STATED, 2, words, tip_in_base=True)


def _worded(factor: float, way: _Way) -> str:
    """What would have to be done: axes taken another way, forces in another unit, or both."""
    if not _another_unit(factor):
        return f"were {way.words}"
    units = [u for u, n in UNITS_N.items() if 1.0 / LIKE_THE_UNIT < factor / n < LIKE_THE_UNIT]
    as_if = f"as {units[0]} have to be; " if units else ""
    larger = f"made {_times(factor)} times as large ({as_if}or the weights {_times(1.0 / factor)} times)"
    return f"were {way.words} and {larger}" if way.steps else f"were the forces {larger}"


def _another_unit(factor: float) -> bool:
    return not 1.0 / ANOTHER_UNIT < factor < ANOTHER_UNIT


def _times(factor: float) -> str:
    return f"{float(f'{factor:.2g}'):g}"
