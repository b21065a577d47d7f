"""The model: a finger, its effects and their parameters; one load case in, forces and a reading out.

`predict_case` is written for one load case. `jax.vmap` batches it, `jax.jacobian` differentiates it with respect to
everything. All effects live in it at their null values, so choosing effects is choosing which parameters are free.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import NamedTuple, TypeVar, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import ArrayLike, NDArray

from fingermodel.budget import CERTIFICATE, Budget, anatomy_parameters, budget_effects
from fingermodel.compiled.programs import stored
from fingermodel.extensor import segment_tensions
from fingermodel.fingers import Finger, FingerValues, Topology
from fingermodel.hood.parts import ElasticHood
from fingermodel.kinematics import TipKinematics, joint_poses, poses_of_turns, tip_kinematics
from fingermodel.many_cases import many_cases, suits
from fingermodel.parameters import ParameterTable
from fingermodel.stages import Effect, Layout, LoadCaseInput, Stage, State
from fingermodel.statics import ClampForces, clamp_forces, joint_loads, joint_torques
from fingermodel.tendons import joint_pulls, moment_arms

jax.config.update("jax_enable_x64", True)

Found = TypeVar("Found", bound=NamedTuple)


# For predictions without a session: one setting, the cell at either end.
ANY_LAYOUT = Layout((("posture", 0),), (("tip", 0), ("bone", 0)))


class Prediction(NamedTuple):
    """Everything predicted for one load case.

    Attributes:
        reading: (6,) what the cell reports at its location [N, N mm], mount frame.
        forces: at both clamps, without the cell's errors.
        joint: (joints, 3) force of each child bone on its parent [N], parent's axes.
        torque: (rotations,) [N mm].
    """

    reading: Array
    forces: ClampForces
    joint: Array
    torque: Array


@dataclass(frozen=True)
class Structure:
    """What the compiler keys on: topology, effects and the lengths of their parameter slices."""

    topology: Topology
    effects: tuple[Effect, ...]
    slices: tuple[tuple[int, int], ...]

    @cached_property
    def _hash(self) -> int:
        return hash((self.topology, self.effects, self.slices))

    def __hash__(self) -> int:
        """Computed once: every call of a compiled program asks for it."""
        return self._hash


@dataclass(frozen=True, repr=False)
class Model:
    """A finger with its effects for one session's layout.

    Attributes:
        finger: with the numbers before any fit.
        layout: settings and mountings for which there are parameters.
        budget: priors of the errors that every rig has.
        effects: beside the budget's own, before which they act unless they are `after_mounting`.
    """

    finger: Finger
    layout: Layout = ANY_LAYOUT
    budget: Budget = CERTIFICATE
    effects: tuple[Effect, ...] = ()
    _all: tuple[Effect, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        before = (e for e in self.effects if not e.after_mounting)
        after = (e for e in self.effects if e.after_mounting)
        object.__setattr__(self, "_all", (*before, *budget_effects(self.budget), *after))

    def __repr__(self) -> str:
        return f"<Model of {self.finger.id}: {len(self.parameters)} parameters, {len(self.effects)} effects>"

    @cached_property
    def parameters(self) -> ParameterTable:
        """Anatomy first, then every effect's parameters in the order of `structure.effects`."""
        return self._laid_out[0]

    @cached_property
    def structure(self) -> Structure:
        """The static part, hashable."""
        return self._laid_out[1]

    @cached_property
    def _laid_out(self) -> tuple[ParameterTable, Structure]:
        return self._lay_out(roomy=False)

    @cached_property
    def _roomy(self) -> tuple[ParameterTable, Structure]:
        return self._lay_out(roomy=True)

    def _lay_out(self, *, roomy: bool) -> tuple[ParameterTable, Structure]:
        """Parameters and structure, with spare settings or without."""
        declared, slices = list(anatomy_parameters(self.finger, self.budget)), []
        for effect in self._all:
            layout = self.layout.roomy if roomy and effect.of_each_setting else self.layout
            own = effect.parameters(self.finger.topology, layout)
            slices.append((len(declared), len(declared) + len(own)))
            declared += own
        return ParameterTable(declared), Structure(self.finger.topology, self._all, tuple(slices))

    @property
    def compiled(self) -> Structure:
        """The structure that programs are compiled for, which has spare settings; see `placed`."""
        return self._roomy[1]

    @cached_property
    def places(self) -> NDArray[np.intp]:
        """(parameters,) where each stands in a vector for `compiled`."""
        index = self._roomy[0].index
        return np.array([index[name] for name in self.parameters.names], dtype=np.intp)

    def placed(self, vector: NDArray[np.float64]) -> NDArray[np.float64]:
        """A vector for `compiled` from one of this model's parameters (parameters,); what is spare changes nothing."""
        out = self._roomy[0].initial.copy()
        out[self.places] = vector
        return out

    @cached_property
    def values(self) -> FingerValues:
        """The finger's numbers, as JAX arrays."""
        return jax_values(self.finger.values)

    def acting(self, moved: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Which effects (effects,) can change anything, where these parameters (parameters,) are off their null."""
        return np.array([moved[a:b].any() for a, b in self.structure.slices], dtype=bool)

    @property
    def initial(self) -> NDArray[np.float64]:
        """Parameter vector before any fit."""
        return self.parameters.initial.copy()

    def values_at(self, theta: NDArray[np.float64]) -> FingerValues:
        """The finger's numbers with the anatomy of a parameter vector."""
        fitted = with_anatomy(self.finger.topology, self.values, jnp.asarray(theta))
        return FingerValues(*(np.asarray(v) for v in fitted))

    def predict(self, cases: LoadCaseInput, theta: NDArray[np.float64] | None = None) -> Prediction:
        """Predict a batch of load cases, given with a leading axis on every field."""
        initial = self.parameters.initial
        vector = initial if theta is None else np.asarray(theta)
        # What is at its null changes nothing, and need not be gone through.
        acting = self.acting(vector != initial)
        found = predict_batch(self.compiled, self.values, self.placed(vector), cases.filled(), acting)
        return _first(cases.posture.shape[0], found)

    def jacobian(self, cases: LoadCaseInput, theta: NDArray[np.float64] | None = None) -> Array:
        """Derivative of every reading with respect to every parameter: (cases, 6, parameters)."""
        vector = self.parameters.initial if theta is None else theta
        return reading_jacobian(self.structure, self.values, jnp.asarray(vector), cases)

    def moment_arms(self, posture_rad: NDArray[np.float64], theta: NDArray[np.float64] | None = None) -> Array:
        """Moment arms [mm] in one posture: (rotations, segments)."""
        vector = self.parameters.initial if theta is None else theta
        values = jax_values(self.values_at(vector))
        return posture_moment_arms(self.finger.topology, values, jnp.asarray(posture_rad))


def jax_values(values: FingerValues) -> FingerValues:
    """The same numbers as JAX arrays."""
    # Copies: what is transferred may share its memory with JAX.
    return jax.device_put(FingerValues(*(np.array(v, dtype=float) for v in values)))


def with_anatomy(topology: Topology, values: FingerValues, theta: Array) -> FingerValues:
    """Put the leading entries of a parameter vector in the place of tendon points and fractions."""
    n = 3 * len(topology.segments)
    return values._replace(
        proximal_point=theta[:n].reshape(-1, 3),
        distal_point=theta[n : 2 * n].reshape(-1, 3),
        fraction=theta[2 * n : 2 * n + len(topology.fractions)],
    )


def parts_of(structure: Structure, theta: Array) -> tuple[Array, ...]:
    """Split a parameter vector (…, parameters) into the anatomy's part and each effect's."""
    first = structure.slices[0][0] if structure.slices else theta.shape[-1]
    return (theta[..., :first], *(theta[..., a:b] for a, b in structure.slices))


def predict_case(structure: Structure, values: FingerValues, theta: Array, case: LoadCaseInput) -> Prediction:
    """Predict one load case.

    Args:
        structure: topology and effects (static).
        values: the finger's numbers; points and fractions are taken from `theta`.
        theta: (parameters,) in the order of `Model.parameters`.
        case: one load case.
    """
    return predict_parts(structure, values, parts_of(structure, theta), case)


def predict_parts(
    structure: Structure,
    values: FingerValues,
    parts: tuple[Array, ...],
    case: LoadCaseInput,
    active: Array | None = None,
) -> Prediction:
    """Predict one load case from parameters split by `parts_of`.

    Differentiate this rather than `predict_case`: a slope for each slice of one long vector would be padded to the
    whole length, once for each effect.

    Args:
        structure: topology and effects (static).
        values: the finger's numbers.
        parts: of `parts_of`.
        case: one load case.
        active: (effects,) bool; one that is not is skipped, which is right only at its null, where it changes nothing
            and its slopes come out as zero. By default all are computed.
    """
    topology = structure.topology

    def act(stage: Stage, state: State) -> State:
        changes = {
            i: partial(getattr(effect, stage), p, case)
            for i, (effect, p) in enumerate(zip(structure.effects, parts[1:], strict=True))
            if getattr(getattr(effect, stage), "__func__", None) is not getattr(Effect, stage)
        }
        if active is None:
            for change in changes.values():
                state = change(state)
            return state
        for i, change in changes.items():
            state = _if(active[i], change, state) if _is_optional(structure, i) else change(state)
        return state

    state = State(topology, case.posture, with_anatomy(topology, values, parts[0]), case.tension)
    state = act("tension", state)
    state = act("geometry", state)
    poses = joint_poses(topology, state.values, state.posture)
    pulls = joint_pulls(topology, state.values, poses)
    shared = segment_tensions(topology, state.values, state.tension, poses)
    state = state._replace(poses=poses, pulls=pulls, segment_tension=shared)
    state = act("sharing", state)
    assert state.segment_tension is not None  # noqa: S101 - filled three lines above
    state = state._replace(torque=joint_torques(poses, pulls, state.segment_tension))
    state = act("torque", state)
    assert state.segment_tension is not None  # noqa: S101 - still filled
    assert state.torque is not None  # noqa: S101 - filled three lines above
    forces = clamp_forces(topology, state.values, poses, state.tension, state.torque)
    loads = joint_loads(poses, pulls, state.segment_tension, forces.tip)
    none = jnp.zeros(3)
    at_clamp = jnp.where(case.at_bone, jnp.concatenate([forces.bone, none]), forces.tip)
    state = state._replace(wrench=jnp.where(case.is_check, jnp.concatenate([case.known_force, none]), at_clamp))
    state = act("reading", state)
    assert state.wrench is not None  # noqa: S101 - filled above
    assert state.torque is not None  # noqa: S101 - filled above
    return Prediction(state.wrench, forces, loads, state.torque)


def _is_optional(structure: Structure, index: int) -> bool:
    """Whether an effect may be skipped: what is part of every model, or has no parameters here, is not worth asking."""
    start, end = structure.slices[index]
    return end > start and not structure.effects[index].always


def _if(active: Array, change: Callable[[State], State], state: State) -> State:
    """What a change makes of a state, computed only if it is active."""
    before, tree = jax.tree.flatten(tuple(state[1:]))
    changed: list[int] = []

    def computed() -> list[Array]:
        after = jax.tree.leaves(tuple(change(state)[1:]))
        changed[:] = [i for i, (old, new) in enumerate(zip(before, after, strict=True)) if new is not old]
        return [after[i] for i in changed]

    # The first branch is traced first, so the second knows what it leaves as it was. Computed anew for its slopes: what
    # it would have to keep for them is more, and is written whether it is active or not.
    new = jax.lax.cond(active, jax.checkpoint(computed), lambda: [jnp.asarray(before[i]) for i in changed])
    leaves = list(before)
    for i, leaf in zip(changed, new, strict=True):
        leaves[i] = leaf
    return State(state.topology, *jax.tree.unflatten(tree, leaves))


@stored(Prediction, ClampForces, hurried=True)
def predict_batch(
    structure: Structure, values: FingerValues, theta: Array, cases: LoadCaseInput, active: Array
) -> Prediction:
    """Predict many load cases: `predict_parts` over the leading axis of `cases`."""
    parts = parts_of(structure, theta)
    return jax.vmap(lambda case: predict_parts(structure, values, parts, case, active))(cases)


@partial(jax.jit, static_argnums=0)
def reading_jacobian(structure: Structure, values: FingerValues, theta: Array, cases: LoadCaseInput) -> Array:
    """Derivative of every reading with respect to every parameter: (cases, 6, parameters)."""
    # Reverse mode: six readings against a hundred parameters.
    return jax.vmap(lambda case: jax.jacrev(lambda t: predict_case(structure, values, t, case).reading)(theta))(cases)


@partial(jax.jit, static_argnums=0)
def posture_moment_arms(topology: Topology, values: FingerValues, posture: Array) -> Array:
    """Moment arms [mm] of every segment in one posture: (rotations, segments)."""
    poses = joint_poses(topology, values, posture)
    return moment_arms(topology, poses, joint_pulls(topology, values, poses))


@partial(jax.jit, static_argnums=0)
def tip_kinematics_batch(topology: Topology, values: FingerValues, posture: Array) -> TipKinematics:
    """Jacobian of the load point and orientation of the tip for postures (n, rotations) [rad]."""
    return jax.vmap(lambda q: tip_kinematics(topology, values, joint_poses(topology, values, q)))(posture)


def tips_of(topology: Topology, values: FingerValues, cases: LoadCaseInput) -> TipKinematics:
    """`tip_kinematics_batch` of the postures of a batch of load cases."""
    return _first(cases.posture.shape[0], tip_kinematics_batch(topology, values, cases.filled().posture))


def _first(count: int, found: Found) -> Found:
    """Cut what a batch was filled up with off its answers."""
    if jax.tree.leaves(found)[0].shape[0] == count:
        return found
    cut: Found = jax.tree.map(lambda x: np.asarray(x)[:count], found)
    return cut


# Cases a pass: their intermediate values stay in the cache.
CHUNK = 2048
# An elastic hood takes as many steps as the slowest case of its pass.
ELASTIC_CHUNK = 128


def clamp_forces_batch(topology: Topology, values: FingerValues, posture: ArrayLike, tension: ArrayLike) -> ClampForces:
    """Forces alone, without budget or effects, each case with its own posture and tensions.

    Args:
        topology: of the finger.
        values: of the finger.
        posture: (n, rotations) [rad].
        tension: (n, muscles) [N].

    Returns:
        Tip wrench (n, 6) and bone force (n, 3).
    """
    traced = any(isinstance(given, jax.core.Tracer) for given in (*values, posture, tension))
    if traced or not suits(topology):
        return forces_of_any(topology, values, posture, tension)
    finger = many_cases(topology, values)
    tip, bone = finger.forces(np.asarray(posture, dtype=float), np.asarray(tension, dtype=float))
    return ClampForces(cast(Array, tip), cast(Array, bone))


@stored(ClampForces)
def forces_of_any(topology: Topology, values: FingerValues, posture: Array, tension: Array) -> ClampForces:
    """`clamp_forces_batch` of a finger of any kind, through the stages of `predict_case`."""

    def one(case: tuple[Array, Array, Array]) -> ClampForces:
        cosine, sine, t = case
        poses = poses_of_turns(topology, values, cosine, sine)
        pulls = joint_pulls(topology, values, poses)
        torque = joint_torques(poses, pulls, segment_tensions(topology, values, t, poses))
        return clamp_forces(topology, values, poses, t, torque)

    # Cosines and sines enter the loop as data: inside it the compiler would compute each of them a dozen times.
    chunk = ELASTIC_CHUNK if isinstance(topology.hood, ElasticHood) else CHUNK
    return jax.lax.map(one, (jnp.cos(posture), jnp.sin(posture), tension), batch_size=chunk)
