"""Hill muscles: limits of the curves, equilibrium of fibre and tendon, derivatives, and muscle files."""

from __future__ import annotations

import copy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from daq.errors import ModelError
from daq.locations import data_dir
from fingermodel.fingers.files import read_finger
from fingermodel.muscles.hill import (
    CURVES,
    AnyMuscle3E,
    Curves,
    HillState,
    HillValues,
    Thelen2003,
    at_rest,
    isometric,
    slack_length,
)
from fingermodel.muscles.muscle_files import muscle_set_names, read_muscles
from fingermodel.recruitment.moments import arms_and_excursions

Floats = NDArray[np.float64]
ALL = [pytest.param(kind(), id=name) for name, kind in CURVES.items()]
MUSCLE = HillValues(np.array(140.0), np.array(66.0), np.array(0.21), np.array(120.0))
levels = st.floats(0.0, 1.0)
stretches = st.floats(0.55, 1.45)


def _solved(curves: Curves) -> Callable[..., HillState]:
    return jax.jit(lambda muscle, length, level: isometric(curves, muscle, length, level))


def _tension(curves: Curves) -> Callable[[jax.Array], jax.Array]:
    """Tension over greatest force, fibre, pennation, slack length, whole length and activation."""

    def tension(numbers: jax.Array) -> jax.Array:
        force, fibre, pennation, slack, length, activation = numbers
        return isometric(curves, HillValues(force, fibre, pennation, slack), length, activation).tension

    return tension


SOLVED = {kind: _solved(kind()) for kind in CURVES.values()}
TENSION = {kind: (jax.jit(_tension(kind())), jax.jit(jax.grad(_tension(kind())))) for kind in CURVES.values()}


def _length(stretch: float) -> float:
    """Whole length at which the fibre with a slack tendon is so many optimal lengths long."""
    fibre, pennation = float(MUSCLE.fibre), float(MUSCLE.pennation)
    return float(np.sqrt((stretch * fibre) ** 2 - (fibre * np.sin(pennation)) ** 2) + float(MUSCLE.slack))


@pytest.mark.parametrize("curves", ALL)
def test_curves_meet_their_limits(curves: Thelen2003 | AnyMuscle3E) -> None:
    lengths, speeds = jnp.linspace(0.3, 1.8, 301), jnp.linspace(-1.5, 40.0, 4001)
    active, force = np.asarray(curves.active_length(lengths)), np.asarray(curves.velocity(speeds))
    assert_allclose(curves.active_length(jnp.asarray(1.0)), 1.0)
    assert_allclose(lengths[active.argmax()], 1.0, atol=3e-3)
    assert ((active >= 0.0) & (active <= 1.0)).all()
    assert_allclose(curves.velocity(jnp.array([-1.0, -2.0, 0.0])), [0.0, 0.0, 1.0], atol=1e-12)
    assert (np.diff(force) >= -1e-12).all()
    assert_allclose(curves.velocity(jnp.asarray(1e6)), curves.most, rtol=1e-4)
    assert force.max() < curves.most


@pytest.mark.parametrize("curves", ALL)
def test_elastic_elements_rise_from_nothing_to_the_isometric_force(curves: Thelen2003 | AnyMuscle3E) -> None:
    full = curves.passive_length if isinstance(curves, AnyMuscle3E) else 1.0 + curves.passive_strain
    assert_allclose(curves.passive(jnp.array([0.5, 1.0, full])), [0.0, 0.0, 1.0], atol=1e-12)
    # Thelen rounds the line's slope, so its end comes out a third of a percent low.
    assert_allclose(curves.tendon(jnp.array([-0.5, 0.0, curves.tendon_strain])), [0.0, 0.0, 1.0], atol=4e-3)
    for rising in (curves.passive(jnp.linspace(1.0, full, 400)), curves.tendon(jnp.linspace(0.0, 0.08, 400))):
        assert (np.diff(np.asarray(rising)) > 0.0).all()


def test_the_same_strain_at_full_force_can_be_asked_of_either() -> None:
    for kind in CURVES.values():
        assert_allclose(kind(tendon_strain=0.033).tendon(jnp.asarray(0.033)), 1.0, atol=4e-3)


@pytest.mark.parametrize("curves", ALL)
@pytest.mark.parametrize("at", [-0.4, -1e-3, 1e-3, 0.7], ids=lambda s: f"speed {s:g}")
def test_force_and_speed_have_no_corner_away_from_rest(curves: Thelen2003 | AnyMuscle3E, at: float) -> None:
    h = 1e-6
    left = (curves.velocity(jnp.asarray(at)) - curves.velocity(jnp.asarray(at - h))) / h
    right = (curves.velocity(jnp.asarray(at + h)) - curves.velocity(jnp.asarray(at))) / h
    assert_allclose(left, right, rtol=2e-4)


@pytest.mark.parametrize(("curves", "ratio"), [(AnyMuscle3E(), 1.0), (Thelen2003(), 2.0)], ids=["wu2008", "thelen2003"])
def test_slopes_on_both_sides_of_rest(curves: Thelen2003 | AnyMuscle3E, ratio: float) -> None:
    """Hill's hyperbola goes on as it came; Thelen's force rises twice as steeply in lengthening."""
    h = 1e-7
    left = (1.0 - float(curves.velocity(jnp.asarray(-h)))) / h
    right = (float(curves.velocity(jnp.asarray(h))) - 1.0) / h
    assert_allclose([left, right], [5.0, 5.0 * ratio], rtol=1e-4)


@pytest.mark.parametrize("curves", ALL)
@given(stretch=stretches, level=levels)
def test_fibre_and_tendon_pull_alike(curves: Thelen2003 | AnyMuscle3E, stretch: float, level: float) -> None:
    """The equilibrium written out again, from the fibre's length alone."""
    length = _length(stretch)
    found = SOLVED[type(curves)](MUSCLE, length, level)
    fibre = float(found.length) * float(MUSCLE.fibre)
    across = float(MUSCLE.fibre) * np.sin(float(MUSCLE.pennation))
    along = np.sqrt(fibre**2 - across**2)
    of_fibre = level * float(curves.active_length(found.length)) + float(curves.passive(found.length))
    tendon = float(curves.tendon(jnp.asarray((length - along) / float(MUSCLE.slack) - 1.0)))
    force = float(MUSCLE.max_force)
    assert_allclose(force * of_fibre * along / fibre, float(found.tension), atol=1e-9 * force)
    assert_allclose(force * tendon, float(found.tension), atol=1e-8 * force)
    assert_allclose(found.active + found.passive, found.tension, atol=1e-12 * force)


@pytest.mark.parametrize("curves", ALL)
@given(stretch=stretches)
def test_at_rest_only_the_passive_element_pulls(curves: Thelen2003 | AnyMuscle3E, stretch: float) -> None:
    solve = SOLVED[type(curves)]
    found = solve(MUSCLE, _length(stretch), 0.0)
    assert float(found.active) == 0.0
    assert (float(found.tension) > 0.0) == (stretch > 1.0 + 1e-6) or abs(stretch - 1.0) < 1e-3
    busier = [float(solve(MUSCLE, _length(stretch), a).tension) for a in (0.0, 0.3, 1.0)]
    assert busier == sorted(busier)


@pytest.mark.parametrize("curves", ALL)
def test_a_slack_muscle_does_not_pull(curves: Thelen2003 | AnyMuscle3E) -> None:
    found = SOLVED[type(curves)](MUSCLE, float(MUSCLE.slack) - 1.0, 1.0)
    assert_allclose(found.tension, 0.0)
    assert np.isfinite(np.asarray(found.length))


@pytest.mark.parametrize("curves", ALL)
@pytest.mark.parametrize(("stretch", "level"), [(0.8, 0.6), (1.1, 0.2), (1.2, 0.0), (1.3, 1.0)])
def test_the_equilibriums_derivatives_are_those_of_differences(
    curves: Thelen2003 | AnyMuscle3E, stretch: float, level: float
) -> None:
    tension, slope = TENSION[type(curves)]
    at = jnp.array([140.0, 66.0, 0.21, 120.0, _length(stretch), level])
    slopes = np.asarray(slope(at))
    steps = 1e-6 * np.array([140.0, 66.0, 0.21, 120.0, 180.0, 1.0])
    for i, h in enumerate(steps):
        move = np.zeros(6)
        move[i] = h
        difference = (float(tension(at + move)) - float(tension(at - move))) / (2.0 * h)
        assert_allclose(slopes[i], difference, rtol=2e-4, atol=1e-6)


@pytest.mark.parametrize("curves", ALL)
def test_calibrated_the_fibre_is_optimal_at_full_force(curves: Thelen2003 | AnyMuscle3E) -> None:
    along = float(MUSCLE.fibre) * np.cos(float(MUSCLE.pennation))
    slack = slack_length(curves, np.array(along), np.array(190.0))
    found = SOLVED[type(curves)](MUSCLE._replace(slack=slack), 190.0, 1.0)
    assert_allclose(found.length, 1.0, atol=1e-3)
    assert_allclose(found.tension, float(MUSCLE.max_force) * np.cos(float(MUSCLE.pennation)), rtol=5e-3)


def test_half_the_parallel_elements_are_half_the_force() -> None:
    curves = AnyMuscle3E(tendon_strain=1e-6)
    whole = isometric(curves, MUSCLE, jnp.asarray(_length(1.3)), jnp.asarray(0.0)).tension
    half = isometric(curves, MUSCLE._replace(passive_share=0.5), jnp.asarray(_length(1.3)), jnp.asarray(0.0)).tension
    assert_allclose(half, 0.5 * whole, rtol=1e-3)


def test_capacity_falls_with_shortening_and_rises_with_lengthening() -> None:
    rates = np.array([[-300.0], [-50.0], [0.0], [50.0]])
    length = np.full((4, 1), _length(0.98))
    one = HillValues(*(np.atleast_1d(v) for v in MUSCLE))
    passive, capacity = at_rest(AnyMuscle3E(), one, np.array([230.0]), length, rates)
    assert_allclose(passive, 0.0)
    found = np.asarray(capacity)[:, 0]
    assert found[0] == 0.0
    assert (np.diff(found) > 0.0).all()


@pytest.mark.parametrize("name", [n for n in muscle_set_names() if n.startswith("wu2008")])
def test_shipped_muscles_fit_their_finger(name: str) -> None:
    finger = read_finger("wu2008_index")
    muscles = read_muscles(name, finger)
    slack = np.asarray(muscles.values.slack)
    assert (slack > 0.0).all()
    assert_allclose(np.asarray(muscles.values.max_force)[:2], 30.0 * 4.79)
    # In the posture of the calibration every fibre is stretched by the tendon's strain at full force.
    _, none = arms_and_excursions(finger.topology, finger.values, muscles.calibration, muscles.calibration[None])
    assert_allclose(none, 0.0, atol=1e-12)
    stretch = muscles.length_mm - slack - np.asarray(muscles.values.fibre) * np.cos(muscles.values.pennation)
    assert_allclose(stretch, 0.05 * slack, rtol=1e-9)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda d: d["muscles"].pop(0), "has no FDP; expected the muscles of wu2008_index"),
        (lambda d: d["muscles"][0].update(path=["DIP.FDP.distal", "DIP.FDP.middle"]), "no point 'DIP.FDP.middle'"),
        (lambda d: d["muscles"][0].update(fibre_mm=90.0), "the path of FDP is shorter than its fibres"),
        (lambda d: d["muscles"][0].update(pcsa_cm2=0.0), "pcsa_cm2: must be greater than 0"),
        (lambda d: d["muscles"][0].update(slack_mm=9.0), "both path and slack_mm"),
        (lambda d: d["curves"].update(kind="hill"), "curves.kind"),
        (lambda d: d["curves"].update(kind="thelen2003"), "thelen2003 have no passive_length_factor, tendon_shape"),
        (lambda d: d["calibration"]["posture_deg"].pop("PIP"), "calibration of abduction, MCP, DIP"),
        (lambda d: d["fast_fraction"].update(source="nobody"), "source 'nobody' is not listed"),
    ],
    ids=["missing muscle", "point", "no room", "no area", "both", "curves", "other curves", "posture", "source"],
)
def test_a_bad_muscle_file_is_named(tmp_path: Path, change: Callable[[dict[str, Any]], Any], said: str) -> None:
    text = (data_dir() / "muscles" / "wu2008.yaml").read_text(encoding="utf-8")
    document = copy.deepcopy(yaml.safe_load(text))
    change(document)
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
    with pytest.raises(ModelError) as caught:
        read_muscles(path, read_finger("wu2008_index"))
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_unknown_muscles_name_those_there_are() -> None:
    with pytest.raises(ModelError, match=r"no muscles 'x'; expected a file, or one of .*wu2008, wu2008_ammr"):
        read_muscles("x", read_finger("wu2008_index"))
