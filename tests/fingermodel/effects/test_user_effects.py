"""What an effect with formulas does to a finger, and what it has for parameters."""

from __future__ import annotations

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from daq.errors import ModelError
from fingermodel.effects.contract_cases import states_before
from fingermodel.effects.formula_effect import FormulaEffect
from fingermodel.effects.user import load_effect, require_contract
from fingermodel.fingers import Topology
from fingermodel.fingers.files import read_finger
from fingermodel.stages import Layout, LoadCaseInput, State
from fingermodel.structure import ANY_LAYOUT
from tests.fingermodel.effect_documents import SHARE, made, one_line, with_unit


@pytest.fixture(scope="module")
def topology() -> Topology:
    return read_finger("an1979_middle").topology


def acted(effect: FormulaEffect, p: list[float], topology: Topology, number: int) -> tuple[State, State, LoadCaseInput]:
    """State before and after an effect, in one of the made-up load cases."""
    case, before = states_before(effect.stage, topology, ANY_LAYOUT)[number]
    after: State = getattr(effect, effect.stage)(jnp.asarray(p), case, before)
    return before, after, case


def test_each_target_changes_its_own_place_alone(topology: Topology) -> None:
    at = {name: i for i, name in enumerate(topology.muscles)}
    before, after, _ = acted(with_unit("1/N", "tension[FDP] *= 1 + k * t_FDS"), [0.1], topology, 4)
    expected = np.array(before.tension)
    expected[at["FDP"]] *= 1 + 0.1 * expected[at["FDS"]]
    np.testing.assert_allclose(after.tension, expected)

    before, after, _ = acted(with_unit("deg", "posture[PIP] += k"), [3.0], topology, 4)
    np.testing.assert_allclose(
        np.rad2deg(np.asarray(after.posture - before.posture)),
        [3.0 * (r == "PIP") for r in topology.rotations],
        atol=1e-12,
    )

    before, after, _ = acted(with_unit("mm", "point[PIP.FDP].y += k"), [2.0], topology, 4)
    for end in ("proximal_point", "distal_point"):
        moved = np.asarray(getattr(after.values, end)) - np.asarray(getattr(before.values, end))
        rows = [[0.0, 2.0 * (s.name == "PIP.FDP"), 0.0] for s in topology.segments]
        np.testing.assert_allclose(moved, rows, atol=1e-12)

    before, after, _ = acted(with_unit("N", "segment_tension[PIP.FDP] += k"), [1.0], topology, 4)
    assert before.segment_tension is not None
    assert after.segment_tension is not None
    gained = np.asarray(after.segment_tension - before.segment_tension)
    np.testing.assert_allclose(gained, [float(s.name == "PIP.FDP") for s in topology.segments], atol=1e-12)

    before, after, _ = acted(made("torque[PIP] += k * t_EDC * sin(q_PIP)"), [2.0], topology, 4)
    assert before.torque is not None
    assert after.torque is not None
    pip = topology.rotations.index("PIP")
    added = 2.0 * before.tension[at["EDC"]] * np.sin(before.posture[pip])
    np.testing.assert_allclose(np.asarray(after.torque - before.torque)[pip], added)


def test_a_changed_fraction_shares_anew_and_leaves_what_was_done_before(topology: Topology) -> None:
    effect = with_unit("1", "fraction[EDC_ES] += k", 0.0)
    case, before = states_before("sharing", topology, ANY_LAYOUT)[4]
    assert before.segment_tension is not None
    worn = before._replace(segment_tension=before.segment_tension * 0.5)
    plain, other = (effect.sharing(jnp.asarray([0.2]), case, s) for s in (before, worn))
    assert plain.segment_tension is not None
    assert other.segment_tension is not None
    gained = np.asarray(plain.segment_tension - before.segment_tension)
    edc = 0.2 * float(before.tension[topology.muscles.index("EDC")])
    share = {"PIP.ES": edc, "PIP.RB": -0.5 * edc, "PIP.UB": -0.5 * edc, "DIP.TE": -edc}
    np.testing.assert_allclose(gained, [share.get(s.name, 0.0) for s in topology.segments], atol=1e-12)
    np.testing.assert_allclose(np.asarray(other.segment_tension - before.segment_tension * 0.5), gained, atol=1e-12)
    assert float(plain.values.fraction[topology.fractions.index("EDC_ES")]) == pytest.approx(
        float(before.values.fraction[topology.fractions.index("EDC_ES")]) + 0.2
    )


def test_a_place_of_the_cell_is_kept_to(topology: Topology) -> None:
    effect = with_unit("N", "force.bone[y] += k * (1 - is_check)")
    seen = set()
    for number in range(8):
        before, after, case = acted(effect, [1.0], topology, number)
        assert before.wrench is not None
        assert after.wrench is not None
        expected = 1.0 if bool(case.at_bone) and not bool(case.is_check) else 0.0
        np.testing.assert_allclose(np.asarray(after.wrench - before.wrench), [0, expected, 0, 0, 0, 0], atol=1e-12)
        seen.add(expected)
    assert seen == {0.0, 1.0}


def test_formulas_read_the_state_before_all_of_them(topology: Topology) -> None:
    both = ["tension[FDP] += k * t_FDS", "tension[FDS] += k * t_FDP"]
    before, after, _ = acted(made(both, parameters={"k": SHARE}), [1.0], topology, 4)
    at = topology.muscles.index
    total = float(before.tension[at("FDP")] + before.tension[at("FDS")])
    assert float(after.tension[at("FDP")]) == pytest.approx(total)
    assert float(after.tension[at("FDS")]) == pytest.approx(total)


def test_ranges_become_priors(topology: Topology) -> None:
    parameters = {
        "a": {"unit": "%", "range": [0, 20]},
        "b": {"unit": "1", "range": [-4, 4]},
        "c": {"unit": "deg", "range": [10, 50], "null": 30, "bounds": [0, 90], "what": "onset"},
    }
    effect = made("torque[PIP] *= 1 + a + b * tanh(q_PIP - c)", parameters=parameters)
    a, b, c = effect.parameters(topology, ANY_LAYOUT)
    assert (a.name, a.unit, a.sd, a.lower, a.upper, a.one_sided) == ("mine.a", "%", 10.0, 0.0, 40.0, True)
    assert (b.sd, b.lower, b.upper, b.plausible, b.one_sided) == (2.0, -8.0, 8.0, (-4.0, 4.0), False)
    assert (c.initial, c.sd, c.lower, c.upper) == (30.0, 10.0, 0.0, 90.0)


def test_what_cannot_act_in_a_session_stays_fixed(topology: Topology) -> None:
    shunt = load_effect(Path("force_shunt"))
    at_tip = Layout(ANY_LAYOUT.settings, (("tip", 0),))
    expected = {f"force_shunt.{mount}": mount == "tip" for mount in ("tip", "bone")}
    expected |= {f"force_shunt.{mount}_{axis}": mount == "tip" for mount in ("tip", "bone") for axis in "xyz"}
    assert {p.name: p.sd > 0 for p in shunt.parameters(topology, at_tip)} == expected
    directed = tuple(f"force_shunt.tip_{axis}" for axis in "xyz")
    assert shunt.variants(topology, at_tip) == {"force_shunt": (("force_shunt.tip",), directed)}
    bone_only = made("force.bone[x] *= 1 - k", parameters={"k": SHARE})
    assert bone_only.parameters(topology, at_tip) == ()
    assert bone_only.variants(topology, at_tip) == {}


def test_joints_and_muscles_that_the_finger_lacks_are_named(topology: Topology) -> None:
    for line, said in (
        ("torque[pip] += k * t_EDC", "Did you mean PIP?"),
        ("torque[PIP] += k * t_EDD", "t_EDD names 'EDD'"),
        ("torque[PIP] += k * t_EDC * q_thumb", "one of MCP, abduction, PIP, DIP"),
        ("torque[PIP] += k * t_EDC * tanh(q_XIP)", "q_XIP names 'XIP'"),
    ):
        effect = made(line)
        with pytest.raises(ModelError) as found:
            effect.parameters(topology, ANY_LAYOUT)
        assert said in one_line(found)


def test_an_effect_is_tried_on_a_finger_by_few_programs() -> None:
    compiled: list[str] = []

    def listener(event: str, duration_secs: float, **_: str | int) -> None:
        compiled.append(f"{event} took {duration_secs} s")

    jax.monitoring.register_event_duration_secs_listener(listener)
    try:
        require_contract(made("torque[PIP] += k * t_FDS"), read_finger("synek2019_bonobo").topology, ANY_LAYOUT)
    finally:
        jax.monitoring.unregister_event_duration_listener(listener)
    # One for the states before it, two for the effect, and some operations outside them; by operations, over a hundred.
    assert 0 < sum("backend_compile_duration" in event for event in compiled) < 40
