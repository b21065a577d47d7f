"""Isometric equilibrium: muscles, oblique axes, surfaces, passive torques and the tip force obey their laws."""

from __future__ import annotations

import copy
import importlib.util
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from daq.errors import ModelError
from daq.locations import data_dir
from fingermodel.fingers.files import finger_from_dict, read_finger
from fingermodel.isometric.baseline import least_activity
from fingermodel.isometric.forces import IsometricFinger, Placed, hold, muscle_arms, muscle_lengths, place_jit
from fingermodel.isometric.passive import passive_torque, read_passive
from fingermodel.isometric.surfaces import Cylinders, wrapped_length
from fingermodel.model import clamp_forces_batch, jax_values
from fingermodel.muscles.hill import Thelen2003
from fingermodel.muscles.muscle_files import read_muscles

Floats = NDArray[np.float64]
THUMB = "barry2018_thumb"
PINCH = np.deg2rad([10.0, -5.0, 35.0, 25.0])
angles = st.tuples(st.floats(-20, 20), st.floats(-20, 20), st.floats(5, 60), st.floats(5, 60)).map(np.deg2rad)
levels = st.lists(st.floats(0, 1), min_size=9, max_size=9).map(np.array)


def thumb() -> IsometricFinger:
    finger = read_finger(THUMB)
    return IsometricFinger(finger, read_muscles(THUMB, finger))


HELD = thumb()
COUNT = len(HELD.finger.topology.muscles)


@pytest.fixture(scope="module")
def placed() -> Placed:
    return HELD.place(PINCH)


def stiff() -> IsometricFinger:
    """The thumb with tendons that do not give and fibres without a parallel element, its joints without torques."""
    muscles = HELD.muscles
    values = muscles.values._replace(passive_share=np.zeros(COUNT))
    length = np.asarray(values.fibre) * np.cos(values.pennation) + values.slack
    return IsometricFinger(
        HELD.finger, replace(muscles, curves=Thelen2003(tendon_strain=1e-7), values=values, length_mm=length)
    )


@pytest.fixture(scope="module")
def inextensible() -> tuple[IsometricFinger, Placed]:
    finger = stiff()
    return finger, finger.place(PINCH)


@settings(max_examples=15, deadline=None)
@given(level=levels, share=st.floats(0.05, 1))
def test_equal_deficits_turn_nothing_without_give_and_passive_forces(
    inextensible: tuple[IsometricFinger, Placed], level: Floats, share: float
) -> None:
    finger, where = inextensible
    tip = np.asarray(finger.hold(where, np.stack([level, share * level])).tip)
    assert_allclose(tip[1], share * tip[0], rtol=1e-5, atol=1e-4)


def test_nothing_active_and_nothing_passive_is_no_force(inextensible: tuple[IsometricFinger, Placed]) -> None:
    finger, where = inextensible
    assert_allclose(finger.hold(where, np.zeros((1, COUNT))).tip, 0.0, atol=1e-9)


@settings(max_examples=25, deadline=None)
@given(posture=angles, level=levels)
def test_fibre_and_tendon_pull_alike_and_more_with_more_activation(posture: Floats, level: Floats) -> None:
    where = HELD.place(posture)
    state = HELD.hold(where, np.stack([0.5 * level, level, np.minimum(level + 0.1, 1.0)]))
    assert np.abs(state.unbalanced).max() < 1e-8
    tension = np.asarray(state.tension)
    assert (np.diff(tension, axis=0) > -1e-9).all()
    assert_allclose(state.active + state.passive, state.tension, rtol=1e-12)


@settings(max_examples=15, deadline=None)
@given(posture=angles)
def test_moment_arms_are_minus_the_slopes_of_the_lengths(posture: Floats) -> None:
    """Virtual work about axes that are oblique and, from joint to joint, skew; over surfaces as well."""
    slopes, arms = slopes_and_arms(jnp.asarray(posture))
    assert_allclose(-slopes, arms, atol=2e-5)


@jax.jit
def slopes_and_arms(posture: jax.Array) -> tuple[jax.Array, jax.Array]:
    def lengths(q: jax.Array) -> jax.Array:
        return muscle_lengths(HELD.structure, HELD.numbers, q)

    return jax.jacfwd(lengths)(posture).T, muscle_arms(HELD.structure, HELD.numbers, posture)


def test_axes_of_the_thumb_are_oblique_and_skew() -> None:
    """Two of one joint are not square to each other, and those of one joint and the next neither meet nor run along."""
    axes, centres = np.asarray(HELD.finger.values.axis), np.asarray(HELD.finger.values.centre)
    assert np.rad2deg(np.arccos(axes[0] @ axes[1])) == pytest.approx(80.9, abs=0.1)
    for one, other, joint in ((1, 2, 1), (2, 3, 2)):
        normal = np.cross(axes[one], axes[other])
        assert np.linalg.norm(normal) > 0.2
        assert abs(normal @ centres[joint]) / np.linalg.norm(normal) > 0.5


@pytest.mark.parametrize("turn", [0.7, -2.0])
def test_turning_the_frames_about_the_axis_of_the_clamps_torque_turns_the_force(placed: Placed, turn: float) -> None:
    """All vectors of the file in other axes: lengths, arms and tensions are the same, the force is the same vector."""
    frame = Rotation.from_rotvec([0.0, 0.0, turn])
    values, cylinders = HELD.numbers.values, HELD.numbers.cylinders
    turned = HELD.numbers._replace(
        values=values._replace(**{n: frame.apply(getattr(values, n)) for n in TURNED}),
        cylinders=cylinders._replace(**{n: frame.apply(getattr(cylinders, n)) for n in ("centre", "axis", "side")}),
    )
    there = place_jit(HELD.structure, turned, jnp.asarray(PINCH))
    assert_allclose(there.arms, placed.arms, atol=1e-9)
    assert_allclose(there.length, placed.length, atol=1e-9)
    ours, theirs = (np.asarray(HELD.hold(where, np.full((1, COUNT), 0.4)).tip)[0, :3] for where in (placed, there))
    assert_allclose(theirs, frame.apply(np.array(ours)), atol=1e-8)


TURNED = ("centre", "axis", "proximal_point", "distal_point", "load_point")


def test_without_surfaces_the_tip_force_is_every_other_predictions() -> None:
    """The same clamp and the same hood: tensions found here, given to the prediction for hung weights."""
    finger = read_finger("wu2008_index")
    held = IsometricFinger(finger, read_muscles("wu2008", finger))
    posture = np.deg2rad([3.0, 30.0, 40.0, 20.0])
    state = held.hold(held.place(posture), np.linspace(0.1, 0.9, 7)[None])
    theirs = clamp_forces_batch(
        finger.topology, jax_values(finger.values), jnp.asarray(posture)[None], jnp.asarray(state.tension)
    )
    assert_allclose(state.tip, theirs.tip, atol=1e-8)


def test_slopes_are_those_of_small_steps(placed: Placed) -> None:
    level = np.linspace(0.1, 0.9, COUNT)

    @jax.jit
    def tip(a: jax.Array, where: Placed) -> tuple[jax.Array, jax.Array]:
        def force(x: jax.Array) -> jax.Array:
            return hold(HELD.muscles.curves, HELD.hill, where, x).tip

        return force(a), jax.jacfwd(force)(a)

    slope = np.asarray(tip(jnp.asarray(level), placed)[1])
    step = 1e-5
    for i in (0, 4, 8):
        ends = [np.asarray(tip(jnp.asarray(level + s * step * np.eye(COUNT)[i]), placed)[0]) for s in (1, -1)]
        assert_allclose((ends[0] - ends[1]) / (2 * step), slope[:, i], rtol=1e-4, atol=1e-3)


def cylinder(radius: float) -> Cylinders:
    return Cylinders(jnp.zeros(3), jnp.array([0.0, 0.0, 1.0]), jnp.array([0.0, 1.0, 0.0]), jnp.array(radius))


wrapped: Callable[..., jax.Array] = jax.jit(wrapped_length)


def test_a_tendon_over_a_cylinder_is_tangents_and_arc() -> None:
    """Level with the axis on both sides, it goes half round less the angles of its tangents."""
    start, end = jnp.array([10.0, 0.0, 0.0]), jnp.array([-10.0, 0.0, 3.0])
    flat = 2.0 * np.sqrt(100.0 - 25.0) + 5.0 * (np.pi - 2.0 * np.arccos(0.5))
    assert float(wrapped(start, end, cylinder(5.0))) == pytest.approx(np.hypot(flat, 3.0), abs=1e-12)


points = st.tuples(st.floats(6, 30), st.floats(-20, 20), st.floats(-9, 9)).map(np.array)


@settings(max_examples=50, deadline=None)
@given(start=points, end=points, radius=st.floats(0.5, 5))
def test_a_surface_only_lengthens_and_the_arm_is_at_least_its_radius_where_it_touches(
    start: Floats, end: Floats, radius: float
) -> None:
    end = end * [-1.0, 1.0, 1.0]
    length = float(wrapped(start, end, cylinder(radius)))
    straight = float(np.linalg.norm(start - end))
    assert length >= straight - 1e-9
    turn = 1e-5
    turned = Rotation.from_rotvec([0.0, 0.0, turn]).apply(end)
    arm = abs(float(wrapped(start, turned, cylinder(radius))) - length) / turn
    rise = abs(end[2] - start[2])
    if length > straight + 1e-6:
        assert arm == pytest.approx(radius * np.sqrt(1.0 - (rise / length) ** 2), rel=1e-3)


def test_an_end_inside_the_surface_leaves_the_line_straight() -> None:
    start, end = np.array([1.0, 0.5, 0.0]), np.array([-9.0, 0.0, 0.0])
    assert float(wrapped(start, end, cylinder(3.0))) == pytest.approx(np.linalg.norm(start - end))


def test_a_baseline_gives_the_force_asked_for_and_no_torque(placed: Placed) -> None:
    wanted = np.array([0.0, -20.0, 0.0])
    level = least_activity(HELD, placed, wanted)
    assert ((level >= 0.0) & (level <= 1.0)).all()
    state = HELD.hold(placed, level[None])
    assert_allclose(state.tip[0], np.r_[wanted, np.zeros(3)], atol=1e-6)
    assert_allclose(HELD.activation_of(placed, np.asarray(state.tension)[0]), level, atol=1e-9)
    with pytest.raises(ModelError, match="beyond the muscles' strength"):
        least_activity(HELD, placed, 100.0 * wanted)


def test_short_muscles_of_the_thumb_lie_as_their_script_lays_them() -> None:
    spec = importlib.util.spec_from_file_location("lay_thumb_lines", data_dir() / "lay_thumb_lines.py")
    assert spec is not None
    assert spec.loader is not None
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    finger, zero = HELD.finger, HELD.place(np.zeros(4))
    for name, (origin, insertion) in script.lines().items():
        (at,) = [i for i, s in enumerate(finger.topology.segments) if s.slip == name]
        assert_allclose(finger.values.proximal_point[at], origin, atol=1e-3)
        assert_allclose(finger.values.distal_point[at], insertion, atol=1e-3)
        quoted = yaml.safe_load((data_dir() / "reference" / "barry2018.yaml").read_text(encoding="utf-8"))
        arms = np.asarray(zero.arms)[:, finger.topology.muscles.index(name)]
        assert_allclose(arms, quoted["thumb"]["muscles"][name], atol=0.01)


def document() -> dict[str, Any]:
    raw: dict[str, Any] = yaml.safe_load((data_dir() / "fingers" / f"{THUMB}.yaml").read_text(encoding="utf-8"))
    return raw


def test_two_axes_of_one_joint_may_pass_each_other() -> None:
    """A bone of no length between them, as in the paper; with no way from one to the other all is as it was."""
    first, second = HELD.finger.topology.rotations[:2]

    def apart(offset: list[float]) -> IsometricFinger:
        raw = document()
        cmc, *others = raw["joints"]
        own = {
            name: cmc | {"name": name, "rotations": [r]}
            for name, r in zip((first, second), cmc["rotations"], strict=True)
        }
        own[first] |= {"child": "TZ2"}
        own[second] |= {"parent": "TZ2", "centre": offset}
        raw |= {"bones": ["TZ", "TZ2", *raw["bones"][1:]], "joints": [*own.values(), *others]}
        for segment in raw["segments"]:
            if segment["joint"] == "CMC":
                segment.update(joint=first, proximal_bone="TZ", distal_bone=segment.get("distal_bone", "MC"))
        return IsometricFinger(finger_from_dict(raw, "test"), HELD.muscles)

    meeting, passing = apart([0.0, 0.0, 0.0]), apart([-4.0, 3.0, 1.0])
    together = HELD.place(PINCH)
    assert_allclose(meeting.place(PINCH).arms, together.arms, atol=1e-9)
    assert_allclose(meeting.place(PINCH).wrench, together.wrench, atol=1e-9)
    arms = np.asarray(passing.place(PINCH).arms)
    assert np.abs(arms - np.asarray(together.arms)).max() > 1.0
    step = 1e-4
    for i in range(4):
        ends = [np.asarray(passing.place(PINCH + s * step * np.eye(4)[i]).length) for s in (1, -1)]
        assert_allclose(-(ends[0] - ends[1]) / (2 * step), arms[i], atol=1e-4)


LINEAR = {"rotation": "IP", "kind": "linear", "stiffness_Nmm_per_rad": 50.0, "rest_deg": 20.0}
EXPONENTIAL = {
    "rotation": "MP", "kind": "double_exponential", "extension_Nmm": 2.0, "extension_per_rad": 5.0,
    "extension_from_deg": 0.0, "flexion_Nmm": 3.0, "flexion_per_rad": 4.0, "flexion_from_deg": 50.0,
}  # fmt: skip
SOURCE = {"source": "fingertwin", "certainty": "assumed"}


def test_passive_torques_resist_and_rest_between_their_angles() -> None:
    raw = document() | {"passive": [LINEAR | SOURCE, EXPONENTIAL | SOURCE]}
    passive = read_passive(finger_from_dict(raw, "test"))

    def torque(mp_deg: float, ip_deg: float) -> Floats:
        return np.asarray(passive_torque(passive, jnp.deg2rad(jnp.array([40.0, 40.0, mp_deg, ip_deg]))))

    assert_allclose(torque(25.0, 20.0), 0.0, atol=1e-12)
    assert torque(25.0, 50.0)[3] == pytest.approx(-50.0 * np.deg2rad(30.0))
    assert torque(-30.0, 20.0)[2] == pytest.approx(2.0 * np.expm1(5.0 * np.deg2rad(30.0)))
    assert torque(80.0, 20.0)[2] == pytest.approx(-3.0 * np.expm1(4.0 * np.deg2rad(30.0)))


def test_passive_torques_reach_the_tip(placed: Placed) -> None:
    finger = finger_from_dict(document() | {"passive": [LINEAR | SOURCE]}, "test")
    there = IsometricFinger(finger, HELD.muscles).place(PINCH)
    assert_allclose(there.passive_torque, [0.0, 0.0, 0.0, -50.0 * np.deg2rad(5.0)], atol=1e-9)
    rest = np.zeros((1, COUNT))
    change = np.asarray(HELD.hold(there, rest).tip - HELD.hold(placed, rest).tip)[0]
    assert_allclose(change, np.asarray(there.wrench) @ np.asarray(there.passive_torque), atol=1e-9)


def _twice(raw: dict[str, Any]) -> None:
    raw["passive"] = [LINEAR | SOURCE, LINEAR | SOURCE]


FAULTS: dict[str, tuple[Callable[[dict[str, Any]], object], str]] = {
    "unknown surface": (lambda d: d["segments"][1]["over"].update(surface="knee"), "runs over 'knee'"),
    "surface on no bone": (lambda d: d["surfaces"][0].update(bone="MP"), "surface MP_head is on 'MP'"),
    "surface on another bone": (lambda d: d["surfaces"][1].update(bone="TZ"), "the surface of IP.EPL is on 'TZ'"),
    "axis of no length": (lambda d: d["surfaces"][0].update(axis=[0, 0, 0]), "axis of no length"),
    "two surfaces of one name": (lambda d: d["surfaces"].append(d["surfaces"][0]), "2 times"),
    "several joints": (lambda d: d["segments"][1].update(proximal_bone="MC"), "several joints"),
    "two torques": (_twice, "passive torque on 'IP', 2 times"),
    "unknown rotation": (
        lambda d: d.update(passive=[LINEAR | SOURCE | {"rotation": "DIP"}]), "passive torque acts on 'DIP'",
    ),
    "head of no muscle": (lambda d: d["heads"].update(FDI=["FDIl"]), "a head of FDI is 'FDIl'"),
    "heads named like a muscle": (lambda d: d.update(heads={"FPL": ["FPL"]}), "heads of 'FPL'"),
    "unknown angle held": (lambda d: d["held"]["posture_deg"].update(PIP=3.0), "the posture held names 'PIP'"),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_a_file_that_does_not_fit_is_refused_in_one_line(fault: str) -> None:
    break_it, message = FAULTS[fault]
    raw = copy.deepcopy(document())
    break_it(raw)
    with pytest.raises(ModelError, match=message) as told:
        finger_from_dict(raw, "test")
    assert "\n" not in str(told.value)
