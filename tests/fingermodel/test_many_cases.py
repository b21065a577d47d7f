"""Many cases at once by fixed coefficients give what the model's stages give case by case, to rounding."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from fingermodel.fingers import WRAPS, Finger, FingerValues, Joint, Segment, Topology
from fingermodel.fingers.files import read_finger
from fingermodel.many_cases import CHUNK, many_cases, suits
from fingermodel.model import clamp_forces_batch, forces_of_any, jax_values, tip_kinematics_batch
from tests.fingermodel.fingers import FINGERS, six_axes, straight

Floats = NDArray[np.float64]
CASES = 64
# Rotations of each joint and which of them tendons wrap about, the components that the clamp carries, and the wraps.
Kind = tuple[tuple[tuple[int, int], ...], tuple[int, ...], tuple[str, ...]]
KINDS: tuple[Kind, ...] = (
    (((2, 0), (1, 0), (1, 0)), (0, 1, 2, 5), WRAPS[:1]),
    (((2, 0), (1, 0), (1, 0)), (0, 1, 2, 5), WRAPS),
    (((2, 1), (1, -1), (1, 0)), (0, 1, 2, 4), WRAPS),
    (((1, 0), (1, 0), (2, 1)), (0, 2, 3, 5), WRAPS),
)


def drawn(kind: Kind, rng: np.random.Generator) -> Finger:
    """The middle finger with other joints, skew axes, and tendon points anywhere."""
    chain, reactions, wraps = kind
    finger = read_finger("an1979_middle")
    joints = tuple(
        Joint(f"J{i}", i, i + 1, tuple(f"J{i}{k}" for k in range(count)), flexion)
        for i, (count, flexion) in enumerate(chain)
    )
    # The hood's slips among them, at every joint with every wrap.
    slips = [s.slip for s in finger.topology.segments]
    segments = tuple(
        Segment(slip, joints[i % 3].name, i % 3, i % 3 + 1, wraps[i // 3 % len(wraps)]) for i, slip in enumerate(slips)
    )
    axes = rng.normal(size=(4, 3)) * 0.4 + np.eye(3)[rng.integers(3, size=4)]
    count = len(slips)
    values = FingerValues(
        centre=rng.normal([-30.0, 0.0, 0.0], 4.0, (len(joints), 3)),
        axis=axes / np.linalg.norm(axes, axis=1, keepdims=True),
        proximal_point=rng.normal([8.0, 0.0, 0.0], 5.0, (count, 3)),
        distal_point=rng.normal([-8.0, 0.0, 0.0], 5.0, (count, 3)),
        fraction=rng.uniform(0.1, 0.9, len(finger.topology.fractions)),
        load_point=rng.normal([-11.0, -2.0, 1.0], 2.0),
        suture=rng.normal([1.0, 0.0, 0.0], 0.2, (len(finger.topology.muscles), 3)),
    )
    bones = tuple(f"B{i}" for i in range(len(joints) + 1))
    topology = Topology(bones, joints, segments, finger.topology.muscles, finger.topology.hood, reactions)
    return replace(finger, topology=topology, values=values)


def transmitting(finger: Finger, posture: Floats) -> NDArray[np.bool_]:
    """Postures in which rounding is not magnified: the system to be solved is well conditioned, lengths in cm."""
    topology = finger.topology
    tips = np.asarray(tip_kinematics_batch(topology, jax_values(finger.values), posture).jacobian)
    system = (tips * np.repeat([0.1, 1.0], 3)[:, None])[:, list(topology.reactions)]
    found: NDArray[np.bool_] = np.linalg.cond(system) < 30.0
    return found


def agree(finger: Finger, posture: Floats, tension: Floats) -> None:
    values = jax_values(finger.values)
    theirs = forces_of_any(finger.topology, values, posture, tension)
    ours = many_cases(finger.topology, values).forces(posture, tension)
    for a, b in zip(ours, theirs, strict=True):
        size = np.abs(np.asarray(b)).max(axis=1, keepdims=True) + tension.sum(axis=1, keepdims=True)
        np.testing.assert_allclose(a / size, np.asarray(b) / size, rtol=0.0, atol=1e-12)


@given(st.integers(0, 2**32 - 1), st.sampled_from(KINDS))
@settings(max_examples=60, deadline=None)
def test_any_finger_straight_or_wrapping(seed: int, kind: Kind) -> None:
    rng = np.random.default_rng(seed)
    finger = drawn(kind, rng)
    assert suits(finger.topology)
    posture = rng.uniform(-1.5, 1.5, (CASES, 4))
    kept = transmitting(finger, posture)
    assume(kept.any())
    agree(finger, np.resize(posture[kept], (CASES, 4)), rng.uniform(0.0, 9.0, (CASES, len(finger.topology.muscles))))


@pytest.mark.parametrize("name", FINGERS)
def test_shipped_fingers_in_batches_of_more_than_one_pass(name: str) -> None:
    rng = np.random.default_rng(3)
    n = CHUNK + 5
    finger = read_finger(name)
    posture = np.deg2rad(rng.uniform([-20.0, -10.0, 15.0, 10.0], [60.0, 10.0, 75.0, 60.0], (n, 4)))
    for one in (finger, straight(finger)) if name == FINGERS[0] else (finger,):
        agree(one, posture, rng.uniform(0.0, 9.0, (n, len(finger.topology.muscles))))


def test_at_0_and_at_180_deg() -> None:
    finger = read_finger("an1979_middle")
    posture = np.array([[0.0, 0.0, 0.5, 0.0], [-0.0, 0.0, 0.5, -0.0], [np.pi, 0.0, 0.5, 0.3], [-np.pi, 0.1, 0.5, 0.3]])
    agree(finger, posture, np.ones((4, len(finger.topology.muscles))))


def test_a_posture_that_transmits_no_force_is_no_error() -> None:
    finger = read_finger("an1979_middle")
    tension = np.ones((1, len(finger.topology.muscles)))
    forces = clamp_forces_batch(finger.topology, finger.values, np.zeros((1, 4)), tension)
    assert not np.isfinite(np.asarray(forces.tip)).all() or np.abs(np.asarray(forces.tip)).max() > 1e9


def test_other_fingers_go_through_the_stages() -> None:
    assert not suits(six_axes(0)[0])
    assert not suits(read_finger("synek2019_network").topology)
    assert not suits(read_finger("barry2018_thumb").topology)
