"""Tip force of activated muscles at rest, and what activation deficits do to it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from daq.errors import InputError, ModelError
from fingermodel.compiled.compilation import prepare_jax
from fingermodel.fingers import COMPONENTS
from fingermodel.fingers.files import read_finger
from fingermodel.isometric.baseline import least_activity
from fingermodel.isometric.forces import IsometricFinger, Placed
from fingermodel.muscles.muscle_files import muscle_set_names, read_muscles
from fingermodel.studies.activation_result import SMALL_N, ActivationResult, Deficit, MuscleForce

Floats = NDArray[np.float64]
LEVELS_PCT = (100.0, 75.0, 50.0, 25.0, 0.0)
DIRECTIONS = {
    "proximal": (1.0, 0.0, 0.0),
    "distal": (-1.0, 0.0, 0.0),
    "dorsal": (0.0, 1.0, 0.0),
    "palmar": (0.0, -1.0, 0.0),
    "radial": (0.0, 0.0, 1.0),
    "ulnar": (0.0, 0.0, -1.0),
}
# Above the first, tip forces hang on tenths of a degree; above the second they mean nothing.
NEAR_SINGULAR, SINGULAR = 100.0, 1e6


def activate(
    finger: str,
    muscles: str | None = None,
    *,
    posture_deg: Mapping[str, float] | None = None,
    activation: Mapping[str, float] | None = None,
    force_N: Mapping[str, float] | None = None,
    lost: Mapping[str, float] | None = None,
) -> ActivationResult:
    """Hold a finger at the tip with its muscles active, and let each muscle lose activation in turn.

    Args:
        finger: name of a shipped finger, or a finger file.
        muscles: name of a shipped muscle set, or a muscle file; by default the set named like the finger.
        posture_deg: angles that differ from the posture held by default.
        activation: of the baseline, 0 to 1 by muscle; those not named rest. By default all muscles are fully active.
        force_N: in place of `activation`, the force on the clamp by direction; see `DIRECTIONS`.
        lost: share of its activation that each named muscle loses, all together.

    Raises:
        InputError: a file that cannot be used, a name that is not known, a number out of range, or a force beyond the
            muscles' strength.
    """
    read = read_finger(finger)
    if muscles is None and read.id not in muscle_set_names():
        raise InputError(f"no muscles for {read.id}", f"one of {', '.join(muscle_set_names())}", "Name them")
    return work_out(
        IsometricFinger(read, read_muscles(muscles or read.id, read)),
        posture_deg=posture_deg,
        activation=activation,
        force_N=force_N,
        lost=lost,
    )


def work_out(
    held: IsometricFinger,
    *,
    posture_deg: Mapping[str, float] | None = None,
    activation: Mapping[str, float] | None = None,
    force_N: Mapping[str, float] | None = None,
    lost: Mapping[str, float] | None = None,
) -> ActivationResult:
    """As `activate`, with a finger that has been read."""
    prepare_jax()
    topology = held.finger.topology
    members = _members(held)
    posture = _posture(held, posture_deg or {})
    placed = held.place(posture)
    condition = _condition(held, np.asarray(placed.jacobian))
    if not condition < SINGULAR:
        raise InputError(
            f"{held.finger.id} straight, so that its tip cannot be held by {_reactions(held)} alone",
            "a bent posture",
            f"Name angles of {', '.join(topology.rotations)}",
        )
    notes: list[str] = []
    level = _baseline(held, members, placed, activation, force_N, notes)
    remaining = _remaining(topology.muscles, members, lost or {})
    cases = [level, np.zeros_like(level), np.ones_like(level), level * remaining]
    for names in members.values():
        at = [topology.muscles.index(name) for name in names]
        for pct in LEVELS_PCT:
            case = level.copy()
            case[at] *= pct / 100.0
            cases.append(case)
    state = held.hold(placed, np.array(cases))
    tip, tension = np.asarray(state.tip), np.asarray(state.tension)
    unit = np.asarray(placed.wrench)[:3] @ np.asarray(placed.arms)
    table = tip[4:, :3].reshape(len(members), len(LEVELS_PCT), 3)
    if condition > NEAR_SINGULAR:
        notes.append(
            f"The finger is nearly straight where it is held (condition {condition:.0f}): its tip forces hang on "
            "tenths of a degree."
        )
    if not held.finger.document.get("passive"):
        notes.append("The finger's file has no passive joint torques.")
    return ActivationResult(
        finger=held.finger.id,
        muscle_set=held.muscles.id,
        rotations=topology.rotations,
        posture_deg=np.rad2deg(posture),
        muscles=topology.muscles,
        activation=level,
        tension_N=tension[0],
        passive_N=np.asarray(state.passive)[0],
        fibre=np.asarray(state.fibre)[0],
        arms_mm=np.asarray(placed.arms),
        passive_torque_Nmm=np.asarray(placed.passive_torque),
        force_N=tip[0, :3],
        torque_Nmm=tip[0, 3:],
        rest_force_N=tip[1, :3],
        alone=tuple(_alone(name, names, topology.muscles, tension[2], unit) for name, names in members.items()),
        deficits=tuple(
            Deficit(name, np.array(LEVELS_PCT), forces) for name, forces in zip(members, table, strict=True)
        ),
        lost=dict(lost or {}),
        lost_force_N=tip[3, :3] if lost else None,
        condition=condition,
        notes=tuple(notes),
    )


def _members(held: IsometricFinger) -> dict[str, list[str]]:
    """Muscles by name, the heads of one together, in the finger's order."""
    heads: dict[str, list[str]] = held.finger.document.get("heads", {})
    of = {head: name for name, names in heads.items() for head in names}
    out: dict[str, list[str]] = {}
    for muscle in held.finger.topology.muscles:
        out.setdefault(of.get(muscle, muscle), []).append(muscle)
    return out


def _posture(held: IsometricFinger, wanted: Mapping[str, float]) -> Floats:
    rotations = held.finger.topology.rotations
    angles = dict.fromkeys(rotations, 0.0) | held.finger.document.get("held", {}).get("posture_deg", {})
    for name, angle in wanted.items():
        if name not in rotations:
            raise InputError(f"no angle {name!r}", f"one of {', '.join(rotations)}")
        if not abs(angle) < 180.0:
            raise InputError(f"{name} at {angle:g} degrees", "an angle between -180 and 180 degrees")
        angles[name] = angle
    return np.deg2rad([angles[name] for name in rotations])


def _baseline(
    held: IsometricFinger,
    members: Mapping[str, Sequence[str]],
    placed: Placed,
    activation: Mapping[str, float] | None,
    force_N: Mapping[str, float] | None,
    notes: list[str],
) -> Floats:
    muscles = held.finger.topology.muscles
    if activation and force_N:
        raise InputError("activations and a force", "one of them")
    if force_N:
        wanted = np.zeros(3)
        for name, size in force_N.items():
            if name not in DIRECTIONS:
                raise InputError(f"no direction {name!r}", f"one of {', '.join(DIRECTIONS)}")
            if not np.isfinite(size):
                raise InputError(f"a force of {size:g} N", "a finite one")
            wanted += size * np.array(DIRECTIONS[name])
        try:
            return least_activity(held, placed, wanted)
        except ModelError:
            level = least_activity(held, placed, wanted, torque_free=False)
        notes.append("No activations put this force on the tip without a torque: here the clamp carries one as well.")
        return level
    if not activation:
        return np.ones(len(muscles))
    level = np.zeros(len(muscles))
    for name, share in activation.items():
        level[_indices(name, members, muscles)] = _share(name, share)
    return level


def _remaining(muscles: Sequence[str], members: Mapping[str, Sequence[str]], lost: Mapping[str, float]) -> Floats:
    left = np.ones(len(muscles))
    for name, share in lost.items():
        left[_indices(name, members, muscles)] *= 1.0 - _share(name, share)
    return left


def _indices(name: str, members: Mapping[str, Sequence[str]], muscles: Sequence[str]) -> list[int]:
    """Of a muscle, of one head, or of all heads."""
    names = members.get(name, [name])
    if any(n not in muscles for n in names):
        raise InputError(f"no muscle {name!r}", f"one of {', '.join(dict.fromkeys([*members, *muscles]))}")
    return [muscles.index(n) for n in names]


def _share(name: str, share: float) -> float:
    if not 0.0 <= share <= 1.0:
        raise InputError(f"{name} at {100.0 * share:g} %", "0 to 100 %")
    return share


def _alone(name: str, names: Sequence[str], muscles: Sequence[str], full: Floats, unit: Floats) -> MuscleForce:
    at = [muscles.index(n) for n in names]
    tension, force = float(full[at].sum()), unit[:, at] @ full[at]
    per = force / tension if tension > SMALL_N else unit[:, at].mean(axis=1)
    return MuscleForce(name, tension, force, per)


def _reactions(held: IsometricFinger) -> str:
    return ", ".join(COMPONENTS[c] for c in held.finger.topology.reactions)


def _condition(held: IsometricFinger, jacobian: Floats) -> float:
    """Of what the clamp holds, lengths in units of the finger's."""
    long = float(
        np.linalg.norm(held.finger.values.centre, axis=1).sum() + np.linalg.norm(held.finger.values.load_point)
    )
    rows = list(held.finger.topology.reactions)
    size = np.array([long if COMPONENTS[c].startswith("F") else 1.0 for c in rows])
    return float(np.linalg.cond(jacobian[rows] / size[:, None]))
