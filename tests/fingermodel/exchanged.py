"""Exported fingers as MuJoCo and OpenSim compute them, and fingers to export."""

from __future__ import annotations

import re
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from fingermodel.fingers import Finger
from fingermodel.fingers.files import finger_names, read_finger
from fingermodel.hood.parts import ElasticHood
from fingermodel.model import clamp_forces_batch, jax_values, tip_kinematics_batch
from tests.fingermodel.fingers import six_axes, straight
from tests.requirements import demanded

Floats = NDArray[np.float64]
MM = 1000.0
# Beyond it the tip force hangs on rounding: the clamped finger is all but singular there.
WORST_CONDITION = 1e3


def required(name: str) -> Any:
    """Return a module, skip with a line where it is not installed, and fail where it has to be."""
    if demanded(name):
        return import_module(name)
    return pytest.importorskip(name)


class Answer(NamedTuple):
    """What other software says of one posture.

    Attributes:
        moment_arms: (rotations, segments) [mm].
        jacobian: (6, rotations) of the load point, mm/rad over rad/rad, in the most distal bone's axes.
        torque: (rotations,) of the muscles [N mm].
    """

    moment_arms: Floats
    jacobian: Floats
    torque: Floats

    def tip(self, reactions: tuple[int, ...]) -> Floats:
        """Tip wrench (6,) [N, N mm]."""
        wrench = np.zeros(6)
        wrench[list(reactions)] = np.linalg.solve(self.jacobian[list(reactions)].T, self.torque)
        return wrench


class Software(Protocol):
    def ask(self, posture: Floats, tension: Floats) -> Answer: ...


class InMujoco:
    """An MJCF file of ours."""

    def __init__(self, text: str, rotations: tuple[str, ...], muscles: tuple[str, ...], segments: list[str]) -> None:
        import mujoco

        self.mujoco = mujoco
        self.model = mujoco.MjModel.from_xml_string(text)
        self.data = mujoco.MjData(self.model)
        kinds = mujoco.mjtObj
        self.angles = [self.model.joint(name).qposadr[0] for name in rotations]
        self.speeds = [self.model.joint(name).dofadr[0] for name in rotations]
        self.controls = [self._id(kinds.mjOBJ_ACTUATOR, name) for name in muscles]
        self.tendons = [self._id(kinds.mjOBJ_TENDON, name) for name in segments]
        self.tip = self._id(kinds.mjOBJ_SITE, "load_point")

    def _id(self, kind: Any, name: str) -> int:
        number = int(self.mujoco.mj_name2id(self.model, kind, name))
        assert number >= 0, name
        return number

    def ask(self, posture: Floats, tension: Floats) -> Answer:
        model, data = self.model, self.data
        data.qpos[self.angles] = posture
        data.ctrl[self.controls] = tension
        self.mujoco.mj_forward(model, data)
        rate = np.zeros((model.ntendon, model.nv))
        rate[np.repeat(np.arange(model.ntendon), model.ten_J_rownnz), model.ten_J_colind] = data.ten_J
        in_base = np.zeros((2, 3, model.nv))
        self.mujoco.mj_jacSite(model, data, in_base[0], in_base[1], self.tip)
        jacobian = (data.site_xmat[self.tip].reshape(3, 3).T @ in_base).reshape(6, model.nv)[:, self.speeds]
        jacobian[:3] *= MM
        return Answer(-rate[self.tendons][:, self.speeds].T * MM, jacobian, data.qfrc_actuator[self.speeds] * MM)


class InOpensim:
    """An `.osim` file of ours, its muscles shared out by the table in its comment."""

    def __init__(self, path: Path, rotations: tuple[str, ...], tip_bone: str, segments: list[str]) -> None:
        import opensim

        # It would write opensim.log where it is run.
        opensim.Logger.removeFileSink()
        opensim.Logger.setLevelString("warn")
        self.opensim = opensim
        self.model = opensim.Model(str(path))
        self.state = self.model.initSystem()
        self.coordinates = [self.model.getCoordinateSet().get(name) for name in rotations]
        forces = self.model.getForceSet()
        self.actuators = [opensim.PathActuator.safeDownCast(forces.get(name)) for name in segments]
        for actuator in self.actuators:
            actuator.overrideActuation(self.state, True)
        self.inverse = opensim.InverseDynamicsSolver(self.model)
        self.body = self.model.getBodySet().get(tip_bone)
        place = self.model.getMarkerSet().get("load_point").get_location()
        self.place = opensim.Vec3(place[0], place[1], place[2])
        rows = dict(re.findall(r"^ +([\w.#]+): ((?:[\d.e-]+ ?)+)$", path.read_text(encoding="utf-8"), re.MULTILINE))
        # Without a table every segment is driven by its own tension.
        own = np.eye(len(segments))
        self.shares = np.array([[float(x) for x in rows[name].split()] for name in segments]) if rows else own

    def ask(self, posture: Floats, tension: Floats) -> Answer:
        opensim, model, state = self.opensim, self.model, self.state
        for coordinate, angle in zip(self.coordinates, posture, strict=True):
            coordinate.setValue(state, float(angle), False)
        for actuator, pull in zip(self.actuators, self.shares @ tension, strict=True):
            actuator.setOverrideActuation(state, float(pull))
        model.realizeDynamics(state)
        matter = model.getMatterSubsystem()
        arms = [[a.getPath().computeMomentArm(state, c) * MM for a in self.actuators] for c in self.coordinates]
        # What holds the forces of the model itself at rest, not what the arms say they should be.
        count = len(posture)
        torque = self.inverse.solve(state, opensim.Vector(count, 0.0))
        matrix = opensim.Matrix()
        matter.calcFrameJacobian(state, self.body.getMobilizedBodyIndex(), self.place, matrix)
        in_base = np.array([[matrix.getElt(i, j) for j in range(count)] for i in range(6)])
        turn = self.body.getTransformInGround(state).R()
        to_base = np.array([[turn.get(i, j) for j in range(3)] for i in range(3)])
        jacobian = np.concatenate([to_base.T @ in_base[3:] * MM, to_base.T @ in_base[:3]])
        forces = np.array([-torque.get(i) for i in range(count)])
        return Answer(np.array(arms), jacobian, forces * MM)


def shared_fingers() -> list[str]:
    """Shipped fingers whose muscles other software can drive: all but those with an elastic hood."""
    return [n for n in finger_names() if not isinstance(read_finger(n).topology.hood, ElasticHood)]


def fingers_to_export() -> list[Any]:
    """Names of shipped and made-up fingers; some of them for every change."""
    often = ("synek2019_optimised", "skew axes")
    names = [*shared_fingers(), "fitted", "skew axes", "six axes"]
    return [n if n in often else pytest.param(n, marks=pytest.mark.full) for n in names]


def finger_called(name: str) -> Finger:
    """A shipped finger; one with points moved as a fit moves them; skew axes with tendons that rest; six straight."""
    if name == "six axes":
        topology, values = six_axes(5)
        plain = type(values)(*(np.asarray(v) for v in values))
        return replace(read_finger("an1979_middle"), id="six", topology=topology, values=plain, fraction_priors=())
    if name in ("fitted", "skew axes"):
        finger = read_finger("an1979_middle")
        rng = np.random.default_rng(3)
        moved = {
            key: np.asarray(getattr(finger.values, key)) + rng.normal(0.0, 0.8, (len(finger.topology.segments), 3))
            for key in ("proximal_point", "distal_point")
        }
        finger = replace(finger, id="fitted").replace_values(**moved)
        if name == "fitted":
            return finger.replace_values(fraction=[0.41, 0.36, 0.58, 0.47, 0.83, 0.9])
        turned = Rotation.from_rotvec(rng.normal(0.0, 0.2, np.shape(finger.values.axis)))
        centre = np.asarray(finger.values.centre) + rng.normal(0.0, 1.0, np.shape(finger.values.centre))
        return finger.replace_values(
            axis=turned.apply(np.array(finger.values.axis)),
            centre=centre,
            load_point=np.asarray(finger.values.load_point) + rng.normal(0.0, 1.0, 3),
        )
    return read_finger(name)


def postures(finger: Finger, seed: int, count: int = 200, **between: tuple[float, float]) -> Floats:
    """Seeded postures (count, rotations) [rad] that determine the tip force, angles between -0.5 and 1.4 by default."""
    rng = np.random.default_rng(seed)
    limits = {"abduction": (-0.3, 0.3)} | between
    low, high = np.array([limits.get(name, (-0.5, 1.4)) for name in finger.topology.rotations]).T
    rows = rng.uniform(low, high, (20 * count, len(low)))
    jacobian = np.asarray(tip_kinematics_batch(finger.topology, jax_values(finger.values), rows).jacobian)
    unit = np.array([1.0, 1.0, 1.0, 20.0, 20.0, 20.0])
    kept = rows[np.linalg.cond((jacobian * unit[:, None])[:, list(finger.topology.reactions)]) < WORST_CONDITION][
        :count
    ]
    assert len(kept) == count
    return kept


def tip_forces(finger: Finger, posture: Floats, tension: Floats) -> Floats:
    """Ours: (n, 6) [N, N mm]."""
    return np.asarray(clamp_forces_batch(finger.topology, jax_values(finger.values), posture, tension).tip)


__all__ = [
    "Answer",
    "InMujoco",
    "InOpensim",
    "finger_called",
    "fingers_to_export",
    "postures",
    "straight",
    "tip_forces",
]
