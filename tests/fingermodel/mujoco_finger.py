"""A finger as a MuJoCo model: the same bones, hinges and tendon points, and nothing else in common with ours."""

from __future__ import annotations

from typing import NamedTuple
from xml.etree import ElementTree as ET

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from fingermodel.fingers import FingerValues, Topology

Floats = NDArray[np.float64]


class MujocoFinger:
    """A finger in MuJoCo, every tendon segment straight. Lengths are in mm; the first bone is the world."""

    def __init__(self, topology: Topology, values: FingerValues) -> None:
        self.topology = topology
        self.values = values
        self.model = mujoco.MjModel.from_xml_string(mjcf(topology, values))
        self.data = mujoco.MjData(self.model)
        self.tip = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_SITE, "load_point")
        self.tendon_rows = np.repeat(np.arange(self.model.ntendon), self.model.ten_J_rownnz)

    def pose(self, posture: Floats) -> Pose:
        """Ask MuJoCo for one posture (rotations,) [rad]."""
        model, data = self.model, self.data
        data.qpos[:] = posture
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_tendon(model, data)
        length_rate = np.zeros((model.ntendon, model.nv))
        length_rate[self.tendon_rows, model.ten_J_colind] = data.ten_J
        in_base = np.zeros((2, 3, model.nv))
        mujoco.mj_jacSite(model, data, in_base[0], in_base[1], self.tip)
        to_base = data.site_xmat[self.tip].reshape(3, 3).copy()
        jacobian = (to_base.T @ in_base).reshape(6, model.nv)
        return Pose(-length_rate.T, jacobian, to_base)

    def forces(self, posture: Floats, tension: Floats) -> tuple[Floats, Floats]:
        """Tip wrench (6,) and bone force (3,) of one posture (rotations,) [rad] under tensions (muscles,) [N]."""
        pose = self.pose(posture)
        rows = list(self.topology.reactions)
        torque = pose.moment_arms @ (sharing(self.topology, self.values) @ tension)
        wrench = np.zeros(6)
        wrench[rows] = np.linalg.solve(pose.jacobian[rows].T, torque)
        return wrench, tension @ np.asarray(self.values.suture) - pose.to_base @ wrench[:3]


class Pose(NamedTuple):
    """What MuJoCo says of one posture.

    Attributes:
        moment_arms: (rotations, segments) [mm], positive where flexion shortens the segment.
        jacobian: (6, rotations) of the load point, in the most distal bone's axes.
        to_base: (3, 3) takes components in the most distal bone to the first one.
    """

    moment_arms: Floats
    jacobian: Floats
    to_base: Floats


def mjcf(topology: Topology, values: FingerValues) -> str:
    """Write a finger as MJCF: hinges in the order of its rotations, a spatial tendon of two sites for each segment."""
    root = ET.Element("mujoco")
    ET.SubElement(root, "compiler", angle="radian")
    # No dynamics are asked for: without contacts and constraints the position stage does nothing in vain.
    ET.SubElement(ET.SubElement(root, "option"), "flag", contact="disable", constraint="disable", gravity="disable")
    bodies = [ET.SubElement(root, "worldbody")]
    first = 0
    for joint, centre in zip(topology.joints, np.asarray(values.centre), strict=True):
        body = ET.SubElement(bodies[joint.parent], "body", pos=_numbers(centre))
        for name, axis in zip(joint.rotations, np.asarray(values.axis)[first:], strict=False):
            ET.SubElement(body, "joint", name=name, type="hinge", axis=_numbers(axis))
        ET.SubElement(body, "inertial", pos="0 0 0", mass="1e-3", diaginertia="1e-3 1e-3 1e-3")
        first += len(joint.rotations)
        bodies.append(body)
    ET.SubElement(bodies[-1], "site", name="load_point", pos=_numbers(values.load_point))
    tendons = ET.SubElement(root, "tendon")
    ends = zip(np.asarray(values.proximal_point), np.asarray(values.distal_point), strict=True)
    for i, (segment, (proximal, distal)) in enumerate(zip(topology.segments, ends, strict=True)):
        tendon = ET.SubElement(tendons, "spatial", name=f"segment{i}")
        for end, bone, point in (("p", segment.proximal_bone, proximal), ("d", segment.distal_bone, distal)):
            ET.SubElement(bodies[bone], "site", name=f"{end}{i}", pos=_numbers(point))
            ET.SubElement(tendon, "site", site=f"{end}{i}")
    return ET.tostring(root, encoding="unicode")


def sharing(topology: Topology, values: FingerValues) -> Floats:
    """Tension of every segment per tension of every muscle (segments, muscles), Winslow's rhombus written anew."""
    muscles = dict(zip(topology.muscles, np.eye(len(topology.muscles)), strict=True))
    hood = topology.hood
    if hood is None:
        return np.array([muscles[s.slip] for s in topology.segments])
    fraction = dict(zip(hood.fractions, np.asarray(values.fraction).tolist(), strict=True))
    slips = dict(muscles)
    for slip in (hood.central_slip, hood.radial_band, hood.ulnar_band, hood.terminal_slip):
        slips[slip] = np.zeros(len(muscles))
    for muscle in hood.members:
        enters = muscles[muscle] * fraction.get(f"{muscle}_EM", 1.0)
        aside = enters * (1.0 - fraction[f"{muscle}_ES"])
        radial = 1.0 if muscle in hood.radial else 0.5 if muscle in hood.extensors else 0.0
        slips[hood.central_slip] += enters - aside
        slips[hood.radial_band] += radial * aside
        slips[hood.ulnar_band] += (1.0 - radial) * aside
        slips[hood.terminal_slip] += aside
    return np.array([slips[s.slip] for s in topology.segments])


def _numbers(values: ArrayLike) -> str:
    return " ".join(repr(x) for x in np.asarray(values, dtype=float).tolist())
