"""One of two fingers that are compared: its bones, moment arms, and what every load makes of it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fingermodel.comparison.comparison import muscles_of
from fingermodel.fingers import require_plane
from fingermodel.scaling import mean_moment_arms, phalanx_lengths
from fingermodel.session import Session

if TYPE_CHECKING:
    from fingermodel.fingers import Finger, Plane

Floats = NDArray[np.float64]
RATIOS = ("tension_to_tip", "bone_to_tip")
PLANES: tuple[Plane, ...] = ("space", "sagittal")


@dataclass(frozen=True, eq=False)
class Load:
    """One load on one finger in one posture: forces on the cell [N], measured ones None where there are none.

    Attributes:
        posture: name.
        masses_g: hung on each tendon.
        tension_N: of all tendons together, corrected for friction.
        tip_N: (3,) predicted, axes of the last bone.
        bone_N: (3,) predicted, axes of the first bone.
        joint_N: (3,) predicted, of the second bone on the first.
        measured_tip_N: (3,).
        measured_bone_N: (3,).
    """

    posture: str
    masses_g: dict[str, float]
    tension_N: float
    tip_N: Floats
    bone_N: Floats
    joint_N: Floats
    measured_tip_N: Floats | None
    measured_bone_N: Floats | None

    @property
    def tendons(self) -> str:
        """Loaded tendons, such as `FDP+FDS`."""
        return muscles_of(self.masses_g)

    def ratios(self, *, measured: bool = False, plane: Plane = "space") -> dict[str, float | None]:
        """Tension and bone force over tip force, as published, and tip and bone force over tension.

        Raises:
            InputError: there is no such plane.
        """
        forces = (self.measured_tip_N, self.measured_bone_N) if measured else (self.tip_N, self.bone_N)
        axes = 2 if require_plane(plane) == "sagittal" else 3
        tip, bone = (None if f is None else float(np.linalg.norm(f[:axes])) for f in forces)
        return {
            "tension_to_tip": over(self.tension_N, tip),
            "bone_to_tip": over(bone, tip),
            "tip_per_tension": over(tip, self.tension_N),
            "bone_per_tension": over(bone, self.tension_N),
        }

    def directions_deg(self, *, measured: bool = False) -> dict[str, float | None]:
        """Directions in the sagittal plane, 0° proximal and 90° dorsal; the joint's is predicted alone."""
        tip = self.measured_tip_N if measured else self.tip_N
        bone = self.measured_bone_N if measured else self.bone_N
        joint = None if measured else self.joint_N
        return {"tip": _direction(tip), "bone": _direction(bone), "joint": _direction(joint)}

    def as_dict(self) -> dict[str, Any]:
        """Return plain data."""
        return {
            "posture": self.posture,
            "masses_g": self.masses_g,
            "tension_N": self.tension_N,
            "predicted": self._part(measured=False),
            "measured": None if self.measured_tip_N is None else self._part(measured=True),
        }

    def _part(self, *, measured: bool) -> dict[str, Any]:
        forces = (self.measured_tip_N, self.measured_bone_N) if measured else (self.tip_N, self.bone_N)
        return dict(zip(("tip_N", "bone_N"), forces, strict=True)) | {
            "ratios": {plane: self.ratios(measured=measured, plane=plane) for plane in PLANES},
            "direction_deg": self.directions_deg(measured=measured),
        }


@dataclass(frozen=True)
class Spread:
    """Mean, least and most over loads."""

    mean: float
    least: float
    most: float
    loads: int


@dataclass(frozen=True, eq=False)
class Side:
    """One of the two fingers.

    Attributes:
        name: of the finger or revision.
        species: of its session's specimen, None where there is none.
        finger: with the numbers in use.
        session: whose measured forces are its own; None where there are none.
        loads_of: session that it is loaded as.
        postures_rad: (rotations,) each, by name.
        loads: every load that was read at the tip.
        lengths_mm: of every phalanx, where known.
        arms_mm: mean flexion moment arm over the postures, by segment.
    """

    name: str
    species: str | None
    finger: Finger
    session: str | None
    loads_of: str
    postures_rad: dict[str, Floats]
    loads: tuple[Load, ...]
    lengths_mm: dict[str, float]
    arms_mm: dict[str, float]

    @property
    def label(self) -> str:
        """For the reader: with the species, where it is known."""
        return f"{self.species} ({self.name})" if self.species else self.name

    def of_tendons(self, tendons: str) -> list[Load]:
        """Loads on these tendons alone."""
        return [load for load in self.loads if load.tendons == tendons]

    def spread(self, tendons: str, ratio: str, *, measured: bool = False, plane: Plane = "space") -> Spread | None:
        """A ratio over all loads on these tendons; None where there are none."""
        every = [load.ratios(measured=measured, plane=plane)[ratio] for load in self.of_tendons(tendons)]
        found = [x for x in every if x is not None]
        return Spread(float(np.mean(found)), min(found), max(found), len(found)) if found else None

    def turning(self, tendons: str, what: str, *, measured: bool = False) -> tuple[float, float] | None:
        """How a force's direction goes with flexion of the first joint: correlation, and range [deg]."""
        first = self.finger.topology.joints[0]
        row = max(first.flexion, 0)
        pairs = [
            (float(self.postures_rad[load.posture][row]), angle)
            for load in self.of_tendons(tendons)
            if (angle := load.directions_deg(measured=measured)[what]) is not None
        ]
        if len(pairs) < 3 or min(float(np.ptp(column)) for column in zip(*pairs, strict=True)) == 0.0:
            return None
        flexion, angles = np.array(pairs).T
        turned = np.rad2deg(np.unwrap(np.deg2rad(angles)))
        return float(np.corrcoef(flexion, turned)[0, 1]), float(np.ptp(turned))

    def as_dict(self) -> dict[str, Any]:
        """Return plain data."""
        return {
            "finger": self.name,
            "species": self.species,
            "title": self.finger.title,
            "session": self.session,
            "loads_of": self.loads_of,
            "bones_mm": self.lengths_mm,
            "mean_moment_arms_mm": self.arms_mm,
            "postures_deg": {
                name: dict(zip(self.finger.topology.rotations, np.rad2deg(q).tolist(), strict=True))
                for name, q in self.postures_rad.items()
            },
            "loads": [load.as_dict() for load in self.loads],
        }


def open_side(model: str | None, session: str | None, loads_of: str) -> Side:
    """Load one side.

    Args:
        model: finger, finger file or revision; by default that of the loads' session.
        session: whose measured forces are its own; None where there are none.
        loads_of: session that it is loaded as.

    Raises:
        InputError: a finger or session that cannot be read, or that do not fit together.
    """
    bench = Session.open(loads_of, model, catalogue=False)
    finger = replace(bench.model.finger, values=bench.model.values_at(bench.theta))
    postures = {name: np.asarray(q) for name, q in bench.observations.posture_angles.items()}
    arms = mean_moment_arms(finger, list(postures.values()))
    specimen = bench.measured.session.specimen if session else None
    return Side(
        name=bench.loaded.name,
        species=getattr(specimen, "species", None),
        finger=finger,
        session=session,
        loads_of=loads_of,
        postures_rad=postures,
        loads=tuple(_loads(bench, measured=session is not None)),
        lengths_mm=_proximal_first(finger, phalanx_lengths(finger)),
        arms_mm=dict(zip((s.name for s in finger.topology.segments), arms.tolist(), strict=True)),
    )


def _proximal_first(finger: Finger, lengths: dict[str, float]) -> dict[str, float]:
    return {bone: lengths[bone] for bone in finger.topology.bones if bone in lengths}


def _loads(bench: Session, *, measured: bool) -> Iterable[Load]:
    """One load for each posture and masses read at the tip, with the bone's reading of the same; repeats averaged."""
    observed, prediction = bench.observations, bench.model.predict(bench.observations.inputs, bench.theta)
    tip, bone = np.asarray(prediction.forces.tip)[:, :3], np.asarray(prediction.forces.bone)
    joint, tension = np.asarray(prediction.joint)[:, 0], np.asarray(observed.inputs.tension).sum(axis=1)
    groups: dict[tuple[str, tuple[tuple[str, float], ...]], dict[str, list[int]]] = {}
    for i, (role, posture, masses) in enumerate(zip(observed.roles, observed.postures, observed.masses_g, strict=True)):
        hung = tuple(sorted((m, g) for m, g in masses.items() if g))
        if role != "check" and hung:
            groups.setdefault((posture, hung), {"tip": [], "bone": []})[observed.locations[i]].append(i)
    for (posture, hung), at in groups.items():
        if not at["tip"]:
            continue
        every = at["tip"] + at["bone"]
        yield Load(
            posture=posture,
            masses_g=dict(hung),
            tension_N=float(tension[every].mean()),
            tip_N=tip[every].mean(axis=0),
            bone_N=bone[every].mean(axis=0),
            joint_N=joint[every].mean(axis=0),
            measured_tip_N=observed.wrench[at["tip"], :3].mean(axis=0) if measured else None,
            measured_bone_N=observed.wrench[at["bone"], :3].mean(axis=0) if measured and at["bone"] else None,
        )


def shared(a: dict[str, float], b: dict[str, float]) -> list[tuple[str, float | None, float | None]]:
    """Every name of either with its two values."""
    return [(name, a.get(name), b.get(name)) for name in dict.fromkeys([*a, *b])]


def same_angles(first: Side, second: Side, posture: str) -> bool:
    """Whether two sides set the same angles in a posture that both have, joint by joint."""
    a, b = (
        dict(zip(side.finger.topology.rotations, side.postures_rad[posture].tolist(), strict=True))
        for side in (first, second)
    )
    return all(abs(a.get(name, 0.0) - b.get(name, 0.0)) < 1e-6 for name in {*a, *b})


def _direction(force: Floats | None) -> float | None:
    if force is None or not np.hypot(*force[:2]) > 0.0:
        return None
    return float(np.rad2deg(np.arctan2(force[1], force[0])))


def over(a: float | None, b: float | None) -> float | None:
    """The ratio of two numbers, None where it cannot be had."""
    return None if a is None or b is None or b == 0.0 else a / b
