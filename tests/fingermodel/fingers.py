"""Fingers for the tests: the shipped ones made straight, and one with skew axes and every kind of segment."""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from fingermodel.fingers import Finger, FingerValues, Joint, Segment, Topology

Floats = NDArray[np.float64]
PUBLISHED = ("synek2019_H01", "synek2019_H02", "synek2019_H03", "synek2019_B01", "synek2019_HMEAN")
FINGERS = ("an1979_middle", "synek2019_initial", "synek2019_optimised", "synek2019_bonobo")


def straight(finger: Finger) -> Finger:
    """The same finger whose tendons never wrap."""
    segments = tuple(replace(s, wrap="straight") for s in finger.topology.segments)
    return replace(finger, topology=replace(finger.topology, segments=segments))


def random_case(finger: Finger, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """A posture (rotations,) [rad] well away from straight, and tensions (muscles,) [N]."""
    names = finger.topology.rotations
    posture = np.array([rng.uniform(0.2, 1.2) if n in ("PIP", "DIP") else rng.uniform(-0.4, 1.1) for n in names])
    posture = np.where([n == "abduction" for n in names], rng.uniform(-0.2, 0.2), posture)
    return posture, rng.uniform(0.0, 9.0, len(finger.topology.muscles))


def six_axes(seed: int) -> tuple[Topology, FingerValues]:
    """A finger with two skew axes a joint, a clamp that carries all six components, and tendons over two joints."""
    rng = np.random.default_rng(seed)
    joints = tuple(Joint(f"J{i}", i, i + 1, (f"J{i}a", f"J{i}b"), 0) for i in range(3))
    spans = ((0, 1), (1, 2), (2, 3), (0, 2), (1, 3), (0, 3))
    segments = tuple(Segment(f"M{i}", f"J{a}", a, b, "straight") for i, (a, b) in enumerate(spans))
    muscles = tuple(f"M{i}" for i in range(len(spans)))
    axes = rng.normal(size=(6, 3))
    sutures = rng.normal(size=(6, 3))
    values = FingerValues(
        centre=jnp.asarray([[0.0, 0.0, 0.0], [-45.0, 3.0, 2.0], [-28.0, -2.0, 1.0]]),
        axis=jnp.asarray(axes / np.linalg.norm(axes, axis=1, keepdims=True)),
        proximal_point=jnp.asarray(rng.normal(size=(6, 3)) * 6.0 + [8.0, 0.0, 0.0]),
        distal_point=jnp.asarray(rng.normal(size=(6, 3)) * 6.0 - [10.0, 0.0, 0.0]),
        fraction=jnp.zeros(0),
        load_point=jnp.asarray([-11.0, -2.0, 1.0]),
        suture=jnp.asarray(sutures / np.linalg.norm(sutures, axis=1, keepdims=True)),
    )
    topology = Topology(("B0", "B1", "B2", "B3"), joints, segments, muscles, None, (0, 1, 2, 3, 4, 5))
    return topology, values
