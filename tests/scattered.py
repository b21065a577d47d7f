"""Readings of a session changed case by case, setting by setting or weight by weight, as ordinary benches do."""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from fingermodel.session import Session
from fingermodel.stages import LoadCaseInput

Floats = NDArray[np.float64]
Rng = np.random.Generator


def by_one_factor(bench: Session, rng: Rng) -> Floats:
    """Each case by one factor, 2 %."""
    wrench = _wrench(bench)
    return wrench * (1.0 + 0.02 * rng.normal(size=(len(wrench), 1)))


def by_component(bench: Session, rng: Rng) -> Floats:
    """Each component by itself, 1.5 %."""
    wrench = _wrench(bench)
    return wrench * (1.0 + 0.015 * rng.normal(size=wrench.shape))


def by_direction(bench: Session, rng: Rng) -> Floats:
    """Each case turned, 0.02 rad about each axis."""
    wrench = _wrench(bench)
    return _turned(wrench, 0.02 * rng.normal(size=(len(wrench), 3)))


def by_angle(bench: Session, rng: Rng) -> Floats:
    """Each case at other joint angles, 1 degree."""
    wrench = _wrench(bench)
    return wrench + _by_angles(
        bench, np.deg2rad(rng.normal(size=(len(wrench), bench.observations.inputs.posture.shape[1])))
    )


def by_setting(bench: Session, rng: Rng) -> Floats:
    """Each posture, at the tip and at the bone, with the cell turned by 1 degree about each axis."""
    place = _place(bench)
    turns = np.deg2rad(rng.normal(size=(place.max() + 1, 3)))
    return _turned(_wrench(bench), turns[place])


def by_hold(bench: Session, rng: Rng) -> Floats:
    """Each posture with the tip held elsewhere by 1 mm along each axis, which gives the force a lever."""
    wrench, inputs = _wrench(bench), bench.observations.inputs
    setting, bone = (np.asarray(of)[: len(wrench)] for of in (inputs.setting, inputs.at_bone))
    moved_mm = rng.normal(size=(setting.max() + 1, 3))[setting] * ~bone[:, None]
    wrench[:, 3:] -= np.cross(moved_mm, wrench[:, :3])
    return wrench


def by_mount(bench: Session, rng: Rng) -> Floats:
    """Each posture, at the tip and at the bone, at other joint angles, 1 degree."""
    place = _place(bench)
    errors = np.deg2rad(rng.normal(size=(place.max() + 1, bench.observations.inputs.posture.shape[1])))
    return _wrench(bench) + _by_angles(bench, errors[place])


def by_weight(bench: Session, rng: Rng) -> Floats:
    """Each weight by 1 % of itself, on whichever tendon it hangs."""
    wrench, inputs = _wrench(bench), bench.observations.inputs
    weights, which = np.unique(np.round(np.asarray(inputs.tension)[: len(wrench)], 6), return_inverse=True)
    errors = (0.01 * rng.normal(size=len(weights)))[which].reshape(len(wrench), -1)
    tension = np.array(inputs.tension)
    tension[: len(wrench)] *= 1.0 + errors
    return wrench + _changed(bench, inputs._replace(tension=jnp.asarray(tension)))


def by_zero(bench: Session, rng: Rng) -> Floats:
    """Each setting at either mount with a zero of its own, 0.02 N, and 0.2 N mm of its moments."""
    wrench = _wrench(bench)
    inputs = bench.observations.inputs
    setting, bone = (np.asarray(of)[: len(wrench)].astype(int) for of in (inputs.setting, inputs.at_bone))
    errors = np.array([0.02] * 3 + [0.2] * 3) * rng.normal(size=(2 * setting.max() + 2, 6))
    return wrench + errors[2 * setting + bone]


def by_drift(bench: Session, rng: Rng) -> Floats:
    """Each setting at either mount with a zero that swings once to and fro, by 0.02 N, and 0.2 N mm of its moments."""
    wrench, inputs = _wrench(bench), bench.observations.inputs
    setting, bone = (np.asarray(of)[: len(wrench)].astype(int) for of in (inputs.setting, inputs.at_bone))
    elapsed, place = np.asarray(inputs.elapsed)[: len(wrench)], 2 * setting + bone
    for one in np.unique(place):
        here = place == one
        share = (elapsed[here] - elapsed[here].min()) / max(float(np.ptp(elapsed[here])), 1e-9)
        swing = np.sin(2.0 * np.pi * (share + rng.uniform()))
        wrench[here] += np.outer(swing, np.array([0.02] * 3 + [0.2] * 3) * rng.normal(size=6))
    return wrench


def by_line(bench: Session, rng: Rng) -> Floats:
    """Each tendon with its line at the metacarpal turned in the sagittal and the frontal plane, 1.5 degrees."""
    wrench, inputs = _wrench(bench), bench.observations.inputs
    tension = np.asarray(inputs.tension)[: len(wrench)]
    angles = np.deg2rad(1.5) * rng.normal(size=(tension.shape[1], 2))
    straight = np.array(bench.model.values.suture)
    turned = np.array(
        [Rotation.from_euler("yz", of_tendon).apply(v) for of_tendon, v in zip(angles, straight, strict=True)]
    )
    wrench[:, :3] += (tension @ (turned - straight)) * np.asarray(inputs.at_bone)[: len(wrench), None]
    return wrench


def with_gain_drift(bench: Session) -> Floats:
    """The cell reads ever more through the session: 3 % too little at the first case, 3 % too much at the last."""
    wrench = _wrench(bench)
    return wrench * (1.0 + 0.06 * (_share(bench) - 0.5))[:, None]


def with_saturation(bench: Session) -> Floats:
    """The cell reads the less of a force the larger it is: 8 % too little of the largest."""
    wrench = _wrench(bench)
    force = np.linalg.norm(wrench[:, :3], axis=1)
    return wrench * (1.0 - 0.08 * force / force.max())[:, None]


def with_tension_drift(bench: Session, muscle: str = "FDP") -> Floats:
    """One tendon is pulled ever more through the session: 4 % too little at first, 4 % too much at last."""
    inputs = bench.observations.inputs
    tension, k = np.array(inputs.tension), list(bench.model.finger.topology.muscles).index(muscle)
    share = _share(bench)
    tension[: len(share), k] *= 1.0 + 0.08 * (share - 0.5)
    return _wrench(bench) + _changed(bench, inputs._replace(tension=jnp.asarray(tension)))


def with_readings(bench: Session, wrench: Floats) -> Session:
    """The same bench with other readings (cases, 6)."""
    cases = tuple(replace(case, wrench=own) for case, own in zip(bench.measured.cases, wrench, strict=True))
    return Session.of(replace(bench.measured, cases=cases))


def _wrench(bench: Session) -> Floats:
    return np.array([case.wrench for case in bench.measured.cases])


def _share(bench: Session) -> Floats:
    """(cases,) share of the session's cases that were measured before each."""
    out: Floats = np.linspace(0.0, 1.0, len(bench.measured.cases))
    return out


def _place(bench: Session) -> NDArray[np.intp]:
    """(cases,) which posture, and whether it was measured at the bone."""
    inputs = bench.observations.inputs
    return (2 * np.asarray(inputs.setting) + np.asarray(inputs.at_bone))[: len(bench.measured.cases)]


def _by_angles(bench: Session, errors_rad: Floats) -> Floats:
    """(cases, 6) change of the readings at other joint angles, by errors (cases, rotations)."""
    inputs = bench.observations.inputs
    posture = np.array(inputs.posture)
    posture[: len(errors_rad)] += errors_rad
    return _changed(bench, inputs._replace(posture=jnp.asarray(posture)))


def _changed(bench: Session, inputs: LoadCaseInput) -> Floats:
    """(cases, 6) change of the readings by other load cases than the bench has."""
    there, here = (
        np.asarray(bench.model.predict(i, bench.model.initial).reading) for i in (inputs, bench.observations.inputs)
    )
    return (there - here)[: len(bench.measured.cases)]


def _turned(wrench: Floats, by_rad: Floats) -> Floats:
    """Force and moment turned, case by case, by rotation vectors (cases, 3)."""
    turn = Rotation.from_rotvec(by_rad)
    return np.concatenate([turn.apply(wrench[:, :3]), turn.apply(wrench[:, 3:])], axis=1)
