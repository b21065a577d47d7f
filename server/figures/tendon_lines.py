"""The tendons' paths in a drawing of the finger, in the sagittal plane of the first bone [mm]."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fingermodel.fingers import Finger, FingerValues, Segment, Topology
from server.figures.poses import FingerPose, stub_mm

Floats = NDArray[np.float64]


def tendon_paths(finger: Finger, values: FingerValues, pose: FingerPose) -> list[Floats]:
    """Return every tendon segment: straight, or bent about the joint by Landsmeer's first model."""
    lines = []
    for index, segment in enumerate(finger.topology.segments):
        near = pose.place(segment.proximal_bone, values.proximal_point[index])[:2]
        far = pose.place(segment.distal_bone, values.distal_point[index])[:2]
        bend = _bend(finger, segment, pose)
        centre = pose.origins[finger.topology.joint(segment.joint).child][:2]
        # As at 0° from the distal point to where the proximal one was, and from there about the joint.
        turned = np.linspace(0.0, bend, 9 if bend else 1)
        cosine, sine = np.cos(turned), np.sin(turned)
        x, y = near - centre
        about = centre + np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=1)
        lines.append(np.concatenate([about, far[None]]))
    return lines


def _bend(finger: Finger, segment: Segment, pose: FingerPose) -> float:
    """Return the angle [rad] by which a segment bends about its joint, 0 where it runs straight."""
    if segment.wrap == "straight":
        return 0.0
    topology = finger.topology
    joint = topology.joint(segment.joint)
    first = sum(len(j.rotations) for j in topology.joints[: topology.joints.index(joint)])
    angle = float(pose.posture[first + joint.flexion]) if joint.flexion >= 0 else 0.0
    beyond = angle - segment.rests_at
    return max(beyond, 0.0) if segment.wrap == "landsmeer1_dorsal" else min(beyond, 0.0)


def tendon_connections(finger: Finger, values: FingerValues, pose: FingerPose) -> list[Floats]:
    """Return lines along the bones between a tendon's segments, through the hood, and proximally out of the drawing."""
    topology = finger.topology
    feeds = hood_feeds(topology)
    lines = []
    for i, segment in enumerate(topology.segments):
        end = pose.place(segment.distal_bone, values.distal_point[i])[:2]
        for k, following in enumerate(topology.segments):
            follows = following.slip == segment.slip or following.slip in feeds.get(segment.slip, ())
            if follows and following.proximal_bone == segment.distal_bone:
                lines.append(np.stack([end, pose.place(following.proximal_bone, values.proximal_point[k])[:2]]))
        if segment.proximal_bone == 0 and segment.slip in topology.muscles:
            lines.append(leaving(finger, values, pose, segment.slip)[:, :2])
    return lines


def hood_feeds(topology: Topology) -> dict[str, set[str]]:
    """Return the slips of the hood that each tendon or slip pulls."""
    feeds: dict[str, set[str]] = {}
    if hood := topology.hood:
        bands = {hood.central_slip: hood.members, hood.terminal_slip: (hood.radial_band, hood.ulnar_band)}
        bands |= {hood.radial_band: (*hood.radial, *hood.extensors), hood.ulnar_band: (*hood.ulnar, *hood.extensors)}
        for slip, sources in bands.items():
            for source in sources:
                feeds.setdefault(source, set()).add(slip)
    return feeds


def leaving(finger: Finger, values: FingerValues, pose: FingerPose, muscle: str) -> Floats:
    """Return a tendon's course (2, 3) along the first bone, to where it leaves the drawing proximally [mm]."""
    stub = stub_mm(values)
    for index, segment in enumerate(finger.topology.segments):
        if segment.slip == muscle and segment.proximal_bone == 0:
            begin = pose.place(0, values.proximal_point[index])
            suture = np.asarray(values.suture[finger.topology.muscles.index(muscle)])
            return np.stack([begin, begin + suture * max(stub - float(begin[0]), 0.0)])
    return np.array([[stub, 0.0, 0.0], [stub, 0.0, 0.0]])
