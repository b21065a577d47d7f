"""Joint torques and muscle forces of a recorded movement: inverse dynamics, passive forces, min/max recruitment."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from daq.errors import InputError
from daq.plain_json import clean
from fingermodel.compiled.compilation import prepare_jax
from fingermodel.dynamics.inertia import chain_inertia
from fingermodel.dynamics.inverse import inverse_dynamics
from fingermodel.dynamics.motion import Motion, read_motion
from fingermodel.fingers.files import read_finger
from fingermodel.muscles.hill import at_rest
from fingermodel.muscles.muscle_files import MuscleSet, read_muscles
from fingermodel.recruitment.minmax import min_max
from fingermodel.recruitment.moments import arms_and_excursions

if TYPE_CHECKING:
    from fingermodel.fingers import Finger

Floats = NDArray[np.float64]
STEPS = 200
MOST_STEPS = 20_000


@dataclass(frozen=True, eq=False)
class MovementResult:
    """A movement and what drives it, over time.

    Attributes:
        motion: name of the movement.
        finger: name of the finger.
        muscle_set: name of the muscles' parameter set.
        rotations: names of the joint angles.
        muscles: their names.
        times_s: (n,).
        posture_rad: (n, rotations).
        rate_rad_s: (n, rotations).
        acceleration_rad_s2: (n, rotations).
        tip_force_N: (n, 3) on the finger, axes of the first bone.
        torque_Nmm: (n, rotations) that all muscles exert together, flexion positive.
        passive_N: (n, muscles) tension of the muscle at rest.
        active_N: (n, muscles) beyond it, by recruitment.
        activity: (n, muscles) active force over the greatest isometric force.
        activation: (n, muscles) active force over what the fibre could give at its length and speed.
        length_mm: (n, muscles) of muscle and tendon together.
        programmes: linear programmes that were solved one by one.
    """

    motion: str
    finger: str
    muscle_set: str
    rotations: tuple[str, ...]
    muscles: tuple[str, ...]
    times_s: Floats
    posture_rad: Floats
    rate_rad_s: Floats
    acceleration_rad_s2: Floats
    tip_force_N: Floats
    torque_Nmm: Floats
    passive_N: Floats
    active_N: Floats
    activity: Floats
    activation: Floats
    length_mm: Floats
    programmes: int

    @property
    def force(self) -> Floats:
        """(n, muscles) active and passive force together."""
        total: Floats = self.active_N + self.passive_N
        return total

    def contact_s(self) -> tuple[float, float] | None:
        """First and last time at which the tip force exceeds a twentieth of its peak; None without a tip force."""
        size = np.linalg.norm(self.tip_force_N, axis=1)
        touching = np.flatnonzero(size > 0.05 * size.max()) if size.any() else np.array([], dtype=int)
        return (float(self.times_s[touching[0]]), float(self.times_s[touching[-1]])) if len(touching) else None

    def peaks(self) -> list[dict[str, Any]]:
        """Peak of every muscle: force [N], time [s], passive share, and force over the tip force's peak."""
        force, tip = self.force, float(np.linalg.norm(self.tip_force_N, axis=1).max())
        out: list[dict[str, Any]] = []
        for i, name in enumerate(self.muscles):
            at = int(force[:, i].argmax())
            peak = float(force[at, i])
            out.append(
                {
                    "muscle": name,
                    "peak_N": peak,
                    "at_s": float(self.times_s[at]),
                    "passive_share": float(self.passive_N[at, i]) / peak if peak > 0.0 else 0.0,
                    "over_tip_force": peak / tip if tip > 0.0 else None,
                    "largest_activation": float(self.activation[:, i].max()),
                }
            )
        return out

    def as_dict(self) -> dict[str, Any]:
        """Return plain data: columns over time as lists, by rotation or by muscle."""
        contact = self.contact_s()
        named: dict[str, Any] = {
            "motion": self.motion,
            "finger": self.finger,
            "muscle_set": self.muscle_set,
            "rotations": self.rotations,
            "muscles": self.muscles,
            "contact_s": list(contact) if contact else None,
            "peaks": self.peaks(),
            "peak_torque_Nmm": {
                name: {"greatest": float(t.max()), "least": float(t.min())}
                for name, t in zip(self.rotations, self.torque_Nmm.T, strict=True)
            },
            "times_s": self.times_s,
            "tip_force_N": self.tip_force_N,
        }
        by_rotation = {
            "angle_deg": np.rad2deg(self.posture_rad),
            "rate_deg_s": np.rad2deg(self.rate_rad_s),
            "acceleration_deg_s2": np.rad2deg(self.acceleration_rad_s2),
            "torque_Nmm": self.torque_Nmm,
        }
        by_muscle = {
            "force_N": self.force,
            "active_N": self.active_N,
            "passive_N": self.passive_N,
            "activation": self.activation,
            "length_mm": self.length_mm,
        }
        for names, columns in ((self.rotations, by_rotation), (self.muscles, by_muscle)):
            for key, values in columns.items():
                named[key] = dict(zip(names, values.T, strict=True))
        plain: dict[str, Any] = clean(named)
        return plain


def move(motion: str, finger: str, muscles: str, steps: int = STEPS, *, gravity: bool = True) -> MovementResult:
    """Work out a recorded movement.

    Args:
        motion: name of a shipped movement, or a motion file.
        finger: name of a shipped finger, or a finger file, with the inertia of its bones.
        muscles: name of a shipped muscle set, or a muscle file.
        steps: instants over the movement's span.
        gravity: False leaves the motion's gravity out.

    Raises:
        InputError: a file that cannot be used, or torques beyond the muscles' strength.
    """
    if not 2 <= steps <= MOST_STEPS:
        raise InputError(f"{steps} steps", f"2 to {MOST_STEPS}")
    read = read_finger(finger)
    return work_out(read_motion(motion), read, read_muscles(muscles, read), steps, gravity=gravity)


def work_out(
    motion: Motion,
    finger: Finger,
    muscles: MuscleSet,
    steps: int = STEPS,
    *,
    gravity: bool = True,
    curve: tuple[str, int] | None = None,
) -> MovementResult:
    """Torques by inverse dynamics, passive forces by the muscles' lengths, the rest by min/max recruitment.

    Args:
        motion: the movement.
        finger: with the inertia of its bones.
        muscles: in the finger's order.
        steps: instants over the movement's span.
        gravity: False leaves the motion's gravity out.
        curve: through the angles in place of the motion's own, such as `("polynomial", 4)`.

    Raises:
        ModelError: the finger has no inertia, the motion lacks a joint, or torques are beyond the muscles' strength.
    """
    prepare_jax()
    topology, values = finger.topology, finger.values
    inertia = chain_inertia(finger)
    times = motion.times(steps)
    movement = motion.sample(topology, times, curve=curve)
    pull = motion.gravity_mm_s2 if gravity else np.zeros(3)
    torque = np.asarray(inverse_dynamics(topology, values, inertia, pull, movement).torque)
    posture, rate = np.asarray(movement.posture), np.asarray(movement.rate)
    arms, longer = arms_and_excursions(topology, values, muscles.calibration, posture)
    length = muscles.length_mm + longer
    lengthening = -np.einsum("nrm,nr->nm", arms, rate)
    passive, capacity = map(
        np.asarray,
        at_rest(muscles.curves, muscles.values, muscles.max_speed_mm_s, length, lengthening),
    )
    strength = np.asarray(muscles.values.max_force)
    left = torque - np.einsum("nrm,nm->nr", arms, passive)
    shared = min_max(arms, left, strength, rotations=topology.rotations, times_s=times)
    return MovementResult(
        motion=motion.id,
        finger=finger.id,
        muscle_set=muscles.id,
        rotations=topology.rotations,
        muscles=topology.muscles,
        times_s=times,
        posture_rad=posture,
        rate_rad_s=rate,
        acceleration_rad_s2=np.asarray(movement.acceleration),
        tip_force_N=np.asarray(movement.tip_force),
        torque_Nmm=torque,
        passive_N=passive,
        active_N=shared.force,
        activity=shared.activity,
        activation=shared.force / np.maximum(capacity, 1e-12),
        length_mm=length,
        programmes=shared.programmes,
    )
