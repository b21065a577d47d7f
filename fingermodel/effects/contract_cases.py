"""Random load cases of a made-up finger, to try an effect on any finger's topology without its numbers."""

from __future__ import annotations

from functools import lru_cache, partial
from typing import Any, final

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from fingermodel.compiled.programs import UNOPTIMISED
from fingermodel.fingers import FingerValues, Topology
from fingermodel.model import predict_parts
from fingermodel.stages import STAGES, Effect, Layout, LoadCaseInput, Stage, State
from fingermodel.structure import Structure


@final
class _Observer(Effect):
    """Keeps the state that reaches each stage."""

    name = "observer"

    def __init__(self) -> None:
        self.seen: dict[Stage, State] = {}
        for stage in STAGES:
            setattr(self, stage, partial(self._keep, stage))

    def _keep(self, stage: Stage, p: Array, case: LoadCaseInput, state: State) -> State:
        self.seen[stage] = state
        return state


def states_before(stage: Stage, topology: Topology, layout: Layout) -> list[tuple[LoadCaseInput, State]]:
    """Return random load cases of a made-up finger, each with the state that reaches a stage."""
    return [(case, states[stage]) for case, states in _observed(topology, layout)]


@lru_cache(maxsize=8)
def _observed(topology: Topology, layout: Layout) -> tuple[tuple[LoadCaseInput, dict[Stage, State]], ...]:
    rng = np.random.default_rng(2)
    values = _values(topology, rng)
    points = [np.ravel(a) for a in (values.proximal_point, values.distal_point, values.fraction)]
    anatomy = jnp.asarray(np.concatenate(points))
    traced: list[Any] = []

    def numbers(values: FingerValues, anatomy: Array, case: LoadCaseInput) -> list[Array | None]:
        """Those of the states; what else they hold is the same for every load case."""
        observer = _Observer()
        predict_parts(Structure(topology, (observer,), ((0, 0),)), values, (anatomy, jnp.zeros(0)), case)
        leaves, tree = jax.tree.flatten(observer.seen)
        traced[:] = leaves, tree
        return [leaf if isinstance(leaf, Array) else None for leaf in leaves]

    # Operation by operation, each would be compiled by itself: over a hundred, most of the time of a check. The numbers
    # of the finger are arguments: constants would be rounded otherwise than in an effect that computes the same anew.
    program, out = jax.jit(numbers, compiler_options=UNOPTIMISED), []
    for i in range(2 * max(len(topology.muscles), len(layout.mountings), 4)):
        case = _case(i, topology, layout, rng)
        found = program(values, anatomy, case)
        leaves, tree = traced
        filled = [leaf if number is None else number for leaf, number in zip(leaves, found, strict=True)]
        out.append((case, jax.tree.unflatten(tree, filled)))
    return tuple(out)


def _values(topology: Topology, rng: np.random.Generator) -> FingerValues:
    """Numbers of no finger in particular, of the size that fingers have [mm]."""
    joints, segments = len(topology.joints), len(topology.segments)
    flexes = [i == j.flexion for j in topology.joints for i in range(len(j.rotations))]
    axis = np.array([[0.0, 0.0, 1.0] if f else [0.0, 1.0, 0.0] for f in flexes]) + rng.normal(
        0.0, 0.2, (len(flexes), 3)
    )
    centre = rng.normal([-30.0, 0.0, 0.0], 2.0, (joints, 3))
    centre[0] = 0.0
    at = [next(i for i, j in enumerate(topology.joints) if j.name == s.joint) for s in topology.segments]
    suture = rng.normal([1.0, 0.0, 0.0], 0.1, (len(topology.muscles), 3))
    return FingerValues(
        centre=jnp.asarray(centre),
        axis=jnp.asarray(axis / np.linalg.norm(axis, axis=1, keepdims=True)),
        proximal_point=jnp.asarray(centre[at] + rng.normal([8.0, 0.0, 0.0], 5.0, (segments, 3))),
        distal_point=jnp.asarray(rng.normal([-8.0, 0.0, 0.0], 5.0, (segments, 3))),
        fraction=jnp.asarray(rng.uniform(0.2, 0.8, len(topology.fractions))),
        load_point=jnp.asarray([-11.0, -2.0, 1.0]),
        suture=jnp.asarray(suture / np.linalg.norm(suture, axis=1, keepdims=True)),
    )


def _case(i: int, topology: Topology, layout: Layout, rng: np.random.Generator) -> LoadCaseInput:
    """Return one load case.

    The first has straight joints and slack tendons; odd ones load one tendon, joints extended; the third is a check.
    """
    is_check = i == 2
    angles, muscles = len(topology.rotations), len(topology.muscles)
    posture, tension = rng.uniform(-0.5, 1.6, angles), rng.uniform(0.5, 9.0, muscles)
    if i % 2:
        posture, tension = -0.4 * np.abs(posture), tension * (np.arange(muscles) == i // 2 % muscles)
    if i == 0:
        posture, tension = posture * (np.arange(angles) > 0), tension * (np.arange(muscles) % 2)
    # Both kinds of cases at every mounting.
    mounting = i // 2 % max(len(layout.mountings), 1)
    at_bone = bool(layout.mountings) and layout.mountings[mounting][0] == "bone"
    return LoadCaseInput(
        posture=jnp.asarray(posture),
        tension=jnp.asarray(tension * (not is_check)),
        at_bone=jnp.asarray(at_bone),
        known_force=jnp.asarray(rng.normal(0.0, 2.0, 3)),
        is_check=jnp.asarray(is_check),
        setting=jnp.asarray(i % max(len(layout.settings), 1)),
        mounting=jnp.asarray(mounting),
        weight=jnp.asarray(0.0 if is_check else 0.0083),
        unloading=jnp.asarray(i % 4 > 1),
        since_tare=jnp.asarray(0.0 if is_check else rng.uniform(0.0, 0.2)),
        elapsed=jnp.asarray(0.0 if is_check else rng.uniform(0.0, 1.0)),
    )
