"""What single forms of the catalogue's effects mean: laws that hold whatever the size."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from fingermodel.effects.bowstringing import Bowstringing
from fingermodel.effects.clamp_compliance import ClampCompliance
from fingermodel.effects.hood_shift import HoodShift
from fingermodel.effects.intrinsic_bowstring import IntrinsicBowstring
from fingermodel.effects.lateral_band_slip import LateralBandSlip
from fingermodel.effects.rig_friction import RigFriction
from fingermodel.effects.suture_angle import SutureAngle
from fingermodel.effects.tare_drift import TareDrift
from fingermodel.effects.worn_pulley import WornPulley
from fingermodel.fingers import Finger
from fingermodel.fingers.files import read_finger
from fingermodel.model import jax_values
from fingermodel.stages import Effect, LoadCaseInput, State

Floats = NDArray[np.float64]
FINGER = read_finger("an1979_middle")
shares = st.floats(-0.5, 0.5)
times = st.floats(0.0, 1.0)


def state_of(finger: Finger, posture_deg: list[float], tension: Floats | float) -> State:
    """A finger in a posture (MCP, abduction, PIP, DIP by name), with tensions [N] and nothing read yet."""
    topology = finger.topology
    angles = dict(zip(("MCP", "PIP", "DIP"), posture_deg, strict=True))
    posture = np.deg2rad([angles.get(name, 0.0) for name in topology.rotations])
    hung = np.broadcast_to(np.asarray(tension, dtype=float), (len(topology.muscles),))
    return State(topology, jnp.asarray(posture), jax_values(finger.values), jnp.asarray(hung), wrench=jnp.zeros(6))


def case_of(*, at_bone: bool = False, elapsed: float = 0.0, since_tare: float = 0.0) -> LoadCaseInput:
    nothing = jnp.zeros(0)
    return LoadCaseInput(
        posture=nothing,
        tension=nothing,
        at_bone=jnp.asarray(at_bone),
        known_force=jnp.zeros(3),
        is_check=jnp.asarray(False),
        setting=jnp.asarray(0),
        mounting=jnp.asarray(0),
        weight=jnp.asarray(0.008),
        unloading=jnp.asarray(False),
        since_tare=jnp.asarray(since_tare),
        elapsed=jnp.asarray(elapsed),
    )


def lifted(p: list[float], posture_deg: list[float]) -> tuple[Floats, Floats]:
    """How far the flexors' proximal and distal points go palmar [mm] under 8 N each."""
    before = state_of(FINGER, posture_deg, 8.0)
    after = Bowstringing().geometry(jnp.asarray(p), case_of(), before)
    moved = np.array([s.slip in ("FDP", "FDS") for s in FINGER.topology.segments])
    proximal = np.asarray(before.values.proximal_point - after.values.proximal_point)
    distal = np.asarray(before.values.distal_point - after.values.distal_point)
    assert np.all(proximal[~moved] == 0.0)
    assert np.all(distal[~moved] == 0.0)
    return proximal[moved, 1], distal[moved, 1]


def test_flexors_that_press_on_an_extended_joint_do_not_lift_there_and_lift_as_before_in_flexion() -> None:
    extended, flexed = [-25.0, -20.0, -20.0], [50.0, 60.0, 30.0]
    assert lifted([0.5, 0.0, 0.0, 0.0, 0.0], extended)[0].min() > 0.5
    assert np.abs(lifted([0.5, 0.0, 0.0, 1.0, 0.0], extended)[0]).max() < 0.1
    free, pressed = (lifted([0.5, 0.0, 0.0, share, 0.0], flexed)[0] for share in (0.0, 1.0))
    assert pressed == pytest.approx(free, abs=0.1)


def test_flexors_lift_as_the_formula_says_at_every_angle() -> None:
    for angle in (-20.0, 5.0, 10.0, 25.0, 65.0):
        expected = 0.5 * 2.0 * 8.0 * np.sin(0.5 * np.deg2rad(abs(angle)))
        assert lifted([0.5, 0.0, 0.0, 0.0, 0.0], [angle] * 3)[0] == pytest.approx(expected, abs=1e-3)


@given(held=st.floats(0.0, 1.0))
def test_what_holds_the_flexors_beyond_a_joint_takes_its_share_of_the_lift_there(held: float) -> None:
    proximal, distal = lifted([0.5, 0.1, 0.1, 0.5, held], [50.0, 60.0, 30.0])
    assert distal == pytest.approx((1.0 - held) * proximal)


@pytest.mark.parametrize(("effect", "joint"), [(IntrinsicBowstring(), 0), (LateralBandSlip(), 1)])
@given(late=st.floats(0.0, 1.0), flexion_deg=st.floats(1.0, 89.0))
def test_what_moves_late_comes_as_far_at_a_right_angle_and_lags_before(
    effect: Effect, joint: int, late: float, flexion_deg: float
) -> None:
    def palmar(late: float, flexion_deg: float) -> float:
        before = state_of(FINGER, [flexion_deg if k == joint else 0.0 for k in range(3)], 1.0)
        after = effect.geometry(jnp.asarray([4.0, late]), case_of(), before)
        return float(jnp.max(before.values.proximal_point - after.values.proximal_point))

    assert palmar(late, 90.0) == pytest.approx(4.0)
    assert palmar(late, -20.0) == pytest.approx(0.0, abs=1e-9)
    assert palmar(1.0, 45.0) == pytest.approx(4.0 * (1.0 - np.cos(np.pi / 4.0)))
    # Never ahead of what moves from the beginning, nor behind what is slack at first.
    assert palmar(1.0, flexion_deg) - 1e-9 <= palmar(late, flexion_deg) <= palmar(0.0, flexion_deg) + 1e-9


@given(light=st.floats(-1.0, 1.0), pull=st.floats(0.1, 20.0), which=st.integers(0, 5))
def test_a_bearing_loses_another_share_of_a_light_load_and_the_same_of_a_heavy_one(
    light: float, pull: float, which: int
) -> None:
    def lost(effect: Effect, p: Floats, pull: float, *, unloading: bool = False) -> Floats:
        before = state_of(FINGER, [0.0, 0.0, 0.0], pull)
        case = case_of()._replace(unloading=jnp.asarray(unloading))
        return np.asarray(1.0 - effect.tension(jnp.asarray(p), case, before).tension / pull)

    one, rig = np.eye(6)[which], np.array([-10.0, light])
    share = 0.1 * (1.0 + light / (1.0 + pull / 2.0))
    for p, whose in ((rig, np.ones(6)), (np.concatenate([10.0 * one, light * one]), one)):
        effect = RigFriction() if p is rig else WornPulley()
        assert lost(effect, p, pull) == pytest.approx(share * whose, abs=1e-12)
        assert lost(effect, p, 1e6) == pytest.approx(0.1 * whose, abs=1e-5)
    # As weight comes off, friction holds it instead.
    assert lost(RigFriction(), rig, pull, unloading=True) == pytest.approx(-share * np.ones(6))


@given(stiffening=st.floats(0.0, 0.02), pull=st.floats(0.5, 10.0))
def test_a_clamp_that_stiffens_gives_less_of_a_large_torque_and_never_turns_back(
    stiffening: float, pull: float
) -> None:
    def turned(stiffening: float, pull: float) -> Floats:
        before = state_of(FINGER, [30.0, 30.0, 20.0], pull)
        p = jnp.asarray([1e-3, 1e-3, 1e-3, stiffening])
        return np.abs(np.asarray(ClampCompliance().geometry(p, case_of(), before).posture - before.posture))

    spring, stiff = turned(0.0, pull), turned(stiffening, pull)
    assert spring == pytest.approx(turned(0.0, 1.0) * pull)
    assert stiff == pytest.approx(spring / (1.0 + stiffening * spring / 1e-3))


@given(own=st.floats(-0.3, 0.3), which=st.integers(0, 5), angles=st.tuples(st.floats(-12, 12), st.floats(-12, 12)))
def test_a_suture_of_its_own_angle_pulls_where_all_would_at_that_angle(
    own: float, which: int, angles: tuple[float, float]
) -> None:
    state = state_of(FINGER, [0.0, 0.0, 0.0], np.eye(6)[which] * 5.0)

    def read(angles: Floats, own: Floats) -> Floats:
        p = jnp.asarray(np.concatenate([angles, [0.0], own]))
        return np.asarray(SutureAngle().reading(p, case_of(at_bone=True), state).wrench)

    a = np.array(angles)
    assert read(a, own * np.eye(6)[which]) == pytest.approx(read((1.0 + own) * a, np.zeros(6)), abs=1e-12)
    assert read(a, own * np.eye(6)[which - 1]) == pytest.approx(read(a, np.zeros(6)), abs=1e-12)
    side, up = np.deg2rad(a[1]), np.deg2rad(a[0])
    straight = 5.0 * np.array([np.cos(up) * np.cos(side), np.sin(up) * np.cos(side), -np.sin(side)])
    assert read(a, np.zeros(6))[:3] + np.array([5.0, 0.0, 0.0]) == pytest.approx(straight, abs=1e-12)


@given(far=st.floats(1.0, 10.0), which=st.integers(0, 5))
def test_sutures_that_meet_all_point_to_one_eyelet(far: float, which: int) -> None:
    muscle = FINGER.topology.muscles[which]
    tension = np.eye(6)[which] * 5.0
    state = state_of(FINGER, [0.0, 0.0, 0.0], tension)
    pull = np.array([5.0, 0.0, 0.0])
    read = SutureAngle().reading(jnp.asarray([0.0, 0.0, far, *np.zeros(6)]), case_of(at_bone=True), state)
    assert read.wrench is not None
    towards = pull + np.asarray(read.wrench)[:3]
    at = next(s for s in range(len(FINGER.topology.segments)) if FINGER.topology.segments[s].name == f"MCP.{muscle}")
    place = np.asarray(FINGER.values.proximal_point)[at]
    eyelet = np.array([1000.0 / far, 0.0, 0.0])
    line = eyelet - [0.0, place[1], place[2]]
    assert np.cross(towards, line) == pytest.approx(np.zeros(3), abs=1e-9)
    assert np.linalg.norm(towards) == pytest.approx(5.0)
    at_tip = SutureAngle().reading(jnp.asarray([0.0, 0.0, far, *np.zeros(6)]), case_of(at_bone=False), state)
    assert np.all(np.asarray(at_tip.wrench) == 0.0)


@given(early=shares, swell=shares, points=st.tuples(times, times, times))
def test_a_drift_adds_up_over_time_and_comes_to_its_size_over_the_session(
    early: float, swell: float, points: tuple[float, float, float]
) -> None:
    p = jnp.asarray([0.6, -0.2, 0.1, early, swell])

    def drift(start: float, end: float) -> Floats:
        case = case_of(elapsed=end, since_tare=end - start)
        read = TareDrift().reading(p, case, state_of(FINGER, [0.0, 0.0, 0.0], 0.0))
        return np.asarray(read.wrench)[:3]

    first, second, third = sorted(points)
    assert drift(first, third) == pytest.approx(drift(first, second) + drift(second, third), abs=1e-12)
    assert drift(0.0, 1.0) == pytest.approx([0.6, -0.2, 0.1])


@pytest.mark.parametrize(
    ("p", "alike"), [([0.1, 0.0, 0.0, 0.0], False), ([0.0, 0.0, 0.1, 0.0], True), ([0.0, 0.0, 0.0, 0.1], True)]
)
def test_a_hood_slides_with_its_extensor_against_the_intrinsics_or_as_a_whole(p: list[float], alike: bool) -> None:
    before = state_of(FINGER, [60.0, 90.0, 30.0], 5.0)
    after = HoodShift().sharing(jnp.asarray(p), case_of(), before)
    change = np.asarray(after.values.fraction) - np.asarray(before.values.fraction)
    by_name = dict(zip(FINGER.topology.fractions, change, strict=True))
    slips = {name: value for name, value in by_name.items() if name.endswith("_ES")}
    extensor = slips.pop("EDC_ES")
    assert extensor > 0.0
    assert all((value > 0.0) == alike for value in slips.values() if value != 0.0)
    assert any(value != 0.0 for value in slips.values())
    assert all(value == 0.0 for name, value in by_name.items() if name.endswith("_EM"))
