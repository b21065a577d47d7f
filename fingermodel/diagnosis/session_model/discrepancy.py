"""What no parameter describes: something smooth anywhere, and an error in the form of an effect.

Both are Gaussian processes over posture × muscle × load × component, given as columns whose sum with independent
N(0, 1) weights is one draw.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fingermodel.arrays import Floats, Ints, Mask
from fingermodel.comparison.observations import Observations
from fingermodel.diagnosis.settings import LEVER_MM

# Smaller parts of something smooth: what bends with the load, what a load has whatever its size, what a setting has.
_BENDS, _ANY_LOAD, _OF_SETTING = 0.3, 0.2, 0.5
# Postures that resemble each other are so far apart [rad].
_POSTURE_RAD = 0.6
# Share of an error of form that does not point along the effect.
_ASIDE = 0.4
# Largest variance, as a share of the largest, that a reduced set of columns leaves out.
LEFT_OUT = 1e-2
# Columns for which there is room at first.
_ROWS = 64


@dataclass(frozen=True, eq=False)
class Places:
    """Where each reading belongs; one row a reading."""

    kinds: list[Mask]  # masks (n,) of location and component
    load: Floats  # (n, muscles) each tension as a share of its largest in the session
    smooth: Floats  # (n, postures) columns that vary smoothly over postures
    settings: Floats  # (n, settings) 1 where a reading was taken in a setting
    moment: Mask  # (n,) whether the reading is a moment
    cases: Ints  # (n,) index of its case

    @property
    def unit(self) -> Floats:
        """(n,) what of each reading counts as much as a newton."""
        return np.where(self.moment, LEVER_MM, 1.0)

    @classmethod
    def of(cls, observations: Observations, rows: Ints) -> Places:
        """Places of some readings.

        Args:
            observations: of the session.
            rows: (n,) indices into the flattened (cases, 6) wrench.
        """
        cases, components = rows // 6, rows % 6
        tension = np.asarray(observations.inputs.tension)
        load = (tension / np.maximum(tension.max(axis=0), 1e-9))[cases]
        angles = observations.posture_angles
        names = list(angles)
        at = np.array([names.index(p) if p else -1 for p in observations.postures])[cases]
        smooth = np.where(at[:, None] >= 0, smooth_over(np.array(list(angles.values())))[np.maximum(at, 0)], 0.0)
        located = np.array(observations.locations)[cases]
        checks = np.array([role == "check" for role in observations.roles])[cases]
        kinds = [
            (located == location) & (components == component) & ~checks
            for location in dict.fromkeys(located)
            for component in sorted(set(components))
        ]
        setting = np.asarray(observations.inputs.setting)[cases]
        settings = (setting[:, None] == np.unique(setting)[None, :]) & ~checks[:, None]
        return cls([k for k in kinds if k.any()], load, smooth, settings.astype(float), components >= 3, cases)


def loaded_columns(at: Places) -> Floats:
    """Columns (n, k) of something smooth that grows with the load: 1 N (moments: 1 N at `LEVER_MM`) at the largest.

    Each muscle pulls in proportion to its load, smoothly over postures; smaller parts bend with the load, or have the
    same size at any.
    """
    varying = []
    for rows in at.kinds:
        for load in at.load.T:
            own = load * rows
            if own.any():
                varying += [own, _BENDS * own * (1.0 - load), _ANY_LOAD * (own > 0.0)]
    return reduced(at, varying)


def torque_columns(at: Places, answer: Floats) -> Floats:
    """Columns (n, k) of something smooth in joint torque: 1 N at `LEVER_MM`, as statics carries it to both mounts.

    Of each tendon in proportion to its load, with smaller parts that bend with it or have the same size at any; and of
    all loads alike, whatever their size or in proportion to the largest.

    Args:
        at: places of the readings.
        answer: (n, rotations) change of each reading per N mm of torque.
    """
    total = at.load.max(axis=1)
    varying = []
    for per_torque in LEVER_MM * answer.T / at.unit:
        varying += [(total > 0.0) * per_torque, total * per_torque]
        for load in at.load.T:
            if (load > 0.0).any():
                parts = load, _BENDS * load * (1.0 - load), _ANY_LOAD * (load > 0.0)
                varying += [part * per_torque for part in parts]
    return reduced(at, varying)


def tension_columns(at: Places, by_tension: Floats) -> Floats:
    """Columns (n, k) of something smooth in what gets through of each tension: 1 N where a tension changes most.

    In proportion to the load, with a smaller part that bends with it.

    Args:
        at: places of the readings.
        by_tension: (n, muscles) change of each reading by the logarithm of each tension.
    """
    own = by_tension.T / at.unit
    own /= np.abs(own).max(initial=1e-9)
    varying = [
        part for change, load in zip(own, at.load.T, strict=True) for part in (change, _BENDS * change * (1.0 - load))
    ]
    return reduced(at, varying)


def constant_columns(at: Places) -> Floats:
    """Columns (n, k) of something that no load changes: 1 N, smoothly over postures, and a part of each setting."""
    of_settings = [_OF_SETTING * rows[:, None] * at.settings for rows in at.kinds]
    return reduced(at, [rows.astype(float) for rows in at.kinds], np.concatenate(of_settings, axis=1))


def form_columns(at: Places, change: Floats, rows: Ints) -> Floats:
    """Columns (n, k) of an error in an effect's form, relative to what the effect changes.

    Args:
        at: places of the readings.
        change: (cases, 6) by the effect [N, N mm].
        rows: (n,) the readings.
    """
    force, moment = np.linalg.norm(change[:, :3], axis=1), np.linalg.norm(change[:, 3:], axis=1)
    # An effect that shows in moments alone may still be a little off in forces, and the other way round.
    size = np.where(at.moment, np.maximum(moment, LEVER_MM * force)[at.cases], force[at.cases])
    own, size = change.reshape(-1)[rows] / at.unit, size / at.unit
    heavy = at.load.max(axis=1) - 0.5
    # Along the change: of all tendons alike, of each, by posture; and each of these bent with the load.
    alike, varying = [own, own * heavy], [own]
    for load in at.load.T:
        pulled = own * (load > 0.0)
        if pulled.any():
            alike += [pulled, pulled * heavy]
            varying.append(pulled)
    # And a little in any direction.
    for kind in at.kinds:
        for load in at.load.T:
            loaded = _ASIDE * size * (load > 0.0) * kind
            if loaded.any():
                varying += [loaded, loaded * (load - 0.5)]
    columns = reduced(at, varying, np.stack(alike, axis=1)) / at.unit[:, None]
    # How large an effect is, its own parameters say: an error of its form is what is left of one beside the change.
    along = own / np.sqrt(max(float(own @ own), 1e-300))
    columns -= along[:, None] * (along @ columns)
    return columns * at.unit[:, None]


def reduced(at: Places, varying: Sequence[Floats], alike: Floats | None = None) -> Floats:
    """Columns (n, r) of a covariance, as few as say nearly all of it: its pivoted Cholesky factor.

    Args:
        at: places of the readings.
        varying: changes (n,), in `Places.unit`, each of which has a size of its own in any posture, smoothly.
        alike: changes (n, k) that have one size throughout.
    """
    # One column would be a change times one of those over postures. All of them together are thousands, and their
    # covariance is the product, element by element, of the two covariances. A row of it is made when it is a pivot.
    changes, smooth = np.array(varying), np.ascontiguousarray(at.smooth.T)
    same = np.zeros((0, len(at.unit))) if alike is None else np.ascontiguousarray(alike.T)
    left = (changes**2).sum(axis=0) * (smooth**2).sum(axis=0) + (same**2).sum(axis=0)
    least, root, rank = LEFT_OUT * left.max(initial=0.0), np.empty((_ROWS, len(left))), 0
    while left[pivot := int(left.argmax())] > least:
        if rank == len(root):
            root = np.concatenate([root, np.empty_like(root)])
        row = (changes[:, pivot] @ changes) * (smooth[:, pivot] @ smooth) + same[:, pivot] @ same
        row -= root[:rank, pivot] @ root[:rank]
        row /= np.sqrt(left[pivot])
        left -= row**2
        left[pivot], root[rank], rank = 0.0, row, rank + 1
    return root[:rank].T * at.unit[:, None]


def smooth_over(angles: Floats) -> Floats:
    """Root (postures, postures) of a covariance that falls with the distance of postures (postures, rotations)."""
    distance = ((angles[:, None, :] - angles[None, :, :]) ** 2).sum(axis=-1)
    values, vectors = np.linalg.eigh(np.exp(-0.5 * distance / _POSTURE_RAD**2))
    return vectors * np.sqrt(np.maximum(values, 0.0))
