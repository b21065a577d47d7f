"""MuJoCo as a rival for batches: its own compiled loop for what it can do, NumPy for the rest."""

from __future__ import annotations

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from benchmarks.numpy_finger import cross, solve
from fingermodel.fingers import FingerValues, Topology
from tests.fingermodel.mujoco_finger import MujocoFinger, sharing

Floats = NDArray[np.float64]

# Cases a pass: MuJoCo's results of one pass stay in the cache; measured best.
CHUNK = 1024


class MujocoBatch:
    """Forces of a clamped finger with straight tendons, for batches of postures and tensions."""

    def __init__(self, topology: Topology, values: FingerValues) -> None:
        finger = MujocoFinger(topology, values)
        self.rows = list(topology.reactions)
        self.sharing = sharing(topology, values)
        self.suture = np.asarray(values.suture)
        self.tip = finger.tip
        self.batch = Batch(finger.model, CHUNK, nthread=1)
        self.segment = finger.tendon_rows
        columns = np.arange(finger.model.nv)
        self.to_rotation = -(finger.model.ten_J_colind[:, None] == columns).astype(float)
        self.posture = self.batch.bind("qpos")
        self.length_rate = self.batch.bind("ten_J")
        self.axis, self.anchor = self.batch.bind("xaxis"), self.batch.bind("xanchor")
        self.place, self.frame = self.batch.bind("site_xpos"), self.batch.bind("site_xmat")

    def forces(self, posture: Floats, tension: Floats) -> tuple[Floats, Floats]:
        """Tip wrench (n, 6) and bone force (n, 3) of postures (n, rotations) [rad] and tensions (n, muscles) [N]."""
        n = len(posture)
        tip, bone = np.zeros((n, 6)), np.empty((n, 3))
        for first in range(0, n, CHUNK):
            count = min(CHUNK, n - first)
            at = slice(first, first + count)
            self.posture[:count] = posture[at]
            self.batch.forward(stage=mujoco.mjtStage.mjSTAGE_POS)
            tip[at], bone[at] = self._forces(count, tension[at])
        return tip, bone

    def _forces(self, count: int, tension: Floats) -> tuple[Floats, Floats]:
        pulls = (tension @ self.sharing.T)[:, self.segment]
        torque = (self.length_rate[:count] * pulls) @ self.to_rotation
        # Cases last, as the solution wants them; components first.
        to_base = self.frame[:count, self.tip].reshape(count, 3, 3).transpose(1, 2, 0).copy()
        spin = self.axis[:count].transpose(2, 1, 0).copy()
        lever = (self.place[:count, None, self.tip] - self.anchor[:count]).transpose(2, 1, 0)
        in_tip = [_to_tip(to_base, cross(spin, lever)), _to_tip(to_base, list(spin))]
        jacobian = [*in_tip[0], *in_tip[1]]
        rotations = range(spin.shape[1])
        wrench = np.zeros((6, count))
        wrench[self.rows] = solve([[jacobian[r][k] for r in self.rows] for k in rotations], torque.T)
        at_tip = sum(to_base[:, c] * wrench[c] for c in range(3))
        return wrench.T, tension @ self.suture - np.asarray(at_tip).T


def _to_tip(to_base: Floats, vectors: list[Floats]) -> list[Floats]:
    return [sum((to_base[c, i] * vectors[c] for c in range(1, 3)), to_base[0, i] * vectors[0]) for i in range(3)]
