"""What activated muscles do at the tip, and what deficits change: the answer as data and as a table."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
# Which components of (proximal, dorsal, radial) span a plane.
PLANES = {"sagittal": (0, 1), "coronal": (0, 2)}
# Directions of smaller forces mean nothing [N].
SMALL_N = 1e-6


@dataclass(frozen=True, eq=False)
class MuscleForce:
    """What one muscle alone does at the tip; a muscle with heads is their sum.

    Attributes:
        muscle: its name.
        tension_N: of all its tendons at full activation.
        force_N: (3,) that puts on the clamp, most distal bone's axes.
        per_newton: (3,) per newton of tension, shared by the heads in proportion to their tensions.
    """

    muscle: str
    tension_N: float
    force_N: Floats
    per_newton: Floats

    def as_dict(self) -> dict[str, Any]:
        """Return plain data."""
        planes = {
            name: {"magnitude_N": float(np.hypot(*part)), "direction_deg": direction_deg(part)}
            for name, part in ((n, self.force_N[list(axes)]) for n, axes in PLANES.items())
        }
        return {
            "muscle": self.muscle,
            "tension_N": self.tension_N,
            "force_N": self.force_N,
            "force_N_per_N": self.per_newton,
            **planes,
        }


@dataclass(frozen=True, eq=False)
class Deficit:
    """The tip force while one muscle loses activation and the others keep theirs.

    Attributes:
        muscle: its name.
        levels_pct: (n,) what is left of its activation.
        force_N: (n, 3) on the clamp, most distal bone's axes.
    """

    muscle: str
    levels_pct: Floats
    force_N: Floats

    @property
    def magnitudes(self) -> Floats:
        """(n,) of the force in space [N]."""
        size: Floats = np.linalg.norm(self.force_N, axis=1)
        return size

    def change_deg(self, plane: str | None = None) -> list[float | None]:
        """Angle to the force at full activation, in space or in a plane; None where a force has no direction."""
        axes = list(PLANES[plane]) if plane else [0, 1, 2]
        forces = self.force_N[:, axes]
        return [angle_between(forces[0], force) for force in forces]

    @property
    def change_pct(self) -> list[float | None]:
        """Change of the magnitude from that at full activation; None where there is none."""
        size = self.magnitudes
        return [float(100.0 * (x / size[0] - 1.0)) if size[0] > SMALL_N else None for x in size]

    def as_dict(self) -> dict[str, Any]:
        """Return plain data."""
        return {
            "muscle": self.muscle,
            "levels_pct": self.levels_pct,
            "force_N": self.force_N,
            "magnitude_N": self.magnitudes,
            "magnitude_change_pct": self.change_pct,
            "direction_change_deg": self.change_deg(),
            "sagittal_change_deg": self.change_deg("sagittal"),
            "coronal_change_deg": self.change_deg("coronal"),
        }


@dataclass(frozen=True, eq=False)
class ActivationResult:
    """A finger held at the tip with its muscles active.

    Attributes:
        finger: name of the finger.
        muscle_set: name of the muscles' parameter set.
        rotations: names of the joint angles.
        posture_deg: (rotations,).
        muscles: names of the muscles, heads apart.
        activation: (muscles,) of the baseline, 0 to 1.
        tension_N: (muscles,) there.
        passive_N: (muscles,) part of it from the parallel elements.
        fibre: (muscles,) length of the fibres there, in optimal lengths.
        arms_mm: (rotations, muscles) moment arms, flexion positive.
        passive_torque_Nmm: (rotations,) of the joints themselves.
        force_N: (3,) of the baseline on the clamp: proximal, dorsal, radial in the most distal bone's axes.
        torque_Nmm: (3,) about the load point.
        rest_force_N: (3,) with no muscle active.
        alone: what each muscle does alone.
        deficits: of each muscle in turn.
        lost: share of the activation that each named muscle loses, where that was asked for.
        lost_force_N: (3,) with all of those losses together; None where none was asked for.
        condition: of the clamped finger, lengths over its longest one; large is near singular.
        notes: what the reader should know.
    """

    finger: str
    muscle_set: str
    rotations: tuple[str, ...]
    posture_deg: Floats
    muscles: tuple[str, ...]
    activation: Floats
    tension_N: Floats
    passive_N: Floats
    fibre: Floats
    arms_mm: Floats
    passive_torque_Nmm: Floats
    force_N: Floats
    torque_Nmm: Floats
    rest_force_N: Floats
    alone: tuple[MuscleForce, ...]
    deficits: tuple[Deficit, ...]
    lost: dict[str, float]
    lost_force_N: Floats | None
    condition: float
    notes: tuple[str, ...] = ()

    def deficit(self, muscle: str) -> Deficit:
        """The deficits of one muscle."""
        return next(d for d in self.deficits if d.muscle == muscle)

    def as_dict(self) -> dict[str, Any]:
        """Return plain data."""
        by_muscle = {
            "activation": self.activation,
            "tension_N": self.tension_N,
            "passive_N": self.passive_N,
            "fibre_length": self.fibre,
        }
        together = None
        if self.lost_force_N is not None:
            together = {
                "lost_pct": {name: 100.0 * share for name, share in self.lost.items()},
                "force_N": self.lost_force_N,
                "magnitude_N": float(np.linalg.norm(self.lost_force_N)),
                "direction_change_deg": angle_between(self.force_N, self.lost_force_N),
            }
        return {
            "finger": self.finger,
            "muscle_set": self.muscle_set,
            "posture_deg": dict(zip(self.rotations, self.posture_deg, strict=True)),
            "muscles": self.muscles,
            **{key: dict(zip(self.muscles, values, strict=True)) for key, values in by_muscle.items()},
            "moment_arms_mm": {
                name: dict(zip(self.muscles, row, strict=True))
                for name, row in zip(self.rotations, self.arms_mm, strict=True)
            },
            "passive_torque_Nmm": dict(zip(self.rotations, self.passive_torque_Nmm, strict=True)),
            "force_N": self.force_N,
            "torque_Nmm": self.torque_Nmm,
            "magnitude_N": float(np.linalg.norm(self.force_N)),
            "rest_force_N": self.rest_force_N,
            "alone": [m.as_dict() for m in self.alone],
            "deficits": [d.as_dict() for d in self.deficits],
            "together": together,
            "condition": self.condition,
            "activation_notes": list(self.notes),
        }


def direction_deg(part: Floats) -> float | None:
    """Angle of a force in a plane, from proximal towards dorsal or radial; None where it has no direction."""
    return float(np.rad2deg(np.arctan2(part[1], part[0]))) if np.hypot(*part) > SMALL_N else None


def angle_between(one: Floats, other: Floats) -> float | None:
    """Angle between two forces, 0 to 180 degrees; None where one has no direction."""
    sizes = float(np.linalg.norm(one)), float(np.linalg.norm(other))
    if min(sizes) <= SMALL_N:
        return None
    one, other = one / sizes[0], other / sizes[1]
    # Half of the chord keeps small angles exact.
    return float(2.0 * np.rad2deg(np.arctan2(np.linalg.norm(one - other), np.linalg.norm(one + other))))
