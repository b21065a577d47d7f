"""Equilibrium of a hood of springs: forces balance, the energy is least, and slopes are those of finite differences."""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from fingermodel.hood.elastic import shape_of
from fingermodel.hood.equilibrium import equilibria, settle
from fingermodel.hood.network import Shape, displacements, energy
from fingermodel.hood.sharing import bone_lengths, hood_state, slip_excursions
from fingermodel.kinematics import joint_poses
from fingermodel.model import jax_values, posture_moment_arms
from tests.fingermodel.elastic_hoods import CASES, FINGER, HOOD, NETWORK, Floats, seeds

MIRROR = {"F": "L", "G": "M", "H": "N", "L": "F", "M": "G", "N": "H"}


def draw(seed: int) -> tuple[Shape, Floats]:
    """Shapes and pulls of `CASES` networks: other stiffness, slack that the posture leaves, and muscles that rest."""
    rng = np.random.default_rng(seed)
    fraction = np.array([1.0, 1.0, *rng.uniform(0.2, 0.8, 2), rng.uniform(0.99, 1.0)])
    crosses = np.array([bool(s) for s in HOOD.slips])
    length = jnp.asarray(bone_lengths(FINGER.topology, jax_values(FINGER.values)))
    one = shape_of(HOOD, length, jnp.asarray(crosses * rng.uniform(0.0, 5.0)), jnp.asarray(fraction))
    shape = Shape(*(jnp.broadcast_to(x, (CASES, *x.shape)) for x in one))
    tension = rng.uniform(0.0, 100.0, (CASES, 4)) * (rng.random((CASES, 4)) < 0.7)
    pulls = np.zeros((CASES, len(NETWORK.nodes), 2))
    for column, (_, node, along, around) in zip(tension.T, HOOD.pulls, strict=True):
        pulls[:, node] += column[:, None] * np.array([along, around])
    return shape, pulls


def first(shape: Shape) -> Shape:
    return Shape(*(x[0] for x in shape))


@given(seed=seeds)
@settings(max_examples=20)
def test_every_free_node_is_in_equilibrium(seed: int) -> None:
    """Summed up node by node from the tensions, without the code that settles them."""
    shape, pulls = draw(seed)
    found = equilibria(NETWORK, shape, jnp.asarray(pulls))
    ways = np.asarray(found.ways)
    for case in range(CASES):
        force = pulls[case].copy()
        for i, (distal, proximal) in enumerate(NETWORK.ends):
            moved = np.zeros((len(NETWORK.nodes), 2))
            for way, node in enumerate(NETWORK.moves):
                moved[node] += np.asarray(shape.slide)[case, way] * ways[case, way]
            line = np.asarray(shape.span)[case, i] + moved[proximal] - moved[distal]
            pull = np.asarray(found.springs.tension)[case, i] * line / np.linalg.norm(line)
            force[distal] += pull
            force[proximal] -= pull
        for way, node in enumerate(NETWORK.moves):
            left = force[node] @ np.asarray(shape.slide)[case, way] - float(shape.tether[case]) * ways[case, way]
            assert abs(left) < 1e-8


@given(seed=seeds)
@settings(max_examples=10)
def test_no_displacement_lowers_the_energy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shape, pulls = draw(seed)
    found = equilibria(NETWORK, shape, jnp.asarray(pulls))
    off = rng.normal(size=found.ways.shape) * 10.0 ** rng.uniform(-4, 0.5, (CASES, 1))
    least, other = (_energies(shape, jnp.asarray(pulls), found.ways + d) for d in (0.0, off))
    assert np.all(np.asarray(other) > np.asarray(least))


@given(seed=seeds)
@settings(max_examples=10)
def test_a_slack_spring_carries_exactly_nothing_and_a_taut_one_its_stiffness(seed: int) -> None:
    shape, pulls = draw(seed)
    springs = equilibria(NETWORK, shape, jnp.asarray(pulls)).springs
    tension, elongation = np.asarray(springs.tension), np.asarray(springs.elongation)
    slack = elongation <= 0.0
    assert slack.any()
    assert (tension[slack] == 0.0).all()
    assert_allclose(tension[~slack], (np.asarray(shape.stiffness) * elongation)[~slack], rtol=1e-14)


@given(seed=seeds, scale=st.floats(0.1, 10.0))
@settings(max_examples=10)
def test_stiffness_and_pulls_that_grow_alike_leave_the_geometry(seed: int, scale: float) -> None:
    shape, pulls = draw(seed)
    more = shape._replace(stiffness=shape.stiffness * scale, tether=shape.tether * scale)
    once = equilibria(NETWORK, shape, jnp.asarray(pulls))
    scaled = equilibria(NETWORK, more, jnp.asarray(pulls * scale))
    assert_allclose(np.asarray(scaled.ways), np.asarray(once.ways), atol=1e-8)
    assert_allclose(np.asarray(scaled.springs.tension), scale * np.asarray(once.springs.tension), atol=1e-6)


@pytest.mark.full
def test_pulls_store_the_work_that_they_do() -> None:
    """Along a path of growing pulls, which begins where no spring is taut and passes springs that tighten."""
    shape, pulls = draw(4)
    one, full, steps = first(shape), pulls[0] + pulls[1], 2048
    path = np.linspace(0.0, 1.0, steps + 1)[:, None, None] * full * np.linspace(0.3, 1.0, steps + 1)[:, None, None]
    many = Shape(*(jnp.broadcast_to(x, (steps + 1, *x.shape)) for x in one))
    found = equilibria(NETWORK, many, jnp.asarray(path))
    moved = np.asarray(jax.vmap(partial(displacements, NETWORK))(many, found.ways))
    work = np.sum(0.5 * (path[1:] + path[:-1]) * (moved[1:] - moved[:-1]))
    stored = np.asarray(_energies(many, jnp.zeros_like(jnp.asarray(path)), found.ways))
    assert stored[-1] > 1.0
    assert_allclose(work, stored[-1] - stored[0], rtol=1e-6)


def test_radial_and_ulnar_exchanged_give_the_mirrored_forces() -> None:
    shape, pulls = draw(7)
    names = [MIRROR.get(n, n) for n in NETWORK.nodes]
    node = [NETWORK.nodes.index(n) for n in names]
    ends = [{NETWORK.nodes[i] for i in e} for e in NETWORK.ends]
    spring = [ends.index({MIRROR.get(n, n) for n in e}) for e in ends]
    swapped = shape._replace(stiffness=shape.stiffness[:, np.array(spring)])
    mirrored = pulls[:, node] * np.array([1.0, -1.0])
    once = equilibria(NETWORK, shape, jnp.asarray(pulls)).springs.tension
    other = equilibria(NETWORK, swapped, jnp.asarray(mirrored)).springs.tension
    assert_allclose(np.asarray(other), np.asarray(once)[:, spring], atol=1e-7)
    assert not np.allclose(np.asarray(once), np.asarray(once)[:, spring], atol=1.0)


def test_scipy_finds_no_lower_energy() -> None:
    from scipy.optimize import minimize

    shape, pulls = draw(11)
    found = equilibria(NETWORK, shape, jnp.asarray(pulls))
    value = jax.jit(jax.value_and_grad(partial(energy, NETWORK), argnums=2))
    for case in range(3):
        one, pull = Shape(*(x[case] for x in shape)), jnp.asarray(pulls[case])
        start = np.zeros(len(NETWORK.moves))

        def total(w: Floats, shape: Shape = one, pull: jax.Array = pull) -> tuple[float, Floats]:
            stored, slope = value(shape, pull, jnp.asarray(w))
            return float(stored), np.asarray(slope)

        theirs = minimize(total, start, args=(), method="BFGS", jac=True)
        ours = float(value(one, pull, found.ways[case])[0])
        assert ours <= theirs.fun + 1e-9
        assert ours == pytest.approx(theirs.fun, abs=1e-4)


@pytest.mark.full
@given(seed=seeds)
@settings(max_examples=8)
def test_slopes_of_the_equilibrium_are_those_of_finite_differences(seed: int) -> None:
    shape, pulls = draw(seed)
    rng = np.random.default_rng(seed)
    one, pull = first(shape), jnp.asarray(pulls[0] + 10.0 * np.abs(pulls[1]))
    change = Shape(
        *(jnp.asarray(rng.normal(size=x.shape)) * w for x, w in zip(one, (1e-2, 1e-3, 10, 1e-2, 0), strict=True))
    )
    more = jnp.asarray(rng.normal(size=pull.shape))
    _, slope = _slopes((one, pull), (change, more))
    step = 1e-6
    ends = [
        _settled(Shape(*(x + k * dx for x, dx in zip(one, change, strict=True))), pull + k * more)
        for k in (-step, step)
    ]
    numeric = (np.asarray(ends[1]) - np.asarray(ends[0])) / (2 * step)
    assert_allclose(np.asarray(slope), numeric, atol=1e-5 * (1.0 + np.abs(numeric).max()))


@pytest.mark.full
def test_excursion_falls_by_the_moment_arm_where_tendons_wrap_and_where_they_run_straight() -> None:
    topology, values = FINGER.topology, jax_values(FINGER.values)
    slips = ("ES", "RB", "UB", "TE")

    @jax.jit
    def excursions(q: jax.Array) -> jax.Array:
        return slip_excursions(topology, values, joint_poses(topology, values, q), slips)

    slope = jax.jit(jax.jacobian(excursions))
    names = [s.name for s in topology.segments]
    columns = [names.index(n) for n in ("PIP.ES", "PIP.RB", "PIP.UB", "DIP.TE")]
    assert_allclose(np.asarray(excursions(jnp.zeros(4))), 0.0, atol=1e-12)
    for posture in ([0.1, 0.4, 0.9, 0.5], [0.0, -0.2, -0.2, -0.1]):
        q = jnp.asarray(posture)
        arms = np.asarray(posture_moment_arms(topology, values, q))[:, columns]
        assert_allclose(np.asarray(slope(q)), -arms.T, atol=1e-10)


def test_torque_of_the_slips_is_minus_the_slope_of_the_least_energy() -> None:
    """With rest lengths that do not follow the posture the hood is a conservative system under dead loads."""
    topology = FINGER.topology
    values = jax_values(FINGER.values)._replace(fraction=jnp.asarray([1.0, 1.0, 0.5, 0.5, 0.0]))
    muscle = dict(zip(topology.muscles, jnp.asarray([3.0, 2.0, 5.0, 0.0, 0.0, 20.0]), strict=True))

    @jax.jit
    @partial(jax.value_and_grad, has_aux=True)
    def stored(q: jax.Array) -> tuple[jax.Array, dict[str, jax.Array]]:
        state = hood_state(topology, values, muscle, joint_poses(topology, values, q))
        ways = settle(NETWORK, state.shape, state.pulls)
        return energy(NETWORK, state.shape, state.pulls, ways), state.slips

    q = jnp.asarray([0.0, 0.3, 0.02, 0.03])
    (_, slips), slope = stored(q)
    pulled = np.array([float(slips.get(s.slip, 0.0)) for s in topology.segments])
    torque = np.asarray(posture_moment_arms(topology, values, q)) @ pulled
    assert np.abs(torque).max() > 10.0
    assert_allclose(torque, -np.asarray(slope), atol=1e-6)


@partial(jax.jit)
def _energies(shape: Shape, pulls: jax.Array, ways: jax.Array) -> jax.Array:
    return jax.vmap(partial(energy, NETWORK))(shape, pulls, ways)


@jax.jit
def _settled(shape: Shape, pulls: jax.Array) -> jax.Array:
    return settle(NETWORK, shape, pulls)


@jax.jit
def _slopes(primals: tuple[Shape, jax.Array], tangents: tuple[Shape, jax.Array]) -> tuple[jax.Array, jax.Array]:
    return jax.jvp(partial(settle, NETWORK), primals, tangents)
