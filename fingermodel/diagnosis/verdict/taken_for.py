"""The same load cases taken for others: other loads or postures, another mount, other units, tares without noise."""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
from scipy.special import chdtri

from daq.vocabulary import OTHER_MOUNT
from fingermodel.arrays import Floats, Mask
from fingermodel.comparison.observations import Observations
from fingermodel.diagnosis.session_model.reading_changes import of_label
from fingermodel.diagnosis.session_model.slips import LONGEST_MM
from fingermodel.diagnosis.settings import EXTRA_NOISE_N, P_VALUE

# Standard uncertainties by which noise is off once in 1 / P_VALUE times.
_BEYOND_NOISE = float(np.sqrt(chdtri(1, P_VALUE)))


def noise_at_most(observations: Observations) -> Floats:
    """How far noise puts readings (cases, 6) [N, N mm] off, but for once in 1 / P_VALUE times."""
    return _BEYOND_NOISE * np.sqrt(observations.noise.variance.reshape(-1, 6) + EXTRA_NOISE_N.scale**2)


def smooth_tares(observations: Observations) -> Floats:
    """Tares (cases, 6) [N, N mm] without their noise: the mean of each mount's in a row that differ by no more."""
    o, usual = observations, noise_at_most(observations)
    out = o.tared.copy()
    for place in dict.fromkeys(o.locations):
        alike: list[int] = []
        for case in np.flatnonzero(of_label(o.locations, place)).tolist():
            off = np.abs(o.tared[case] - o.tared[alike].mean(axis=0)) if alike else np.zeros(6)
            alike = [*alike, case] if (off <= usual[case])[:3].all() else [case]
            out[alike] = o.tared[alike].mean(axis=0)
    return out


def read_at_other_mount(observations: Observations, moved: Mask) -> Observations:
    """The same readings, some cases of the other mount; moments at the bone may be anything."""
    o, turn = observations, np.where(moved[:, None, None], observations.to_other_mount, np.eye(6))
    locations = [OTHER_MOUNT[p] if is_moved else p for p, is_moved in zip(o.locations, moved, strict=True)]
    at_bone, mounting = of_label(locations, "bone"), np.array(o.inputs.mounting)
    for i in np.flatnonzero(moved):
        there = np.flatnonzero(of_label(o.locations, locations[i]))
        mounting[i] = mounting[there[np.argmin(np.abs(there - i))]] if there.size else mounting[i]
    noise = o.noise.turned(turn)
    anything = np.where(moved & at_bone, LONGEST_MM * np.asarray(o.inputs.tension).sum(axis=1), 0.0)
    blocks = noise.blocks + anything[:, None, None] ** 2 * np.diag([0.0] * 3 + [1.0] * 3)
    wrench, tared = ((turn @ np.nan_to_num(each)[..., None])[..., 0] for each in (o.wrench, o.tared))
    return replace(
        o,
        locations=tuple(locations),
        inputs=o.inputs._replace(at_bone=jnp.asarray(at_bone), mounting=jnp.asarray(mounting)),
        wrench=np.where(np.isfinite(o.wrench), wrench, np.nan),
        noise=replace(noise, blocks=blocks),
        tared=tared,
    )


def with_inputs(observations: Observations, **columns: Floats) -> Observations:
    """The same readings of other loads or postures."""
    inputs = observations.inputs._replace(**{name: jnp.asarray(column) for name, column in columns.items()})
    return replace(observations, inputs=inputs)


def scaled(observations: Observations, factor: Floats) -> Observations:
    """The same cases, each reading times a factor that goes with (cases, 6); what was not measured stays so."""
    each = np.broadcast_to(factor, observations.wrench.shape)
    noise = observations.noise.turned(each[:, :, None] * np.eye(6))
    return replace(observations, wrench=observations.wrench * each, noise=noise)


def exchanged_columns(columns: Floats, a: int, b: int) -> Floats:
    """Columns (cases, k), two of them in each other's place."""
    order = np.arange(columns.shape[1])
    order[[a, b]] = b, a
    return columns[:, order]
