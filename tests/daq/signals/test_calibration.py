from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from daq.cells import cell_spec
from daq.sessions import Mount
from daq.signals.calibration import cross_matrix, intrinsic_xyz, mount_taking_up, mount_transform, xyz_angles_deg
from daq.signals.corrections import measure
from tests.daq.benches import WRENCH, Floats, bench, record, recorded

vectors = arrays(np.float64, 3, elements=st.floats(-50, 50, width=32))
angles = st.tuples(*[st.floats(-180, 180, width=32)] * 3)
sides = st.sampled_from(["left", "right"])


def mount(rotation_deg: tuple[float, ...] | None = None, offset_mm: Floats | None = None) -> Mount:
    return Mount.model_validate(
        {
            "rotation_deg": None if rotation_deg is None else list(rotation_deg),
            "offset_mm": None if offset_mm is None else offset_mm.tolist(),
        }
    )


@given(angles)
def test_the_rotation_is_proper_and_the_two_ways_to_give_it_agree(rotation_deg: tuple[float, ...]) -> None:
    R = intrinsic_xyz(rotation_deg)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)
    by_matrix = Mount.model_validate({"rotation": R.tolist()})
    np.testing.assert_allclose(
        mount_transform(by_matrix, "left").matrix, mount_transform(mount(rotation_deg), "left").matrix, atol=1e-12
    )


def test_angles_are_intrinsic_x_then_y_then_z() -> None:
    # A quarter turn about x, then about the new y: the cell's x comes to lie along the mount's y × … = -z turned by x.
    R = intrinsic_xyz((90.0, 90.0, 0.0))
    np.testing.assert_allclose(R @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(R @ [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], atol=1e-12)


@given(angles, vectors, vectors, vectors)
def test_a_force_at_a_point_keeps_its_point(
    rotation_deg: tuple[float, ...], offset_mm: Floats, point_mm: Floats, force_N: Floats
) -> None:
    transform = mount_transform(mount(rotation_deg, offset_mm), "right")
    R = intrinsic_xyz(rotation_deg)
    wrench = transform.apply(np.concatenate([force_N, np.cross(point_mm, force_N)]))
    np.testing.assert_allclose(wrench[:3], R @ force_N, atol=1e-9)
    np.testing.assert_allclose(wrench[3:], np.cross(R @ (point_mm - offset_mm), R @ force_N), atol=1e-8)


def test_a_force_through_the_load_point_has_no_moment_once_the_offset_is_stated() -> None:
    # The load point lies 6.5 mm above the cell's origin, along the cell's z.
    force, load_point = np.array([2.0, 0.0, 1.0]), np.array([0.0, 0.0, 6.5])
    on_cell = np.concatenate([force, np.cross(load_point, force)])
    assert on_cell[4] == 13.0
    moved = mount_transform(mount((0.0, 0.0, 90.0), load_point), "right").apply(on_cell)
    np.testing.assert_allclose(moved, [0.0, 2.0, 1.0, 0.0, 0.0, 0.0], atol=1e-12)


@given(angles)
def test_angles_are_read_from_a_rotation_also_where_y_turns_by_a_quarter(rotation_deg: tuple[float, ...]) -> None:
    for given_deg in (rotation_deg, (rotation_deg[0], 90.0, rotation_deg[2])):
        R = intrinsic_xyz(given_deg)
        np.testing.assert_allclose(intrinsic_xyz(xyz_angles_deg(R)), R, atol=1e-9)


@pytest.mark.parametrize(("side", "stated"), [("left", True), ("right", True), ("right", False)])
@given(angles, vectors, angles, vectors, vectors, vectors)
def test_a_mount_takes_up_how_its_readings_are_off(
    side: str,
    stated: bool,
    rotation_deg: tuple[float, ...],
    offset_mm: Floats,
    turned_deg: tuple[float, ...],
    away_mm: Floats,
    force_N: Floats,
    torque_Nmm: Floats,
) -> None:
    known, turned = mount(rotation_deg, offset_mm) if stated else None, intrinsic_xyz(turned_deg)
    comes_out = np.concatenate([turned @ force_N, turned @ (torque_Nmm - np.cross(away_mm, force_N))])
    on_cell = np.linalg.solve(mount_transform(known, side).matrix, comes_out)
    right = mount_transform(mount_taking_up(known, side, turned, away_mm), side).apply(on_cell)
    np.testing.assert_allclose(right, np.concatenate([force_N, torque_Nmm]), atol=1e-7)


def test_a_left_hand_without_a_rotation_is_offset_and_not_turned() -> None:
    taken = mount_taking_up(None, "left", intrinsic_xyz((5.0, 0.0, 0.0)), np.array([4.0, 0.0, 0.0]))
    assert taken.rotation_deg is None, "a rotation would mirror readings that are in place already"
    assert taken.offset_mm == pytest.approx([-4.0, 0.0, 0.0])


@given(angles, vectors, vectors, vectors, sides)
def test_what_no_rigid_motion_changes(
    rotation_deg: tuple[float, ...], offset_mm: Floats, force_N: Floats, torque_Nmm: Floats, side: str
) -> None:
    transform = mount_transform(mount(rotation_deg, offset_mm), side)
    wrench = transform.apply(np.concatenate([force_N, torque_Nmm]))
    assert np.linalg.norm(wrench[:3]) == pytest.approx(np.linalg.norm(force_N), abs=1e-9)
    # The pitch of the screw: force times torque. A mirror turns its sense.
    sign = -1.0 if side == "left" else 1.0
    assert wrench[:3] @ wrench[3:] == pytest.approx(sign * force_N @ torque_Nmm, rel=1e-6, abs=1e-6)
    assert np.linalg.det(transform.matrix) == pytest.approx(sign, rel=1e-6)


@given(vectors, vectors)
def test_cross_matrix(a: Floats, b: Floats) -> None:
    np.testing.assert_allclose(cross_matrix(a) @ b, np.cross(a, b), atol=1e-9)


@given(angles, vectors, sides)
def test_covariance_goes_with_the_wrench(rotation_deg: tuple[float, ...], offset_mm: Floats, side: str) -> None:
    rng = np.random.default_rng(1)
    samples = rng.normal(size=(50, 6)) @ rng.normal(size=(6, 6))
    transform = mount_transform(mount(rotation_deg, offset_mm), side)
    expected = np.cov(transform.apply(samples).T)
    np.testing.assert_allclose(transform.apply_covariance(np.cov(samples.T)), expected, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("side", ["left", "right"])
def test_without_a_rotation_readings_are_in_place_already(side: str) -> None:
    np.testing.assert_array_equal(mount_transform(None, side).apply(WRENCH), WRENCH)
    np.testing.assert_array_equal(mount_transform(Mount(), side).apply(WRENCH), WRENCH)
    moved = mount_transform(mount(None, np.array([1.0, 2.0, 3.0])), side).apply(WRENCH)
    np.testing.assert_allclose(moved[3:], WRENCH[3:] - np.cross([1.0, 2.0, 3.0], WRENCH[:3]))


def test_a_rotation_of_zero_still_mirrors_a_left_hand() -> None:
    turned = mount_transform(mount((0.0, 0.0, 0.0)), "left").apply(WRENCH)
    np.testing.assert_allclose(turned, WRENCH * [1, 1, -1, -1, -1, 1])


def test_a_mirrored_rig_measures_the_same(tmp_path: Path) -> None:
    """A right hand's rig, and its image in a mirror with an ordinary cell in another orientation, agree."""
    truth, zero = WRENCH, np.array([0.3, 1.0, -2.0, 5.0, 4.0, -3.0])
    results = {}
    for side, rotation_deg, offset_mm in (
        ("right", (20.0, -35.0, 110.0), np.array([3.0, -8.0, 5.0])),
        ("left", (-70.0, 15.0, 42.0), np.array([-6.0, 2.0, 9.0])),
    ):
        # What happens, in (proximal, dorsal, proximal × dorsal): the mirror turns the third axis of a left hand.
        world = truth * [1, 1, -1, -1, -1, 1] if side == "left" else truth
        R = intrinsic_xyz(rotation_deg)
        force = R.T @ world[:3]
        on_cell = np.concatenate([force, R.T @ world[3:] + np.cross(offset_mm, force)])
        data = recorded()
        data["specimen"]["side"] = side
        data["load_cell"]["mounts"]["tip"] = {"rotation_deg": list(rotation_deg), "offset_mm": offset_mm.tolist()}
        session = bench(tmp_path / side, data, record([zero, zero + on_cell]))
        results[side] = measure(session).cases[0].wrench
    np.testing.assert_allclose(results["right"], truth, atol=1e-9)
    np.testing.assert_allclose(results["left"], truth, atol=1e-9)


@pytest.mark.parametrize(
    ("model", "force", "torque"),
    [
        ("ATI Nano17-E SI-25-0.25", 25.0, 250.0),
        ("Nano 17 SI-50-0.5", 50.0, 500.0),
        ("nano17 si-12-0.12", 12.0, 120.0),
    ],
)
def test_known_cells(model: str, force: float, torque: float) -> None:
    spec = cell_spec(model)
    assert spec is not None
    assert spec.range[0] == force
    assert spec.range[5] == torque
    assert spec.resolution[0] == pytest.approx(force / 4000, rel=0.05)
    assert spec.resolution[3] == pytest.approx(torque / 8000, rel=0.05)


@pytest.mark.parametrize("model", [None, "", "ATI Nano17-E", "ATI Mini45 SI-290-10", "Nano17 Ti SI-25-0.25"])
def test_unknown_cells(model: str | None) -> None:
    assert cell_spec(model) is None
