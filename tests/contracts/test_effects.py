"""What every effect keeps, of the catalogue and shipped beside it: neutral at its null, smooth, declared, effective."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jax import Array
from numpy.typing import NDArray

from daq.errors import ModelError
from fingermodel.budget import CERTIFICATE, anatomy_parameters, budget_effects
from fingermodel.compiled.programs import UNOPTIMISED
from fingermodel.effects.catalogue import CATALOGUE
from fingermodel.effects.contract import RESERVED, contract_faults
from fingermodel.effects.user import load_effect, shipped_effects
from fingermodel.fingers import FingerValues, Topology
from fingermodel.fingers.files import read_finger
from fingermodel.model import jax_values, predict_parts
from fingermodel.parameters import Parameter
from fingermodel.stages import Effect, Layout, LoadCaseInput
from fingermodel.structure import Structure
from tests.fingermodel.fingers import random_case, six_axes

Floats = NDArray[np.float64]
LAYOUT = Layout((("hook", 0), ("hook", 1)), (("tip", 0), ("bone", 0), ("tip", 1)))
SHIPPED = ("cell_nonlinearity", "edc_subluxation", "force_shunt", "hysteresis", "seating", "tissue_relaxation")
FINGERS = ("an1979_middle", "synek2019_initial")
NAMES = (*(e.name for e in CATALOGUE), *SHIPPED)
seeds = st.integers(0, 2**32 - 1)


@cache
def effects() -> tuple[Effect, ...]:
    return (*CATALOGUE, *(load_effect(Path(name)) for name in SHIPPED))


def effect_of(name: str) -> Effect:
    return next(e for e in effects() if e.name == name)


@dataclass(frozen=True, eq=False)
class Bench:
    """A finger and some effects, with their parameters."""

    structure: Structure
    values: FingerValues
    declared: tuple[Parameter, ...]

    @property
    def null(self) -> Floats:
        return np.array([p.initial for p in self.declared])

    def slice_of(self, name: str) -> range:
        return next(
            range(*s) for e, s in zip(self.structure.effects, self.structure.slices, strict=True) if e.name == name
        )

    def reading(self, p: Array, case: LoadCaseInput) -> Array:
        """What the cell reads, for all effects' parameters in a row. Not compiled, so nothing is reordered."""
        v = self.values
        anatomy = jnp.concatenate([jnp.ravel(a) for a in (v.proximal_point, v.distal_point, v.fraction)])
        parts = (anatomy, *(p[a:b] for a, b in self.structure.slices))
        return predict_parts(self.structure, v, parts, case).reading


def bench_of(chosen: tuple[Effect, ...], topology: Topology, values: FingerValues) -> Bench:
    slices, declared = [], list[Parameter]()
    for effect in chosen:
        own = effect.parameters(topology, LAYOUT)
        slices.append((len(declared), len(declared) + len(own)))
        declared += own
    return Bench(Structure(topology, chosen, tuple(slices)), values, tuple(declared))


@cache
def bench(finger: str, *, bare: bool = False) -> Bench:
    found = read_finger(finger)
    return bench_of(() if bare else effects(), found.topology, jax_values(found.values))


def case_of(posture: Floats, tension: Floats, rng: np.random.Generator, *, is_check: bool = False) -> LoadCaseInput:
    mounting = int(rng.integers(len(LAYOUT.mountings)))
    return LoadCaseInput(
        posture=jnp.asarray(posture),
        tension=jnp.asarray(tension * (not is_check)),
        at_bone=jnp.asarray(LAYOUT.mountings[mounting][0] == "bone"),
        known_force=jnp.asarray(rng.normal(0.0, 2.0, 3)),
        is_check=jnp.asarray(is_check),
        setting=jnp.asarray(int(rng.integers(len(LAYOUT.settings)))),
        mounting=jnp.asarray(mounting),
        weight=jnp.asarray(0.0 if is_check else 0.0083),
        unloading=jnp.asarray(bool(rng.random() < 0.4)),
        since_tare=jnp.asarray(0.0 if is_check else rng.uniform(0.0, 0.2)),
        elapsed=jnp.asarray(0.0 if is_check else rng.uniform(0.0, 1.0)),
    )


def finger_case(finger: str, seed: int) -> LoadCaseInput:
    """One load case; a third extend a hyperextended MCP joint, some leave tendons slack, some are checks."""
    rng, found = np.random.default_rng(seed), read_finger(finger)
    posture, tension = random_case(found, rng)
    if seed % 3 == 0:
        posture[found.topology.rotations.index("MCP")] = -0.35
        tension *= [m == "EDC" for m in found.topology.muscles]
    return case_of(posture, tension * (rng.random(len(tension)) < 0.8), rng, is_check=seed % 7 == 1)


class Slopes(NamedTuple):
    """Every effect off its null at once: (parameters, cases, 6), each parameter in units of its plausible span."""

    exact: Floats
    finite: Floats
    change: Floats


@cache
def slopes(finger: str) -> Slopes:
    tried, rng = bench(finger), np.random.default_rng(12)
    cases = [finger_case(finger, seed) for seed in range(24)]
    batch = jax.tree_util.tree_map(lambda *x: jnp.stack(x), *cases)
    spans = np.array([p.plausible for p in tried.declared], dtype=float)
    span, null = np.ptp(spans, axis=1), tried.null
    # Some way off the null, towards the farther end of the range.
    far = np.where(spans[:, 1] - null >= null - spans[:, 0], spans[:, 1], spans[:, 0])
    p, unit, h = null + rng.uniform(0.1, 0.35, len(null)) * (far - null), np.diag(span), 2e-5

    def readings(p: Array) -> Array:
        return jax.vmap(lambda case: tried.reading(p, case))(batch)

    def both(p: Array, way: Array) -> tuple[Array, Array]:
        return jax.jvp(readings, (p,), (way,))

    rows, ways = jnp.asarray(np.tile(p, (len(p), 1))), jnp.asarray(unit)
    # Run once or twice, so not worth optimising.
    compiled = jax.jit(jax.vmap(both)).lower(rows, ways).compile(UNOPTIMISED)

    def moved(step: float) -> Floats:
        return np.asarray(compiled(rows + step * ways, ways)[0])

    rest, exact = compiled(rows, ways)
    # Of fourth order: near a posture that transmits no force a reading bends within any step.
    finite = (8.0 * (moved(h) - moved(-h)) - (moved(2.0 * h) - moved(-2.0 * h))) / (12.0 * h)
    return Slopes(np.asarray(exact), finite, moved(0.2) - np.asarray(rest))


def test_every_shipped_effect_is_here() -> None:
    assert tuple(shipped_effects()) == SHIPPED
    assert len(set(NAMES)) == len(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_it_keeps_the_contract(name: str) -> None:
    assert contract_faults(effect_of(name), read_finger("an1979_middle").topology, LAYOUT) == []


@pytest.mark.parametrize("name", NAMES)
def test_it_says_what_it_is(name: str) -> None:
    effect = effect_of(name)
    for text in (effect.title, effect.formula, effect.source, effect.tell):
        assert text.strip()
        assert len(text) < 400
        assert "\n" not in text
    for finger in FINGERS:
        topology = read_finger(finger).topology
        declared = effect.parameters(topology, LAYOUT)
        assert declared
        assert all(p.name.startswith(f"{name}.") and p.unit and p.plausible and p.kind == "effect" for p in declared)
        assert effect.variants(topology, LAYOUT)


@pytest.mark.parametrize("finger", FINGERS)
@given(seed=seeds)
@settings(max_examples=8)
def test_at_their_null_values_all_of_them_together_change_no_reading(finger: str, seed: int) -> None:
    case, tried = finger_case(finger, seed), bench(finger)
    with_all = np.asarray(tried.reading(jnp.asarray(tried.null), case))
    assert np.isfinite(with_all).all()
    np.testing.assert_array_equal(with_all, np.asarray(bench(finger, bare=True).reading(jnp.zeros(0), case)))


@pytest.mark.parametrize("finger", FINGERS)
@pytest.mark.parametrize("name", NAMES)
def test_its_derivatives_agree_with_finite_differences(name: str, finger: str) -> None:
    found = slopes(finger)
    for i in bench(finger).slice_of(name):
        scale = max(np.abs(found.exact[i]).max(), 1e-3)
        np.testing.assert_allclose(found.exact[i], found.finite[i], atol=2e-5 * scale, rtol=0)


@pytest.mark.parametrize("finger", FINGERS)
@pytest.mark.parametrize("name", NAMES)
def test_each_of_its_parameters_changes_some_reading(name: str, finger: str) -> None:
    tried, change = bench(finger), slopes(finger).change
    assert [tried.declared[i].name for i in tried.slice_of(name) if np.abs(change[i]).max() < 1e-6] == []


def test_a_finger_of_other_joints_has_fewer_effects_and_none_that_fails() -> None:
    topology, values = six_axes(5)
    with_all = bench_of(CATALOGUE, topology, values)
    lengths = {name: len(with_all.slice_of(name)) for name in (e.name for e in CATALOGUE)}
    assert lengths["hood_shift"] == lengths["volar_plate"] == lengths["fdp_fds_coupling"] == 0
    # One for each tendon, and what a light load has of it.
    assert lengths["worn_pulley"] == 12
    rng = np.random.default_rng(6)
    case = case_of(rng.uniform(-0.5, 1.0, 6), rng.uniform(0.0, 9.0, 6), rng)
    assert jax.eval_shape(with_all.reading, jnp.asarray(with_all.null), case).shape == (6,)


@pytest.mark.parametrize("name", SHIPPED)
def test_a_users_effect_says_what_another_finger_lacks(name: str) -> None:
    topology, _ = six_axes(5)
    of_the_cell = {"force_shunt": 8, "cell_nonlinearity": 1}
    if name in of_the_cell:
        assert len(effect_of(name).parameters(topology, LAYOUT)) == of_the_cell[name]
        return
    with pytest.raises(ModelError, match=r"which this finger does not have; expected one of (J0a|J0\.M0)"):
        effect_of(name).parameters(topology, LAYOUT)


def test_no_effect_takes_the_name_of_another_group_of_parameters() -> None:
    finger = read_finger("an1979_middle")
    groups = {p.name.partition(".")[0] for p in anatomy_parameters(finger, CERTIFICATE)}
    for effect in budget_effects(CERTIFICATE):
        groups |= {effect.name, *(p.name.partition(".")[0] for p in effect.parameters(finger.topology, LAYOUT))}
    assert groups == set(RESERVED)
    assert groups.isdisjoint(NAMES)
