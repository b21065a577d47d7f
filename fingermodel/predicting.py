"""Predictions of any posture and load, in batches: tip force and moment, force on the bone."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from daq.errors import InputError, ModelError
from daq.vocabulary import LARGEST_FACTOR
from fingermodel.compiled.compilation import prepare_jax
from fingermodel.fingers import Finger as PlainFinger
from fingermodel.fingers.files import read_finger
from fingermodel.model import Model, clamp_forces_batch, jax_values, straight
from fingermodel.model_files import Revision, load_model, read_revision
from fingermodel.session import Session
from fingermodel.stages import LoadCaseInput
from fingermodel.structure import ANY_LAYOUT

if TYPE_CHECKING:
    from fingermodel.fingers import Finger, Topology

__all__ = ["PredictedForces", "Predictor", "predict"]

Floats = NDArray[np.float64]
Columns = Mapping[str, ArrayLike]
# What a bench can be asked: gravity [m/s2], angles [deg], and masses [g] or tensions [N].
GRAVITY_M_S2 = (5.0, 20.0)
ANGLE_DEG = (-180.0, 180.0)
MOST_LOAD = 1e6
# A straight finger turns any torque into as much force as its rounding errors allow.
_ABSURD = 20.0


@dataclass(frozen=True, eq=False)
class PredictedForces:
    """Forces that a finger exerts on what holds it, for n load cases: x proximal, y dorsal, z radial.

    Attributes:
        tip_force_N: (n, 3) in the distal phalanx's axes; NaN where a straight finger leaves it undetermined.
        tip_moment_Nmm: (n, 3) about the load point in the mid pulp.
        bone_force_N: (n, 3) in the metacarpal's axes.
    """

    tip_force_N: Floats
    tip_moment_Nmm: Floats
    bone_force_N: Floats

    def __len__(self) -> int:
        return len(self.tip_force_N)


def predict(
    model: Predictor | Finger | Revision | Session | str | os.PathLike[str],
    postures_deg: Columns,
    masses_g: Columns | None = None,
    *,
    tensions_N: Columns | None = None,
    tension_factor: float | None = None,
    gravity_m_s2: float | None = None,
) -> PredictedForces:
    """Predict the forces of load cases: row i of each column is load case i, and one number holds for all.

    Args:
        model: that predicts: a finger or its name, a revision, a session with its model, or a `Predictor` of one.
        postures_deg: angle of each joint [deg], −180 to 180, flexion positive; one left out is 0.
        masses_g: weight hung on each tendon [g], 0 to 1e6; or else
        tensions_N: the tension in each [N], 0 to 1e6.
        tension_factor: friction correction c of the weights, above 0 and up to 1.5: tension = c m g (Synek et al. 2019,
            Eq 1). By default a session's own; 1 for a finger or a revision, which know of no rig.
        gravity_m_s2: g, 5 to 20. By default a session's own; 9.81 for a finger or a revision.

    Raises:
        InputError: neither or both of weights and tensions; a number out of range; columns of different lengths.
        ModelError: a joint or tendon that the finger lacks.

    Example:
        >>> from fingermodel import predict
        >>> forces = predict("an1979_middle", {"PIP": 65.0, "DIP": [50.0, 30.0]}, {"FDP": 950.0}, tension_factor=0.835)
        >>> forces.tip_force_N.round(2)
        array([[-0.47, -1.44,  0.05],
               [ 0.03, -1.66,  0.05]])
    """
    if (masses_g is None) == (tensions_N is None):
        found = "no load" if masses_g is None else "masses_g and tensions_N"
        raise InputError(found, "one of masses_g and tensions_N")
    predictor = model if isinstance(model, Predictor) else predictor_of(model)
    topology, weight = predictor.topology, _weight_N_per_g(predictor, tension_factor, gravity_m_s2)
    degrees, rows = columns(_lists(postures_deg), topology.rotations, "joint")
    if (beyond := degrees[(degrees < ANGLE_DEG[0]) | (degrees > ANGLE_DEG[1])]).size:
        raise InputError(f"an angle of {beyond[0]:g} degrees", f"{ANGLE_DEG[0]:g} to {ANGLE_DEG[1]:g}")
    what, given = ("tendon", tensions_N) if masses_g is None else ("mass on", masses_g)
    load, more = columns(_lists(given), topology.muscles, what, rows)
    if (load < 0).any():
        raise InputError("a mass or tension below zero", "0 or more: tendons only pull")
    if (load > MOST_LOAD).any():
        raise InputError(
            f"a mass or tension of {load.max():g}", f"at most {MOST_LOAD:g}, masses in g and tensions in N"
        )
    n = max(rows, more)
    degrees, load = (np.broadcast_to(a, (n, a.shape[1])) for a in (degrees, load))
    tension = load if masses_g is None else load * weight
    return PredictedForces(**predictor.predict(np.deg2rad(degrees), np.ascontiguousarray(tension), weight))


def _weight_N_per_g(  # noqa: N802 - N is the unit
    predictor: Predictor, tension_factor: float | None, gravity_m_s2: float | None
) -> float:
    """What a gram pulls at the finger, friction included: as given, or as the predictor's session has it."""
    for name, given in (("tension_factor", tension_factor), ("gravity_m_s2", gravity_m_s2)):
        if not isinstance(given, Real | None):
            raise InputError(f"{name} {given!r:.60}", "a number")
    if tension_factor is not None and not 0.0 < tension_factor <= LARGEST_FACTOR:
        wanted = f"the friction correction c, above 0 and up to {LARGEST_FACTOR:g}"
        raise InputError(f"tension_factor {tension_factor:g}", wanted, "Leave it out for the session's own")
    if gravity_m_s2 is not None and not GRAVITY_M_S2[0] <= gravity_m_s2 <= GRAVITY_M_S2[1]:
        raise InputError(f"gravity_m_s2 {gravity_m_s2:g}", f"{GRAVITY_M_S2[0]:g} to {GRAVITY_M_S2[1]:g} m/s2, as 9.81")
    factor = predictor.tension_factor if tension_factor is None else tension_factor
    return factor * 1e-3 * (predictor.gravity_m_s2 if gravity_m_s2 is None else gravity_m_s2)


def _lists(given: Columns | None) -> dict[str, Sequence[float]]:
    """Columns of numbers as lists, a single number as a list of one."""
    if given is None or not hasattr(given, "items"):
        raise InputError(f"columns {given!r:.60}", "numbers by name, such as {'PIP': 65.0} or {'FDP': [950.0, 500.0]}")
    out: dict[str, Sequence[float]] = {}
    for name, values in given.items():
        try:
            column = np.atleast_1d(np.asarray(values, dtype=np.float64))
        except (TypeError, ValueError) as error:
            raise InputError(f"{name}: {values!r:.60}", "a number, or one for each load case") from error
        if column.ndim != 1 or not len(column) or not np.isfinite(column).all():
            raise InputError(f"{name}: {values!r:.60}", "a finite number, or one for each load case")
        out[name] = column.tolist()
    return out


def predictor_of(model: Finger | Revision | Session | str | os.PathLike[str]) -> Predictor:
    """Return what predicts with a model: itself, its file or its name."""
    if isinstance(model, Session):
        return Predictor.of_session(model)
    if isinstance(model, str | os.PathLike) and Path(model).suffix == ".json":
        model = read_revision(model)
    return Predictor(model if isinstance(model, PlainFinger | Revision) else read_finger(model))


class Predictor:
    """A finger or revision, ready to predict.

    Args:
        model: that predicts.

    Attributes:
        tension_factor: friction correction c of its session; 1 without one.
        gravity_m_s2: of its session; 9.81 without one.

    Raises:
        InputError: it cannot be used.
    """

    def __init__(self, model: Finger | Revision) -> None:
        prepare_jax()
        self.name = model.id
        self.tension_factor, self.gravity_m_s2 = 1.0, 9.81
        self._theta: Floats | None = None
        if isinstance(model, PlainFinger):
            self._model = Model(model)
            self._finger, self._plain = model, True
        else:
            loaded = load_model(model, "", model.finger.id, None, ANY_LAYOUT, Model(model.finger).budget)
            self._model, self._theta = loaded.model, loaded.theta
            # Errors of a rig belong to its session; anatomy and effects to the specimen.
            self._finger, self._plain = model.finger, not loaded.added
        self._values = jax_values(self._finger.values)

    @classmethod
    def of_session(cls, session: Session) -> Predictor:
        """Of a session's model: its anatomy, effects, friction factor and gravity, without the errors of its rig."""
        source, given = session.model, session.theta
        fitted = source.finger.replace_values(**source.values_at(given)._asdict())
        made = cls(fitted)
        model = Model(source.finger, ANY_LAYOUT, source.budget, source.effects)
        theta = model.initial
        for i, parameter in enumerate(model.parameters):
            if parameter.kind != "budget" and parameter.name in source.parameters.index:
                theta[i] = given[source.parameters.index[parameter.name]]
        effects = model.parameters.of_kind("effect")
        made.name, made._model, made._theta = session.loaded.name, model, theta
        made.tension_factor = session.measured.tension_factor
        made.gravity_m_s2 = session.measured.session.gravity_m_s2
        made._plain = bool((theta[effects] == model.initial[effects]).all())
        return made

    @property
    def topology(self) -> Topology:
        """Joints and tendons of the finger."""
        return self._finger.topology

    def predict(self, posture_rad: Floats, tension_N: Floats, weight_N_per_g: float) -> dict[str, Floats]:
        """Predict forces of the finger on what holds it.

        Args:
            posture_rad: (n, rotations) in the order of the topology.
            tension_N: (n, muscles) that reach the finger.
            weight_N_per_g: what a gram pulls at the finger, for effects that hang their own.

        Returns:
            tip_force_N (n, 3), tip_moment_Nmm (n, 3) in the distal phalanx, bone_force_N (n, 3) in the metacarpal's
            axes; NaN where a straight finger leaves them undetermined.
        """
        if self._plain:
            forces = clamp_forces_batch(self.topology, self._values, posture_rad, tension_N)
        else:
            forces = self._model.predict(_inputs(posture_rad, tension_N, weight_N_per_g), self._theta).forces
        out = np.concatenate([np.asarray(forces.tip), np.asarray(forces.bone)], axis=1)
        out[self._undetermined(posture_rad, tension_N, out[:, :6])] = np.nan
        return {"tip_force_N": out[:, :3], "tip_moment_Nmm": out[:, 3:6], "bone_force_N": out[:, 6:]}

    def _undetermined(self, q: Floats, t: Floats, tip: Floats) -> NDArray[np.intp]:
        """Rows whose posture leaves the finger straight; only forces beyond all reason are looked at twice."""
        force = np.linalg.norm(tip[:, :3], axis=1)
        odd = np.flatnonzero(~(force <= _ABSURD * t.sum(axis=1) + 1e-9) | ~np.isfinite(tip).all(axis=1))
        if not len(odd):
            return odd
        return odd[straight(self.topology, self._values, q[odd])]


def _inputs(q: Floats, t: Floats, weight: float) -> LoadCaseInput:
    """Load cases at the tip, taken at once after the tare."""
    n = len(q)
    none, no, first = np.zeros(n), np.zeros(n, bool), np.zeros(n, int)
    return LoadCaseInput.batch(
        posture=q,
        tension=t,
        at_bone=no,
        known_force=np.zeros((n, 3)),
        is_check=no,
        setting=first,
        mounting=first,
        weight=np.full(n, weight),
        unloading=no,
        since_tare=none,
        elapsed=none,
    )


def columns(
    given: Mapping[str, Sequence[float]], names: Sequence[str], what: str, length: int | None = None
) -> tuple[Floats, int]:
    """Put columns by name into one array (n, names); a column of one number holds for all rows, one left out is 0.

    Raises:
        InputError: a name that the finger lacks, or columns of different lengths.
    """
    unknown = [k for k in given if k not in names]
    if unknown:
        raise ModelError(f"{what} {unknown[0]!r:.60}", f"one of {', '.join(names)}")
    lengths = {len(v) for v in given.values()} - {1}
    if length is not None:
        lengths |= {length} - {1}
    if len(lengths) > 1:
        raise InputError(f"{what} columns of {', '.join(map(str, sorted(lengths)))} rows", "as many rows in each, or 1")
    n = max(lengths, default=1)
    out = np.zeros((n, len(names)))
    for name, values in given.items():
        out[:, names.index(name)] = values
    return out, n
