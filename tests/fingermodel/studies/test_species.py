"""Two fingers side by side: measured ratios, and steps that lead from one to the other."""

from __future__ import annotations

import numpy as np
import pytest

from fingermodel.studies.species import SpeciesResult, compare_species

HUMAN, BONOBO = "synek2019_optimised", "synek2019_bonobo"


@pytest.fixture(scope="module")
def result() -> SpeciesResult:
    return compare_species()


def test_the_measured_difference_is_smaller_than_the_models(result: SpeciesResult) -> None:
    for key, modelled, measured in (("tension_to_tip", 1.39, 1.24), ("bone_to_tip", 1.54, 1.31)):
        both = [[side.spread("FDP+FDS", key, measured=m) for side in (result.of, result.other)] for m in (False, True)]
        ratios = [b.mean / a.mean for a, b in both if a and b]
        assert ratios == pytest.approx([modelled, measured], abs=0.01)


def test_measured_forces_are_the_sessions_own(result: SpeciesResult) -> None:
    """One case by hand: 300 g on FDP and FDS, minor flexion, from the published table of forces."""
    load = next(
        x for x in result.other.of_tendons("FDP+FDS") if x.posture == "minor_flexion" and x.masses_g["FDP"] == 300
    )
    tension = 0.6 * 9.81 * 0.835
    tip, bone = np.array([-0.421095, -0.696051, 0.496525]), np.array([4.327486, -0.101368, -0.454987])
    found = load.ratios(measured=True)
    assert load.tension_N == pytest.approx(tension)
    assert found["tension_to_tip"] == pytest.approx(tension / np.linalg.norm(tip), rel=1e-5)
    assert found["bone_to_tip"] == pytest.approx(np.linalg.norm(bone) / np.linalg.norm(tip), rel=1e-5)
    assert found["bone_per_tension"] == pytest.approx(np.linalg.norm(bone) / tension, rel=1e-5)
    assert load.ratios(measured=True, plane="sagittal")["tip_per_tension"] == pytest.approx(
        np.hypot(*tip[:2]) / tension, rel=1e-5
    )


def test_the_steps_lead_from_one_to_the_other_and_size_alone_changes_nothing(result: SpeciesResult) -> None:
    steps = result.steps
    assert steps[1].tension_to_tip == pytest.approx(steps[0].tension_to_tip, rel=1e-9)
    assert steps[1].bone_to_tip == pytest.approx(steps[0].bone_to_tip, rel=1e-9)
    for at, side in ((0, result.of), (-1, result.other)):
        spread = side.spread("FDP+FDS", "tension_to_tip")
        assert spread is not None
        assert steps[at].tension_to_tip == pytest.approx(spread.mean, rel=1e-6)
    by_length = steps[3].tension_to_tip - steps[2].tension_to_tip
    by_arms = steps[4].tension_to_tip - steps[3].tension_to_tip
    assert by_length > 2.0 * by_arms > 0.0


def test_a_finger_against_itself_is_equal() -> None:
    twin = compare_species(BONOBO, BONOBO)
    assert [s.tension_to_tip for s in twin.steps] == pytest.approx([twin.steps[0].tension_to_tip] * 6, rel=1e-9)
    body = twin.as_dict()
    assert all(b["ratio"] == pytest.approx(1.0) for b in (*body["bones"], *body["moment_arms"]))


@pytest.mark.full
def test_sessions_of_a_bench_compare() -> None:
    """Raw readings, several repeats a load, and a finger of the same species."""
    done = compare_species(of_session="DEV-01", other_session="synek2019_H01")
    keys = [(x.posture, tuple(sorted(x.masses_g.items()))) for x in done.of.loads]
    assert len(keys) == len(set(keys))
    assert done.main in done.tendons
    assert done.names == (done.of.name, done.other.name)
