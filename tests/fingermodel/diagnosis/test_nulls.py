"""Tests that need no model: exact forces obey them, each violation has its own, the budget alone breaks none."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from numpy.typing import NDArray

from daq.sessions.protocols import read_protocol
from daq.standins.simulated import SimulatedCell
from fingermodel.comparison.observations import Observations
from fingermodel.comparison.reading_noise import Noise, SharedTare
from fingermodel.diagnosis.model_free.answer import Residuals
from fingermodel.diagnosis.model_free.budget import Readings
from fingermodel.diagnosis.model_free.nulls import Null, nulls
from fingermodel.fingers.files import read_finger
from fingermodel.model import Model, jax_values, tip_kinematics_batch
from fingermodel.rig import simulate_session
from fingermodel.session import Session
from fingermodel.stages import LoadCaseInput
from tests.fingermodel.fingers import PUBLISHED
from tests.simulator import Size, draw_session

Floats = NDArray[np.float64]
NAMES = ["balance", "fds_no_dip_torque", "superposition", "load_levels", "repeats", "moments_closure"]


@pytest.fixture(scope="module")
def bench() -> Session:
    return Session.open("DEV-01", catalogue=False)


@pytest.fixture(scope="module")
def twice(tmp_path_factory: pytest.TempPathFactory) -> Session:
    """Every load case of the published protocol hung twice."""
    folder = tmp_path_factory.mktemp("twice")
    simulate_session(
        read_finger("an1979_middle"),
        read_protocol("synek2019"),
        folder,
        cell=SimulatedCell(rate_hz=25.0),
        seed=3,
        repeats=2,
        readings_name="readings.parquet",
    )
    return Session.open(folder, catalogue=False)


def exact(model: Model, observations: Observations, theta: Floats | None = None) -> Observations:
    """The same session without noise, as the model has it."""
    return replace(observations, wrench=np.asarray(model.predict(observations.inputs, theta).reading).copy())


def only(observations: Observations, keep: Sequence[int]) -> Observations:
    """Some of the cases."""
    place = {case: k for k, case in enumerate(keep)}
    kept = [(t, [i for i, c in enumerate(t.cases) if int(c) in place]) for t in observations.noise.shared]
    shared = (SharedTare(np.array([place[int(c)] for c in t.cases[i]], int), t.columns[i]) for t, i in kept)

    def some(items: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(items[i] for i in keep)

    return replace(
        observations,
        ids=some(observations.ids),
        roles=some(observations.roles),
        postures=some(observations.postures),
        locations=some(observations.locations),
        masses_g=tuple(observations.masses_g[i] for i in keep),
        inputs=LoadCaseInput(*(jnp.asarray(np.asarray(x)[list(keep)]) for x in observations.inputs)),
        wrench=observations.wrench[list(keep)],
        noise=Noise(observations.noise.blocks[list(keep)], tuple(shared)),
    )


def by_name(found: tuple[Null, ...]) -> dict[str, Null]:
    assert [n.name for n in found] == NAMES
    return {n.name: n for n in found}


def violated(found: tuple[Null, ...]) -> set[str]:
    return {n.name for n in found if n.verdict == "violated"}


def cases_of(observations: Observations, *muscles: str, location: str = "tip") -> list[int]:
    """Cases in which just these tendons are loaded."""
    return [
        i
        for i, masses in enumerate(observations.masses_g)
        if set(masses) == set(muscles) and observations.locations[i] == location
    ]


def test_exact_forces_obey_them_all(bench: Session) -> None:
    found = by_name(nulls(bench.model, exact(bench.model, bench.observations)))
    assert found.pop("repeats").verdict == "not_tested"
    for null in found.values():
        assert null.verdict == "holds"
        assert null.statistic is not None
        assert null.statistic < 1e-6
        assert null.p_value == pytest.approx(1.0)
        assert null.cases


def all_forces_larger(o: Observations, w: Floats) -> None:
    w *= 1.1


def bone_mount_turned(o: Observations, w: Floats) -> None:
    c, s = np.cos(np.deg2rad(6.0)), np.sin(np.deg2rad(6.0))
    bone = np.array(o.locations) == "bone"
    w[bone, :2] = w[bone, :2] @ np.array([[c, s], [-s, c]])


def fds_turns_the_dip(o: Observations, w: Floats) -> None:
    w[cases_of(o, "FDS"), 5] += 20.0


def lumbrical_helps_fdp(o: Observations, w: Floats) -> None:
    w[cases_of(o, "FDP", "LU")] *= 1.6


def bone_zero_off(o: Observations, w: Floats) -> None:
    w[np.array(o.locations) == "bone", :3] += [0.3, -0.1, 0.2]


def clamp_twists(o: Observations, w: Floats) -> None:
    w[np.array(o.locations) == "tip", 3] += 3.0


def hook_droops_under_load(o: Observations, w: Floats) -> None:
    """Tip forces fall short, more so at the higher level."""
    tension = np.asarray(o.inputs.tension).sum(axis=1)
    chosen = [i for i in cases_of(o, "UI") if o.postures[i] == "hook"]
    w[chosen] *= 1.0 - 0.2 * tension[chosen, None]


@pytest.mark.parametrize(
    ("change", "names", "words"),
    [
        (all_forces_larger, {"balance"}, ("110.0 ±", "c = 0.919")),
        (bone_mount_turned, {"balance"}, ("do not balance", "worst is RI 650 g in minor_flexion")),
        (fds_turns_the_dip, {"fds_no_dip_torque"}, ("turn the DIP", "20 N mm", "FDS ")),
        (lumbrical_helps_fdp, {"superposition"}, ("do not give the sum", "FDP 600 g + LU 200 g")),
        (hook_droops_under_load, {"load_levels"}, ("neither an unweighed hanger", "UI 500 g in hook at the tip")),
        (clamp_twists, {"moments_closure"}, ("carries more than Fx, Fy, Fz, Mz", "Mx and My are 2.1 N mm")),
    ],
)
def test_a_violation_is_named_by_its_own_test_alone(
    change: Callable[[Observations, Floats], None], names: set[str], words: tuple[str, ...], bench: Session
) -> None:
    observations = exact(bench.model, bench.observations)
    change(observations, observations.wrench)
    found = by_name(nulls(bench.model, observations))
    assert violated(tuple(found.values())) == names
    for name in names:
        p = found[name].p_value
        assert p is not None
        assert p < 1e-3
        for word in words:
            assert word in found[name].text


def test_unweighed_hangers_are_weighed(bench: Session) -> None:
    inputs = bench.observations.inputs
    tension = np.asarray(inputs.tension)
    heavier = tension + 25.0 * np.asarray(inputs.weight)[:, None] * (tension > 0.0)
    reading = bench.model.predict(inputs._replace(tension=jnp.asarray(heavier))).reading
    found = by_name(nulls(bench.model, replace(bench.observations, wrench=np.asarray(reading).copy())))
    assert found["load_levels"].verdict == "violated"
    assert "as if every loaded tendon carried 25.0 ±" in found["load_levels"].text
    assert "(100 % of the misfit)" in found["load_levels"].text
    # Single tendons are drawn on to the load, so what is left is the second hanger … at the bone, where one level hung.
    assert found["superposition"].verdict == "violated"
    assert "at the bone" in found["superposition"].text


def test_a_zero_that_is_off_is_told_with_its_mount(bench: Session) -> None:
    observations = exact(bench.model, bench.observations)
    bone_zero_off(observations, observations.wrench)
    found = by_name(nulls(bench.model, observations))
    assert violated(tuple(found.values())) == {"balance", "superposition", "load_levels"}
    assert "(0.30, \N{MINUS SIGN}0.10, 0.20) N at the bone" in found["load_levels"].text


def test_a_friction_factor_above_one_is_flagged(bench: Session) -> None:
    observations = exact(bench.model, bench.observations)
    found = by_name(nulls(bench.model, replace(observations, wrench=1.25 * observations.wrench)))
    assert "c is above 1 in 21 of 21 loads" in found["balance"].text


def test_scatter_and_an_uncertain_gain_do_not_draw_a_common_factor_down() -> None:
    rng, load = np.random.default_rng(4), np.linspace(1.0, 9.0, 24)
    found = []
    for _ in range(400):
        read = load * (1.0 + 0.02 * rng.normal(size=len(load)))
        noise = 0.005**2 * np.eye(len(load))
        residual = Residuals(read - load, noise + 0.004**2 * np.outer(read, read), noise, noise_assumed=False)
        found.append(residual.factor(load))
    value, sd = np.mean(found, axis=0)
    assert value == pytest.approx(0.0, abs=3.0 * float(np.std([v for v, _ in found])) / 20.0)
    assert sd == pytest.approx(0.004, rel=0.05)


def test_noise_of_unknown_size_widens_what_is_said_of_a_pattern() -> None:
    """Its size is log-normal by a factor of 2: the mean variance is exp(2 ln² 2) of the usual one."""
    load, noise = np.linspace(1.0, 9.0, 24), 0.005**2 * np.eye(24)
    stated, assumed = (Residuals(0.01 * load, noise, noise, noise_assumed=known) for known in (False, True))
    wider = np.exp(np.log(2.0) ** 2)
    assert assumed.factor(load) == pytest.approx([0.01, wider * stated.factor(load)[1]])
    (sd,), (usual,) = (r.along("in proportion", load[:, None]).sd for r in (assumed, stated))
    assert sd == pytest.approx(wider * usual)


def test_what_the_budget_allows_violates_nothing(bench: Session) -> None:
    """Errors of the rig and another specimen, drawn from their priors: no test minds."""
    table = bench.model.parameters
    for seed in range(12):
        draw = np.random.default_rng(seed).normal(size=len(table)) * np.where(np.isfinite(table.sd), table.sd, 0.0)
        theta = np.clip(table.initial + draw, table.lower, table.upper)
        found = nulls(bench.model, exact(bench.model, bench.observations, theta))
        assert not violated(found), seed


@pytest.mark.parametrize(
    ("group", "name"),
    [("mounting_rotation.bone.y", "balance"), ("zero.tip.z", "load_levels"), ("posture_angle", "balance")],
)
def test_what_it_does_not_allow_does(group: str, name: str, bench: Session) -> None:
    table = bench.model.parameters
    theta = table.initial + 8.0 * np.where(table.select(group), table.sd, 0.0)
    assert name in violated(nulls(bench.model, exact(bench.model, bench.observations, theta)))


def test_a_wrong_angle_changes_the_forces_as_it_is_said_to(bench: Session) -> None:
    """The same torques at a moved posture need the forces that the angles' columns tell."""
    observations, finger = exact(bench.model, bench.observations), bench.model.finger
    columns = Readings(bench.model, observations.inputs, observations).angles[0]
    rotations, settings = len(finger.topology.rotations), len(observations.layout.settings)
    said = columns.reshape(len(observations.ids), 6, settings, rotations)
    posture, values = np.asarray(observations.inputs.posture), jax_values(finger.values)
    reactions, step = list(finger.topology.reactions), 1e-5

    def lever(angles: Floats) -> tuple[Floats, Floats]:
        tips = tip_kinematics_batch(finger.topology, values, jnp.asarray(angles))
        return np.asarray(tips.jacobian)[:, reactions].swapaxes(1, 2), np.asarray(tips.to_base)

    tip = np.flatnonzero(np.array(observations.locations) == "tip")
    torque = np.einsum("nic,nc->ni", lever(posture)[0], observations.wrench[:, reactions])
    per_sd = np.deg2rad(bench.model.budget.angle_sd_deg)
    for rotation in range(rotations):
        ends = [
            np.linalg.solve(lever(posture + sign * step * np.eye(rotations)[rotation])[0], torque[:, :, None])[..., 0]
            for sign in (1.0, -1.0)
        ]
        slope = per_sd * (ends[0] - ends[1]) / (2.0 * step)
        for i in tip:
            setting = int(observations.inputs.setting[i])
            assert said[i, reactions, setting, rotation] == pytest.approx(slope[i], abs=1e-5)


def test_a_session_that_lacks_what_they_need_is_told_why(bench: Session) -> None:
    o = exact(bench.model, bench.observations)
    at_tip = only(o, [i for i, x in enumerate(o.locations) if x == "tip"])
    found = by_name(nulls(bench.model, at_tip))
    assert found["balance"].verdict == "not_tested"
    assert "at the bone" in found["balance"].text
    one_level = only(o, [i for i in range(len(o.ids)) if o.masses_g[i] in ({"FDS": 950.0}, {"FDP": 950.0})])
    found = by_name(nulls(bench.model, one_level))
    assert {n for n, x in found.items() if x.verdict == "not_tested"} == {"superposition", "load_levels", "repeats"}
    forces = replace(o, wrench=np.where(np.arange(6) < 3, o.wrench, np.nan))
    found = by_name(nulls(bench.model, forces))
    assert {n for n, x in found.items() if x.verdict == "holds"} == {"balance", "superposition", "load_levels"}
    assert "moment was not read" in found["fds_no_dip_torque"].text
    at_bone = only(o, [i for i, x in enumerate(o.locations) if x == "bone"])
    assert by_name(nulls(bench.model, at_bone))["load_levels"].verdict == "holds"
    single = by_name(nulls(bench.model, only(o, [0])))
    assert {n for n, x in single.items() if x.verdict != "not_tested"} == {"moments_closure"}
    for null in found.values():
        if null.verdict == "not_tested":
            assert (null.statistic, null.p_value, null.cases) == (None, None, ())


@pytest.mark.parametrize("session", PUBLISHED)
def test_published_sessions_rest_nothing_on_an_assumed_noise(session: str) -> None:
    bench = Session.open(session, catalogue=False)
    found = by_name(nulls(bench.model, bench.observations))
    assert found["balance"].verdict == found["superposition"].verdict == "holds"
    assert "the noise is assumed" in found["balance"].text
    assert found["moments_closure"].verdict == found["fds_no_dip_torque"].verdict == "not_tested"
    assert json.loads(json.dumps([n.as_dict() for n in found.values()], allow_nan=False))


def test_no_noise_at_all_still_has_an_answer(bench: Session) -> None:
    quiet = replace(bench.observations, noise=Noise(np.zeros_like(bench.observations.noise.blocks)))
    assert not violated(nulls(bench.model, exact(bench.model, quiet)))


def test_repeats_agree(twice: Session) -> None:
    found = by_name(nulls(twice.model, twice.observations))
    assert not violated(tuple(found.values()))
    assert found["repeats"].verdict == "holds"
    assert len(found["repeats"].cases) == len(twice.observations.ids)
    assert "as it stood" in found["repeats"].text
    assert "over the session" in found["repeats"].text


def second_half(o: Observations) -> NDArray[np.bool_]:
    return np.arange(len(o.ids)) >= len(o.ids) // 2


def test_a_finger_that_softens_shows_in_its_repeats(twice: Session) -> None:
    o = exact(twice.model, twice.observations)
    o.wrench[second_half(o)] *= 0.95
    null = by_name(nulls(twice.model, o))["repeats"]
    assert null.verdict == "violated"
    assert "over the session a change of \N{MINUS SIGN}" in null.text


def test_unloading_is_held_against_loading(twice: Session) -> None:
    o = exact(twice.model, twice.observations)
    second = second_half(o)
    o = replace(o, inputs=o.inputs._replace(unloading=jnp.asarray(second)))
    null = by_name(nulls(twice.model, o))["repeats"]
    assert null.verdict == "holds"
    assert "on unloading against loading" in null.text
    o.wrench[second] *= 1.08
    null = by_name(nulls(twice.model, o))["repeats"]
    assert null.verdict == "violated"
    assert "7.7 ± " in null.text


def test_a_posture_set_anew_may_differ_by_its_angles(twice: Session) -> None:
    """The second round in settings of its own, its angles off by the budget: agreement; by six times that: not."""
    o = twice.observations
    settings = tuple(o.layout.settings)
    layout = replace(o.layout, settings=(*settings, *((name, 1) for name, _ in settings)))
    setting = np.asarray(o.inputs.setting) + len(settings) * second_half(o)
    o = replace(o, layout=layout, inputs=o.inputs._replace(setting=jnp.asarray(setting)))
    model = replace(twice.model, layout=layout)
    angle = model.parameters.select("posture_angle")
    draw = np.random.default_rng(1).normal(size=len(angle)) * np.where(angle, model.parameters.sd, 0.0)
    for times, expected in ((1.0, "holds"), (6.0, "violated")):
        null = by_name(nulls(model, exact(model, o, model.initial + times * draw)))["repeats"]
        assert null.verdict == expected
        assert "set anew" in null.text


def test_good_sessions_of_another_simulator_violate_next_to_nothing(tmp_path: Path) -> None:
    wrong = []
    for protocol in ("dev", "three_levels"):
        for seed in range(1, 5):
            folder = tmp_path / f"{protocol}{seed}"
            draw_session(folder, seed, protocol=protocol, nuisance_scale=1.0)
            bench = Session.open(folder, catalogue=False)
            wrong += [(protocol, seed, name) for name in violated(nulls(bench.model, bench.observations))]
    assert len(wrong) < 2, wrong


@pytest.mark.parametrize(
    ("effects", "name", "others"),
    [
        ({"hanger_mass": 30.0}, "load_levels", {"moments_closure", "fds_no_dip_torque"}),
        ({"rig_friction": 0.1}, "balance", {"moments_closure", "fds_no_dip_torque"}),
        ({"zero_offset.bone": (0.3, 0.1, -0.3)}, "balance", {"moments_closure", "fds_no_dip_torque"}),
        ({"bowstringing": 0.4}, "load_levels", {"balance", "moments_closure", "fds_no_dip_torque"}),
        ({"sheath_friction": 0.15}, "", set(NAMES)),
    ],
)
def test_its_effects_violate_what_they_should(
    effects: dict[str, Size], name: str, others: set[str], tmp_path: Path
) -> None:
    draw_session(tmp_path, 7, effects, nuisance_scale=1.0)
    bench = Session.open(tmp_path, catalogue=False)
    found = violated(nulls(bench.model, bench.observations))
    assert not name or name in found
    assert not found & others
