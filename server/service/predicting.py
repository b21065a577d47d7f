"""Predictions of any posture and load, in batches: tip force and moment, force on the bone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from daq.errors import InputError, ModelError

if TYPE_CHECKING:
    from fingermodel.fingers import Finger, Topology
    from fingermodel.model_files import Revision

Floats = NDArray[np.float64]
# Sizes that are compiled; larger batches go in portions of the last.
SIZES = (1, 16, 128, 1024, 8192)
# A straight finger turns any torque into as much force as its rounding errors allow.
_ABSURD = 20.0
_STRAIGHT = 1e6


class Predictor:
    """A finger or revision, ready to predict.

    Args:
        model: that predicts.

    Raises:
        InputError: it cannot be used.
    """

    def __init__(self, model: Finger | Revision) -> None:
        from fingermodel.fingers import Finger as PlainFinger
        from fingermodel.model import ANY_LAYOUT, Model, jax_values
        from fingermodel.model_files import load_model
        from server.application.workflow import prepare_jax

        prepare_jax()
        self.name = model.id
        if isinstance(model, PlainFinger):
            self._model, self._theta = Model(model), None
            self._finger, self._plain = model, True
        else:
            loaded = load_model(model, "", model.finger.id, None, ANY_LAYOUT, Model(model.finger).budget)
            self._model, self._theta = loaded.model, loaded.theta
            # Errors of a rig belong to its session; anatomy and effects to the specimen.
            self._finger, self._plain = model.finger, not loaded.added
        self._values = jax_values(self._finger.values)

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
        n, parts = len(posture_rad), []
        for a in range(0, n, SIZES[-1]):
            q, t = posture_rad[a : a + SIZES[-1]], tension_N[a : a + SIZES[-1]]
            rows = np.minimum(np.arange(next(s for s in SIZES if s >= len(q))), len(q) - 1)
            tip, bone = self._forces(q[rows], t[rows], weight_N_per_g)
            parts.append(np.concatenate([tip[: len(q)], bone[: len(q)]], axis=1))
        out = np.concatenate(parts)
        out[self._undetermined(posture_rad, tension_N, out[:, :6])] = np.nan
        return {"tip_force_N": out[:, :3], "tip_moment_Nmm": out[:, 3:6], "bone_force_N": out[:, 6:]}

    def _forces(self, q: Floats, t: Floats, weight: float) -> tuple[Floats, Floats]:
        from fingermodel.model import clamp_forces_batch

        if self._plain:
            forces = clamp_forces_batch(self.topology, self._values, q, t)
            return np.asarray(forces.tip), np.asarray(forces.bone)
        forces = self._model.predict(_inputs(q, t, weight), self._theta).forces
        return np.asarray(forces.tip), np.asarray(forces.bone)

    def _undetermined(self, q: Floats, t: Floats, tip: Floats) -> NDArray[np.intp]:
        """Rows whose posture leaves the finger straight; only forces beyond all reason are looked at twice."""
        from fingermodel.model import tip_kinematics_batch

        force = np.linalg.norm(tip[:, :3], axis=1)
        odd = np.flatnonzero(~(force <= _ABSURD * t.sum(axis=1) + 1e-9) | ~np.isfinite(tip).all(axis=1))
        if not len(odd):
            return odd
        rows = odd[np.minimum(np.arange(-(-len(odd) // SIZES[1]) * SIZES[1]), len(odd) - 1)]
        jacobian = np.asarray(tip_kinematics_batch(self.topology, self._values, q[rows]).jacobian)
        unit = np.array([[1.0 if c < 3 else 20.0] for c in self.topology.reactions])
        square = (jacobian[:, list(self.topology.reactions)] * unit)[: len(odd)]
        finite = np.isfinite(square).all(axis=(1, 2))
        condition = np.full(len(odd), np.inf)
        condition[finite] = np.linalg.cond(square[finite])
        return odd[condition > _STRAIGHT]


def _inputs(q: Floats, t: Floats, weight: float) -> Any:
    """Load cases at the tip, taken at once after the tare."""
    from fingermodel.stages import LoadCaseInput

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
        raise ModelError(f"{what} {unknown[0][:60]!r}", f"one of {', '.join(names)}")
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
