"""The model of a session: its noise by case, its discrepancies, and what may act."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from daq.errors import SessionError
from fingermodel.diagnosis.session_model.bad_cases import BAD_N
from fingermodel.diagnosis.session_model.candidates import NOTHING, Candidates, Explanation, Member
from fingermodel.diagnosis.session_model.case_noise import CaseErrors
from fingermodel.diagnosis.session_model.discrepancy import LEFT_OUT, Places, reduced
from fingermodel.diagnosis.session_model.session import Session as SessionModel
from fingermodel.diagnosis.session_model.session import session_of
from fingermodel.diagnosis.session_model.whitening import whitened
from fingermodel.diagnosis.settings import P_NOTHING
from fingermodel.effects.user import shipped_effects
from fingermodel.session import Session

Floats = NDArray[np.float64]


@pytest.fixture(scope="module")
def bench() -> Session:
    return Session.open("DEV-01")


@pytest.fixture(scope="module")
def session(bench: Session) -> SessionModel:
    return session_of(bench.model, bench.observations)


@pytest.fixture(scope="module")
def candidates(bench: Session) -> Candidates:
    return Candidates.of(bench.model)


def test_all_moments_at_the_tip_are_fitted_and_none_at_the_bone(session: SessionModel) -> None:
    places = np.array(session.observations.locations)[session.rows // 6]
    assert set(session.rows[places == "tip"] % 6) == set(range(6))
    assert set(session.rows[places == "bone"] % 6) == {0, 1, 2}


def test_a_session_in_which_nothing_hangs_is_refused_in_words(bench: Session) -> None:
    inputs = bench.observations.inputs
    empty = replace(bench.observations, inputs=inputs._replace(tension=jnp.zeros_like(inputs.tension)))
    with pytest.raises(SessionError, match="no weight hangs in any identification case"):
        session_of(bench.model, empty)


def _with_loads(session: SessionModel, postures: Any, tension: Floats, at_bone: Any) -> SessionModel:
    """The session with other postures, tensions (cases, muscles) and mounts of its cases."""
    inputs = session.observations.inputs._replace(tension=jnp.array(tension), at_bone=jnp.array(at_bone))
    observations = replace(session.observations, postures=tuple(postures.tolist()), inputs=inputs)
    return replace(session, problem=replace(session.problem, observations=observations))


@pytest.mark.parametrize(("heavier", "new"), [(1.0, False), (10.0, True)])
def test_a_case_that_is_heavier_than_all_fitted_ones_is_beyond_them(
    session: SessionModel, heavier: float, new: bool
) -> None:
    inputs = session.observations.inputs
    unseen = np.unique(session.rows[~session.fitted] // 6)
    alike = np.resize(np.unique(session.rows[session.fitted] // 6), len(unseen))
    tension, at_bone = np.array(inputs.tension), np.array(inputs.at_bone)
    tension[unseen], at_bone[unseen] = heavier * tension[alike], at_bone[alike]
    postures = np.array(session.observations.postures)
    postures[unseen] = postures[alike]
    hung = tension[unseen].any(axis=1)
    other = _with_loads(session, postures, tension, at_bone)
    # A case in which nothing hangs is no heavier ten times over.
    assert np.flatnonzero(other.beyond_fitted).tolist() == unseen[hung & new].tolist()


@pytest.mark.parametrize(("posture", "bone"), [("another", False), ("", True)])
def test_a_case_in_another_posture_or_at_the_other_mount_is_beyond_the_fitted_ones(
    session: SessionModel, posture: str, bone: bool
) -> None:
    inputs = session.observations.inputs
    unseen, fitted = (np.unique(session.rows[chosen] // 6) for chosen in (~session.fitted, session.fitted))
    tension, at_bone = np.zeros_like(inputs.tension), np.zeros_like(inputs.at_bone)
    tension[:, 0], postures = 1.0, np.array([""] * len(tension), dtype=object)
    at_bone[unseen[0]], postures[unseen[0]] = bone, posture
    other = _with_loads(session, postures, tension, at_bone)
    assert unseen[0] not in fitted
    assert np.flatnonzero(other.beyond_fitted).tolist() == [unseen[0]]


def test_validation_cases_are_predicted_and_never_fitted(session: SessionModel) -> None:
    roles = np.array(session.observations.roles)[session.rows // 6]
    assert (roles[~session.fitted] == "validation").all()
    assert (roles[session.fitted] != "validation").all()


@pytest.mark.parametrize(("assumed", "size"), [(True, 1.5), (False, 0.004)])
def test_whitening_undoes_the_noise_of_every_case(session: SessionModel, assumed: bool, size: float) -> None:
    noise, errors = replace(session.fitted_noise, assumed=assumed), CaseErrors(0.02, size, 0.005, 0.01, 0.02)
    bad = frozenset({int(noise.cases[0])})
    roots, log_det = noise.whitening(errors, bad)
    n = len(noise.cases)
    covariance = np.zeros((n, n))
    for rows, blocks in noise.covariances(errors, bad):
        covariance[rows[:, :, None], rows[:, None, :]] = blocks
    np.testing.assert_allclose(whitened(roots, whitened(roots, covariance).T), np.eye(n), atol=1e-8)
    assert log_det == pytest.approx(np.linalg.slogdet(covariance)[1])


def test_measured_noise_gets_more_of_each_reading_by_itself_and_assumed_noise_is_multiplied(
    session: SessionModel,
) -> None:
    measured = session.fitted_noise
    assumed = replace(measured, assumed=True)
    for (rows, plain), (_, more), (_, same), (_, twice) in zip(
        measured.covariances(CaseErrors(0.01, 0.0), ()),
        measured.covariances(CaseErrors(0.01, 0.004), ()),
        assumed.covariances(CaseErrors(0.0, 1.0), ()),
        assumed.covariances(CaseErrors(0.0, 2.0), ()),
        strict=True,
    ):
        added = np.where(session.changes.places.moment[session.fitted], 0.04, 0.004)[rows] ** 2
        np.testing.assert_allclose(more - plain, added[:, :, None] * np.eye(rows.shape[1]), atol=1e-12)
        np.testing.assert_allclose(twice, 4.0 * same)


def test_a_bad_case_may_be_anything_and_the_others_are_as_before(session: SessionModel) -> None:
    noise = session.fitted_noise
    case = int(noise.cases[0])
    errors = CaseErrors(0.01, 0.0)
    for (rows, plain), (_, bad) in zip(noise.covariances(errors, ()), noise.covariances(errors, (case,)), strict=True):
        is_bad = noise.cases[rows[:, 0]] == case
        np.testing.assert_array_equal(plain[~is_bad], bad[~is_bad])
        grown = np.diagonal(bad - plain, axis1=1, axis2=2)[is_bad]
        assert (grown >= BAD_N**2 - 1e-9).all()


def test_scatter_acts_on_each_tendon_by_itself(session: SessionModel) -> None:
    by_tension = session.changes.by_tension(session.problem.centre)
    for columns, tension in zip(by_tension, np.asarray(session.observations.inputs.tension), strict=True):
        assert not columns[:, tension <= 0.0].any()


@pytest.mark.parametrize("kind", ["scatter", "component", "direction", "angle_rad"])
def test_scatter_gives_the_readings_what_a_tension_a_component_the_force_or_an_angle_changes(
    session: SessionModel, kind: str
) -> None:
    inputs, theta, step = session.observations.inputs, session.problem.centre, 1e-3
    now, by_tension, unit = (
        session.changes.readings(theta),
        session.changes.by_tension(theta),
        np.array([1.0] * 3 + [10.0] * 3),
    )
    if kind == "scatter":
        columns = np.moveaxis(by_tension, 2, 0)
    elif kind == "component":
        columns = np.array([now * (np.arange(6) == k) for k in range(6)])
    elif kind == "direction":
        force = np.linalg.norm(by_tension[:, :3], axis=(1, 2))[:, None]
        columns = np.array([force * unit * (np.arange(6) == k) for k in range(6)])
    else:
        turned = [np.asarray(inputs.posture) + step * (np.arange(4) == k) for k in range(4)]
        there = [session.model.predict(inputs._replace(posture=jnp.asarray(p)), theta).reading for p in turned]
        columns = (np.array([np.asarray(t) for t in there]) - now) / step
    read = columns.reshape(len(columns), -1)[:, session.rows[session.fitted]]
    none = CaseErrors(0.0, 0.0)
    some = none._replace(**{kind: 0.02})
    noise = session.fitted_noise
    for (rows, plain), (_, more) in zip(noise.covariances(none, ()), noise.covariances(some, ()), strict=True):
        expected = 0.02**2 * np.einsum("kga,kgb->gab", read[:, rows], read[:, rows])
        np.testing.assert_allclose(more - plain, expected, rtol=5e-3, atol=1e-7)


@pytest.mark.parametrize("kind", ["zero_N", "turn_rad", "hold_mm", "apart_rad"])
def test_a_finger_that_is_clamped_anew_changes_what_is_read_in_one_setting_alone(
    session: SessionModel, kind: str
) -> None:
    observations, inputs, step = session.observations, session.observations.inputs, 1e-5
    wrench, theta = np.nan_to_num(observations.wrench), session.problem.centre
    setting, bone, check = (np.asarray(of) for of in (inputs.setting, inputs.at_bone, inputs.is_check))
    now = np.asarray(session.model.predict(inputs, theta).reading)
    expected = list[Floats]()
    for k, at in itertools.product(np.unique(setting[~check]), (False, True)):
        here = (setting == k) & (bone == at) & ~check
        if kind == "zero_N":
            changed = [
                step * np.array([1.0, 1.0, 1.0, 10.0, 10.0, 10.0]) * (np.arange(6) == c) + 0 * wrench for c in range(6)
            ]
        elif kind == "turn_rad":
            turns = [Rotation.from_rotvec(step * axis) for axis in np.eye(3)]
            changed = [np.concatenate([t.apply(wrench[:, :3]), t.apply(wrench[:, 3:])], axis=1) - wrench for t in turns]
        elif kind == "hold_mm":
            levers = [step * np.cross(axis, wrench[:, :3]) for axis in np.eye(3)]
            changed = [np.concatenate([np.zeros_like(m), m], axis=1) * ~bone[:, None] for m in levers]
        else:
            here = (setting == k) & ~check & (not at)
            # To the same side for both: the derivative is one-sided where a tendon comes to rest.
            postures = [np.asarray(inputs.posture) + step * axis for axis in np.eye(4)]
            there = [session.model.predict(inputs._replace(posture=jnp.asarray(p)), theta).reading for p in postures]
            changed = [np.where(bone, -1.0, 1.0)[:, None] * (np.asarray(t) - now) for t in there]
        expected += [(c * here[:, None]).reshape(-1)[session.rows] / step for c in changed]
    columns = [column for column in expected if np.abs(column).max() > 1e-6]
    assert session.errors.by_group[kind].shape[1] == len(columns)
    for column in columns:
        miss = np.abs(session.errors.by_group[kind] - column[:, None]).max(axis=0).min()
        assert miss < 0.01 * np.abs(column).max()


def test_a_zero_moves_slowly_within_a_setting_and_not_on_the_whole(session: SessionModel) -> None:
    inputs, found = session.observations.inputs, session.errors.by_group["drift_N"]
    cases, component = np.divmod(session.rows, 6)
    elapsed = np.asarray(inputs.elapsed)[cases]
    place = 2 * np.asarray(inputs.setting)[cases] + np.asarray(inputs.at_bone)[cases]
    assert found.shape[1] > 0
    for column in found.T:
        here = np.flatnonzero(column)
        assert len(np.unique(place[here])) == len(np.unique(component[here])) == 1
        there = column[here][np.argsort(elapsed[here])]
        turns = np.diff(np.sign(np.diff(there)))
        assert (turns != 0).sum() <= 3
        assert np.ptp(there) > 0.5 * np.abs(there).max()


def test_a_line_that_is_turned_shows_at_the_bone_wherever_its_tendon_is_loaded(session: SessionModel) -> None:
    inputs, step, found = session.observations.inputs, 1e-6, session.errors.by_group["line_rad"]
    tension, suture = np.asarray(inputs.tension), np.array(session.model.values.suture)
    for muscle, axis in itertools.product(range(len(suture)), np.eye(3)):
        turned = Rotation.from_rotvec(step * axis).apply(suture[muscle]) - suture[muscle]
        change = np.zeros((len(tension), 6))
        change[:, :3] = np.where(np.asarray(inputs.at_bone)[:, None], tension[:, [muscle]] * turned / step, 0.0)
        column = change.reshape(-1)[session.rows]
        if np.abs(column).max() > 1e-6:
            assert np.abs(found - column[:, None]).max(axis=0).min() < 1e-4 * np.abs(column).max()


def test_a_weight_errs_alike_wherever_it_hangs_and_some_of_it_on_each_tendon(session: SessionModel) -> None:
    tension, theta = np.asarray(session.observations.inputs.tension), session.problem.centre
    by_tension, covariance = session.changes.by_tension(theta), np.zeros((len(session.rows), len(session.rows)))
    for weight in np.unique(tension[tension > 0.0].round(6)):
        here = np.isclose(tension, weight, atol=1e-6)
        on = [here * (np.arange(tension.shape[1]) == t) for t in range(tension.shape[1])]
        for hangs in [here, *on]:
            if hangs.any(axis=1).sum() > 1:
                column = (hangs[:, None, :] * by_tension).sum(axis=2)[session.rows // 6, session.rows % 6]
                covariance += 0.5 * np.outer(column, column)
    found = session.errors.by_group["weight"]
    np.testing.assert_allclose(found @ found.T, covariance, rtol=1e-9, atol=1e-9)


def test_something_smooth_in_torque_reaches_tip_and_bone_together(session: SessionModel) -> None:
    torque = session.changes.smooth("torque:")
    places = np.array(session.observations.locations)[session.rows // 6]
    strength = np.abs(torque).sum(axis=0)
    both = (np.abs(torque[places == "tip"]).sum(axis=0) > 0) & (np.abs(torque[places == "bone"]).sum(axis=0) > 0)
    assert both[strength > 0.1 * strength.max()].all()


@given(st.integers(0, 10**6), st.integers(1, 60), st.integers(1, 9), st.integers(1, 5), st.integers(0, 4))
def test_reduced_columns_leave_out_a_hundredth_of_the_largest_variance(
    seed: int, readings: int, changes: int, postures: int, alike: int
) -> None:
    rng = np.random.default_rng(seed)
    varying, smooth = rng.normal(size=(changes, readings)), rng.normal(size=(readings, postures))
    same, moment = rng.normal(size=(readings, alike)), rng.random(readings) < 0.5
    nowhere = np.zeros((readings, 0))
    at = Places([], nowhere, smooth, nowhere, moment, np.zeros(readings, dtype=np.intp))
    root = reduced(at, list(varying), same) / at.unit[:, None]
    whole = (varying.T @ varying) * (smooth @ smooth.T) + same @ same.T
    left = whole - root @ root.T
    assert np.diag(left).max() <= (LEFT_OUT + 1e-9) * np.diag(whole).max()
    assert np.linalg.eigvalsh(left).min() >= -1e-9 * np.diag(whole).max()


def test_a_discrepancy_spares_the_checks(session: SessionModel) -> None:
    checks = np.array(session.observations.roles)[session.rows // 6] == "check"
    for carrier in session.changes.carriers:
        assert not session.changes.smooth(f"torque:{carrier}")[checks].any()
        assert not session.changes.smooth(f"tension:{carrier}")[checks].any()
        assert not session.changes.smooth(f"loaded:{carrier}")[checks].any()
    assert not session.changes.smooth("constant:")[checks].any()


def test_what_one_tendon_carries_is_in_its_cases_alone(session: SessionModel) -> None:
    tension = np.asarray(session.observations.inputs.tension)[session.rows // 6]
    muscles = session.model.finger.topology.muscles
    tendons = [carrier for carrier in session.changes.carriers if carrier in muscles]
    assert len(tendons) == np.count_nonzero(tension.any(axis=0))
    for name in tendons:
        loaded = tension[:, muscles.index(name)] > 0.0
        for family in ("torque", "tension", "loaded"):
            columns = session.changes.smooth(f"{family}:{name}")
            assert columns[loaded].any()
            assert not columns[~loaded].any()


def test_a_tension_that_gets_lost_by_posture_is_something_smooth_of_its_tendon(session: SessionModel) -> None:
    cases, components = session.rows // 6, session.rows % 6
    by_tension = session.changes.by_tension(session.problem.centre)[cases, components]
    names, postures = list(session.observations.posture_angles), session.observations.postures
    lost = np.array([0.1 * np.cos(session.observations.posture_angles[n][0]) for n in names])
    at = np.array([lost[names.index(postures[c])] if postures[c] else 0.0 for c in cases])
    for k, name in enumerate(session.model.finger.topology.muscles):
        change = (at * by_tension[:, k] / session.changes.places.unit)[:, None]
        columns = session.changes.smooth(f"tension:{name}") / session.changes.places.unit[:, None]
        left = change - columns @ np.linalg.lstsq(columns, change, rcond=None)[0]
        assert np.abs(left).max() < 0.05 * np.abs(change).max()
        # Amplitudes are in newtons at the reading that changes most.
        assert np.sqrt((columns**2).sum(axis=1)).max() == pytest.approx(1.0, abs=0.1)


def test_what_one_rotation_carries_turns_about_it_alone(session: SessionModel) -> None:
    rotations = list(session.model.finger.topology.rotations)
    answer = session.changes.torque_answer[session.rows // 6, :, session.rows % 6]
    for name in rotations:
        columns, own = session.changes.smooth(f"torque:{name}"), answer[:, rotations.index(name)]
        np.testing.assert_array_equal(columns[own == 0.0], 0.0)


def test_a_clamp_that_resists_twist_leaves_joint_torques_as_they_are(session: SessionModel) -> None:
    # Whatever it carries, the joints feel the same torques: what it adds is in the null space of the levers.
    observations, model = session.observations, session.model
    from fingermodel.model import tip_kinematics_batch

    jacobian = np.asarray(
        tip_kinematics_batch(model.finger.topology, model.values, observations.inputs.posture).jacobian
    )
    twist = session.changes.nuisances[:, : 2 * len(observations.layout.settings)]
    for column in twist.T:
        wrench = np.zeros((len(observations.ids), 6))
        wrench[session.rows // 6, session.rows % 6] = column
        tip = np.array(observations.locations) == "tip"
        torque = np.einsum("ncr,nc->nr", jacobian[tip], wrench[tip])
        assert np.abs(torque).max() < 1e-9 * max(np.abs(wrench).max(), 1.0)


def test_the_prior_of_all_hypotheses_is_no_more_than_one(candidates: Candidates) -> None:
    singles = candidates.singles
    total = sum(np.exp(candidates.log_prior(e)) for e in [NOTHING, *singles, *candidates.pairs(singles)])
    assert P_NOTHING < total <= 1.0 + 1e-9
    assert total > 0.9


def test_an_effect_gains_nothing_by_many_candidates_or_forms(candidates: Candidates) -> None:
    by_effect: dict[str, float] = {}
    for single in candidates.singles:
        effect = single.effects[0]
        by_effect[effect] = by_effect.get(effect, 0.0) + float(np.exp(candidates.log_prior(single)))
    inside = {c.effect for c in candidates.all if not c.outside}
    assert np.ptp([p for e, p in by_effect.items() if e in inside]) < 1e-12


def test_what_rigs_are_known_to_do_is_outside(candidates: Candidates) -> None:
    outside = {c.effect for c in candidates.all if c.outside}
    assert set(shipped_effects()) >= outside
    assert "force_shunt" in outside
    assert "hanger_mass" not in outside


def test_neighbours_differ_in_one_member(candidates: Candidates) -> None:
    pair = candidates.pairs(candidates.singles[:1])[5]
    for other in candidates.neighbours(pair):
        assert other != pair
        assert abs(other.size - pair.size) <= 1
        shared = set(pair.members) & set(other.members)
        assert len(shared) >= max(pair.size, other.size) - 1


def test_no_candidate_acts_twice(candidates: Candidates) -> None:
    first = candidates.singles[0].members[0]
    assert candidates.joined((first, first)) is None
    assert candidates.joined(()) == Explanation()
    assert isinstance(first, Member)
