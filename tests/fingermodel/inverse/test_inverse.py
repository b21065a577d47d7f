"""From the tip force back to tensions and contact forces: equilibrium written out again, laws, and what is refused."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from daq.errors import InputError, ModelError
from fingermodel.fingers import Finger, Hood, Topology
from fingermodel.fingers.files import read_finger
from fingermodel.inverse.areas import areas_of
from fingermodel.inverse.closures import NAMES, closure_of, slip_names
from fingermodel.inverse.equilibrium import Balance, Cases, anatomy_of, balances
from fingermodel.inverse.pressing import pressing_forces, pressing_posture, pressing_wrench
from fingermodel.inverse.spread import Given, invert, sampled
from fingermodel.model import clamp_forces_batch, jax_values

Floats = NDArray[np.float64]
LINEAR = ("minimal", "chao")
FLEXED = ((77.0, 44.0, 4.0, -15.0), (-0.95, 25.48, 0.90))
angles = st.tuples(st.floats(-0.2, 1.2), st.floats(-0.2, 0.2), st.floats(0.1, 1.4), st.floats(0.1, 1.0))
forces = st.tuples(*[st.floats(-30.0, 30.0)] * 3, st.floats(-100.0, 100.0))


@cache
def index() -> Finger:
    return read_finger("an1979_index")


def wrench_of(force: Sequence[float]) -> Floats:
    """Fx, Fy, Fz and Tz, which the clamp carries."""
    return np.array([*force[:3], 0.0, 0.0, force[3]])


def inverted(name: str, posture: Sequence[float], wrench: Floats, finger: Finger | None = None) -> Balance:
    chosen = finger or index()
    cases = Cases(anatomy_of(chosen.values)[None], np.array([posture]), wrench[None])
    laws = closure_of(name, chosen.topology).matrix(chosen.topology)
    balance = balances(chosen.topology, laws, jax_values(chosen.values), cases)
    return Balance(balance.slip[0], balance.contact[0])


def turning(axis: Floats, angle: float) -> Floats:
    """Rotation matrix, from the exponential series of the axis' cross product."""
    k = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    return np.eye(3) + np.sin(angle) * k + (1.0 - np.cos(angle)) * (k @ k)


def frames(finger: Finger, posture: Sequence[float], felt: int = -1) -> list[tuple[Floats, Floats]]:
    """Orientation and origin of every bone in the first one's axes; `felt` is a flexion that is left out."""
    topology, values = finger.topology, finger.values
    out = [(np.eye(3), np.zeros(3))]
    turn = 0
    for k, joint in enumerate(topology.joints):
        rotation, origin = out[-1]
        origin = origin + rotation @ np.asarray(values.centre[k])
        for _ in joint.rotations:
            rotation = rotation @ turning(np.asarray(values.axis[turn]), 0.0 if turn == felt else posture[turn])
            turn += 1
        out.append((rotation, origin))
    return out


def cut(
    finger: Finger, posture: Sequence[float], tension: dict[str, float], wrench: Floats, k: int
) -> tuple[Floats, Floats]:
    """Force and moment about joint k on all that is distal of it, without the bone contact, in the first bone's axes.

    Tendons pull what is distal towards their proximal points; what the finger does at its tip acts back on it.
    """
    topology, values = finger.topology, finger.values
    joint = topology.joints[k]
    flexion = sum(len(j.rotations) for j in topology.joints[:k]) + joint.flexion
    now = frames(finger, posture)
    rotation, centre = now[joint.child]
    tip_rotation, tip_origin = now[-1]
    force = -tip_rotation @ wrench[:3]
    arm = tip_origin + tip_rotation @ np.asarray(values.load_point) - centre
    moment = np.cross(arm, force) - tip_rotation @ wrench[3:]
    for i, segment in enumerate(topology.segments):
        if topology.joints.index(topology.joint(segment.joint)) != k:
            continue
        resting = (segment.wrap == "landsmeer1_dorsal" and posture[flexion] >= 0.0) or (
            segment.wrap == "landsmeer1_palmar" and posture[flexion] < 0.0
        )
        # A tendon that rests on the joint keeps the line that it has when this joint is straight.
        seen = frames(finger, posture, flexion) if resting else now
        to_child = seen[joint.child][0]
        distal = np.asarray(values.distal_point[i])
        proximal = to_child.T @ (
            seen[joint.parent][0] @ np.asarray(values.proximal_point[i]) + seen[joint.parent][1] - seen[joint.child][1]
        )
        line = (proximal - distal) / np.linalg.norm(proximal - distal)
        pull = tension[segment.slip] * (rotation @ line)
        force = force + pull
        moment = moment + np.cross(rotation @ distal, pull)
    return force, moment


def axes_of(finger: Finger, posture: Sequence[float], k: int) -> list[Floats]:
    """Rotation axes of joint k in the first bone's axes, each turned by those before it."""
    rotation = frames(finger, posture)[finger.topology.joints[k].parent][0]
    turn = sum(len(j.rotations) for j in finger.topology.joints[:k])
    out = []
    for i in range(len(finger.topology.joints[k].rotations)):
        axis = np.asarray(finger.values.axis[turn + i])
        out.append(rotation @ axis)
        rotation = rotation @ turning(axis, posture[turn + i])
    return out


@pytest.mark.parametrize("name", LINEAR)
@given(posture=angles, force=forces)
@settings(max_examples=25)
def test_every_part_distal_of_a_joint_is_in_equilibrium(
    name: str, posture: tuple[float, ...], force: tuple[float, ...]
) -> None:
    finger, wrench = index(), wrench_of(force)
    balance = inverted(name, posture, wrench)
    tension = dict(zip(slip_names(finger.topology), np.asarray(balance.slip).tolist(), strict=True))
    size = 1.0 + sum(map(abs, tension.values()))
    at = frames(finger, posture)
    for k, joint in enumerate(finger.topology.joints):
        pulled, moment = cut(finger, posture, tension, wrench, k)
        contact = at[joint.parent][0] @ np.asarray(balance.contact[k])
        np.testing.assert_allclose(pulled, contact, atol=1e-9 * size)
        for axis in axes_of(finger, posture, k):
            assert abs(moment @ axis) < 1e-8 * size


@given(posture=angles, force=forces)
@settings(max_examples=25)
def test_the_hoods_laws_hold_between_its_slips(posture: tuple[float, ...], force: tuple[float, ...]) -> None:
    f = dict(
        zip(slip_names(index().topology), np.asarray(inverted("chao", posture, wrench_of(force)).slip), strict=True)
    )
    size = 1e-9 * (1.0 + max(map(abs, f.values())))
    assert f["RB"] == pytest.approx(2 / 3 * f["LU"] + 1 / 6 * f["EDC"], abs=size)
    assert f["UB"] == pytest.approx(1 / 3 * f["UI"] + 1 / 6 * f["EDC"], abs=size)
    assert f["TE"] == pytest.approx(f["RB"] + f["UB"], abs=size)
    assert f["ES"] == pytest.approx((f["RI"] + f["UI"] + f["LU"]) / 3 + f["EDC"] / 6, abs=size)
    assert f["EDC"] == pytest.approx(f["ES"], abs=size)
    assert f["FDS"] == pytest.approx(0.0, abs=size)


def with_chao_hood(finger: Finger) -> Finger:
    """The forward model with fractions that share as Eqs 7 to 10 do."""
    hood = finger.topology.hood
    assert isinstance(hood, Hood)
    hood = replace(hood, partial=("RI", "UI", "EDC"))
    shares = {
        "RI_EM": 1 / 3, "RI_ES": 1.0, "LU_ES": 1 / 3, "UI_EM": 2 / 3, "UI_ES": 0.5, "EDC_EM": 0.5, "EDC_ES": 1 / 3,
    }  # fmt: skip
    topology: Topology = replace(finger.topology, hood=hood)
    return replace(finger, topology=topology).replace_values(fraction=[shares[name] for name in topology.fractions])


@given(posture=angles, force=forces)
@settings(max_examples=25)
def test_forward_of_the_inverse_is_the_load(posture: tuple[float, ...], force: tuple[float, ...]) -> None:
    wrench = wrench_of(force)
    slip = dict(zip(slip_names(index().topology), np.asarray(inverted("chao", posture, wrench).slip), strict=True))
    forward = with_chao_hood(index())
    tension = jnp.asarray([slip[m] for m in forward.topology.muscles])[None]
    tip = clamp_forces_batch(forward.topology, jax_values(forward.values), jnp.asarray(posture)[None], tension).tip
    np.testing.assert_allclose(np.asarray(tip[0]), wrench, atol=1e-6 * (1.0 + np.abs(wrench).max()))


@pytest.mark.parametrize("name", LINEAR)
@given(posture=angles, force=forces, factor=st.floats(-5.0, 5.0))
@settings(max_examples=15)
def test_forces_scale_with_the_load(
    name: str, posture: tuple[float, ...], force: tuple[float, ...], factor: float
) -> None:
    one, many = (inverted(name, posture, s * wrench_of(force)) for s in (1.0, factor))
    for a, b in zip(one, many, strict=True):
        np.testing.assert_allclose(factor * np.asarray(a), np.asarray(b), atol=1e-8 * (1.0 + np.abs(a).max()))


@pytest.mark.parametrize("closure", NAMES)
@given(turned=st.floats(-180.0, 180.0))
@settings(max_examples=10)
def test_turning_the_whole_scene_changes_nothing(closure: str, turned: float) -> None:
    theta, load = FLEXED
    c, s = np.cos(np.deg2rad(turned)), np.sin(np.deg2rad(turned))
    other = (c * load[0] - s * load[1], s * load[0] + c * load[1], load[2])
    here, there = (
        pressing_forces(index(), t, p, closure) for t, p in ((theta, load), ([a + turned for a in theta], other))
    )
    assert there.muscle == pytest.approx(here.muscle, abs=1e-8)
    assert there.contact == pytest.approx(here.contact, abs=1e-8)


@pytest.mark.parametrize("closure", NAMES)
def test_a_larger_finger_has_the_same_forces_for_the_same_load(closure: str) -> None:
    v = index().values
    larger = index().replace_values(
        centre=1.3 * np.asarray(v.centre),
        proximal_point=1.3 * np.asarray(v.proximal_point),
        distal_point=1.3 * np.asarray(v.distal_point),
        load_point=1.3 * np.asarray(v.load_point),
    )
    assert pressing_forces(larger, *FLEXED, closure).muscle == pytest.approx(
        pressing_forces(index(), *FLEXED, closure).muscle, rel=1e-9, abs=1e-9
    )


def test_the_minimal_model_is_the_studys_own_equations() -> None:
    """Eqs 1 to 3 solved as they stand, with our moment arms: moments P_x l sin θ − P_y l cos θ about each joint."""
    theta, load = FLEXED
    finger = index().replace_values(load_point=[-19.67, 0.0, 0.0])
    names = slip_names(finger.topology)
    posture = pressing_posture(finger.topology, theta)
    one = np.eye(len(names))
    arm = {}
    for k, joint in enumerate(("MCP", "PIP", "DIP")):
        axes = axes_of(finger, posture.tolist(), k)
        for i, name in enumerate(names):
            _, moment = cut(finger, posture.tolist(), dict(zip(names, one[i], strict=True)), np.zeros(6), k)
            arm[joint, name] = [float(moment @ a) for a in axes]
    angle = np.deg2rad(theta)
    lengths = [19.67, *(float(np.linalg.norm(c)) for c in np.asarray(finger.values.centre)[:0:-1])]
    levers = np.cumsum([[n * np.sin(a), n * np.cos(a)] for n, a in zip(lengths, angle, strict=False)], axis=0)
    asked = [load[0] * s - load[1] * c for s, c in levers]
    pair = np.array([[arm["DIP", "FDP"][0], arm["DIP", "TE"][0]], [arm["PIP", "FDP"][0], arm["PIP", "ES"][0]]])
    flexor, extensor = np.linalg.solve(pair, [-asked[0], -asked[1]])
    ours = pressing_forces(finger, theta, load, "minimal")
    size = float(np.linalg.norm(load))
    assert (ours.muscle["PF"], ours.muscle["PE"]) == pytest.approx((flexor / size, extensor / size), rel=1e-9)
    left = -asked[2] - flexor * arm["MCP", "FDP"][0] - extensor * arm["MCP", "EDC"][0]
    intrinsic = size * sum(ours.muscle[m] * arm["MCP", m][0] for m in ("RI", "UI"))
    assert intrinsic == pytest.approx(left, rel=1e-9)


def test_the_plates_push_lifts_a_flat_finger_and_flexors_hold_it() -> None:
    flat = pressing_wrench((0.0, 0.0, 0.0, 0.0), (0.0, 10.0, 0.0))
    np.testing.assert_allclose(flat, [0.0, -10.0, 0.0, 0.0, 0.0, 0.0], atol=1e-12)
    upright = pressing_wrench((90.0, 60.0, 20.0, 0.0), (0.0, 10.0, 0.0))
    np.testing.assert_allclose(upright[:3], [-10.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(
        np.rad2deg(pressing_posture(index().topology, (90.0, 60.0, 20.0, -5.0))), [25.0, 0.0, 40.0, 30.0]
    )
    held = pressing_forces(index(), (30.0, 20.0, 10.0, 0.0), (0.0, 10.0, 0.0), "least_squares")
    assert held.muscle["FDP"] + held.muscle["FDS"] > 1.0


def test_both_models_agree_where_the_hood_carries_nothing() -> None:
    """A load that FDP alone holds leaves nothing to share."""
    finger = index()
    posture = jnp.asarray([[0.4, 0.0, 0.7, 0.5]])
    alone = jnp.asarray([[9.0 if m == "FDP" else 0.0 for m in finger.topology.muscles]])
    tip = np.asarray(clamp_forces_batch(finger.topology, jax_values(finger.values), posture, alone).tip[0])
    minimal, chao = (inverted(name, posture[0].tolist(), tip) for name in LINEAR)
    np.testing.assert_allclose(np.asarray(minimal.slip), np.asarray(chao.slip), atol=1e-8)
    np.testing.assert_allclose(np.asarray(minimal.contact), np.asarray(chao.contact), atol=1e-8)
    assert minimal.slip[slip_names(finger.topology).index("FDP")] == pytest.approx(9.0)


def given_of(finger: Finger, posture: Sequence[float], wrench: Floats, scale: float) -> Given:
    anatomy = anatomy_of(finger.values)
    sd = np.where(np.arange(len(anatomy)) < 6 * len(finger.topology.segments), 0.3 * scale, 0.0)
    return Given(
        anatomy,
        sd,
        anatomy - 20.0,
        anatomy + 20.0,
        np.array([posture]),
        np.deg2rad([1.0 * scale] * 4),
        wrench[None],
        (scale * np.diag([0.05, 0.05, 0.05, 0.0, 0.0, 1.0]))[None] ** 2,
        np.zeros((1, 6), dtype=bool),
    )


@pytest.mark.parametrize("name", LINEAR)
def test_propagated_uncertainty_is_that_of_draws(name: str) -> None:
    finger = index()
    given_ = given_of(finger, [0.4, 0.0, 0.7, 0.5], wrench_of([1.0, -3.0, 0.2, 5.0]), 0.2)
    closure = closure_of(name, finger.topology)
    inverse = invert(finger, closure, given_)
    muscles, balance = sampled(finger, closure, given_, 2000)
    contact = np.asarray(balance.contact)
    np.testing.assert_allclose(muscles.std(axis=0), inverse.muscle_sd, rtol=0.1)
    np.testing.assert_allclose(np.asarray(balance.slip).std(axis=0), inverse.slip_sd, rtol=0.1, atol=1e-12)
    np.testing.assert_allclose(contact.std(axis=0), inverse.contact_sd, rtol=0.1)
    np.testing.assert_allclose(np.linalg.norm(contact, axis=3).std(axis=0), inverse.contact_norm_sd, rtol=0.1)


@pytest.mark.parametrize("name", NAMES)
def test_nothing_uncertain_leaves_no_uncertainty(name: str) -> None:
    finger = index()
    inverse = invert(
        finger,
        closure_of(name, finger.topology),
        given_of(finger, [0.4, 0.0, 0.7, 0.5], wrench_of([1.0, -3.0, 0.2, 5.0]), 0.0),
        draws=3,
    )
    assert np.abs(inverse.muscle_sd).max() < 1e-9
    assert np.abs(inverse.contact_norm_sd).max() < 1e-9


def test_a_muscle_that_would_have_to_push_is_named() -> None:
    answer = pressing_forces(index().replace_values(load_point=[-19.67, 0.0, 0.0]), *FLEXED, "minimal")
    assert answer.push == ("PF", "PE")
    assert answer.muscle["PE"] < 0.0


def test_a_closure_that_does_not_fit_is_refused() -> None:
    topology = index().topology
    with pytest.raises(InputError, match="no closure 'winslow'; expected one of minimal"):
        closure_of("winslow", topology)
    hood = topology.hood
    assert isinstance(hood, Hood)
    apart = replace(topology, muscles=(*topology.muscles, "EI"), hood=replace(hood, extensors=("EDC", "EI")))
    for name in LINEAR:
        with pytest.raises(ModelError, match="without one long extensor"):
            closure_of(name, apart)
        with pytest.raises(ModelError, match="without RI"):
            closure_of(name, replace(topology, muscles=("LU", "UI", "FDP", "FDS", "EDC")))
    with pytest.raises(ModelError, match="tensions for"):
        closure_of("chao", replace(topology, joints=topology.joints[1:]))


def test_a_load_must_be_there_and_every_bone_have_its_angle() -> None:
    with pytest.raises(InputError, match="no load"):
        pressing_forces(index(), FLEXED[0], (0.0, 0.0, 0.0))
    with pytest.raises(InputError, match="3 angles"):
        pressing_forces(index(), (10.0, 5.0, 0.0), (0.0, 1.0, 0.0))


@pytest.mark.parametrize("name", ["an1979_index", "an1979_middle", "synek2019_bonobo", "wu2008_index"])
def test_every_shipped_human_and_bonobo_finger_has_its_areas(name: str) -> None:
    areas = areas_of(read_finger(name))
    assert (areas.cm2 > 0.0).all()
    assert "assumed" not in areas.source


def test_a_finger_of_unknown_areas_takes_the_third_digits_and_says_so() -> None:
    assert "assumed for own" in areas_of(replace(index(), id="own")).source
