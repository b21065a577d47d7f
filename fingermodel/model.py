"""The model: a finger, its effects and their parameters; one load case in, forces and a reading out.

`predict_case` is written for one load case. `jax.vmap` batches it, `jax.jacobian` differentiates it with respect to
everything. All effects live in it at their null values, so choosing effects is choosing which parameters are free.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import ArrayLike, NDArray

from fingermodel.budget import CERTIFICATE, Budget, anatomy_parameters, budget_effects
from fingermodel.compiled.programs import stored
from fingermodel.extensor import segment_tensions
from fingermodel.fingers import Finger, FingerValues, Topology
from fingermodel.kinematics import TipKinematics, joint_poses, tip_kinematics
from fingermodel.many_cases import many_cases, suits
from fingermodel.parameters import ParameterTable
from fingermodel.stages import Effect, Layout, LoadCaseInput, Stage, State
from fingermodel.statics import ClampForces, clamp_forces, joint_loads, joint_torques
from fingermodel.structure import ANY_LAYOUT, Compact, Pieces, Structure, in_pieces, joined
from fingermodel.tendons import joint_pulls, moment_arms

# Condition number from which on a Jacobian is that of a straight finger.
_STRAIGHT = 1e6

jax.config.update("jax_enable_x64", True)

# Load cases that a program predicts at once: a session has about as many, and fewer cost nearly as much.
PREDICTED = 128


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


@dataclass(frozen=True, eq=False, repr=False)
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
        declared, slices = list(anatomy_parameters(self.finger, self.budget)), []
        for effect in self._all:
            own = effect.parameters(self.finger.topology, self.layout)
            slices.append((len(declared), len(declared) + len(own)))
            declared += own
        return ParameterTable(declared), Structure(self.finger.topology, self._all, tuple(slices))

    @cached_property
    def compact(self) -> Compact:
        """The same parameters as compiled programs take them."""
        anatomy = self.structure.slices[0][0]
        return Compact(self.finger.topology, self._all, self.layout, self.parameters, anatomy)

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

    def pieces(self, cases: LoadCaseInput) -> Pieces:
        """Load cases ready to be predicted: whoever predicts them again and again makes these once."""
        return Pieces.of(self.compact, cases, PREDICTED)

    def given(
        self, cases: Pieces, theta: NDArray[np.float64]
    ) -> list[tuple[FingerValues, NDArray[np.float64], NDArray[np.float64], LoadCaseInput]]:
        """What compiled programs take of each piece: numbers, parameters that all share, each case's own, and cases.

        Args:
            cases: of `pieces`.
            theta: (parameters,).
        """
        shared = self.compact.shared(theta)
        return [(self.values, shared, theta[own], piece) for piece, own in zip(cases.cases, cases.own, strict=True)]

    def predict(
        self,
        cases: LoadCaseInput | Pieces,
        theta: NDArray[np.float64] | None = None,
        acting: NDArray[np.bool_] | None = None,
    ) -> Prediction:
        """Predict a batch of load cases.

        Args:
            cases: with a leading axis on every field.
            theta: (parameters,); by default as they are before any fit.
            acting: (effects,) which of them are gone through; by default those with a parameter off its null.
        """
        initial = self.parameters.initial
        vector = initial if theta is None else np.asarray(theta)
        pieces = cases if isinstance(cases, Pieces) else self.pieces(cases)
        # What is at its null changes nothing, and need not be gone through.
        active = self.acting(vector != initial) if acting is None else acting
        structure = self.compact.structure
        found = [predict_batch(structure, *given, active) for given in self.given(pieces, vector)]
        return joined(found, pieces.count)

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


def predict_case(structure: Structure, values: FingerValues, theta: Array, case: LoadCaseInput) -> Prediction:
    """Predict one load case.

    Args:
        structure: topology and effects (static).
        values: the finger's numbers; points and fractions are taken from `theta`.
        theta: (parameters,) in the order of `Model.parameters`.
        case: one load case.
    """
    return predict_parts(structure, values, structure.parts(theta), case)


def predict_parts(
    structure: Structure,
    values: FingerValues,
    parts: tuple[Array, ...],
    case: LoadCaseInput,
    active: Array | None = None,
) -> Prediction:
    """Predict one load case from parameters split by `Structure.parts`.

    Differentiate this rather than `predict_case`: a slope for each slice of one long vector would be padded to the
    whole length, once for each effect.

    Args:
        structure: topology and effects (static).
        values: the finger's numbers.
        parts: of `Structure.parts`.
        case: one load case.
        active: (effects,) bool; one that is not is skipped, which is right only at its null, where it changes nothing
            and its slopes come out as zero. By default all are computed.
    """
    topology = structure.topology

    def act(stage: Stage, state: State) -> State:
        changes = {
            i: partial(getattr(effect, stage), p, structure.case_of(i, case))
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
    return structure.has_parameters(index) and not structure.effects[index].always


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
    structure: Structure, values: FingerValues, theta: Array, own: Array, cases: LoadCaseInput, active: Array
) -> Prediction:
    """Predict many load cases: `predict_parts` over the leading axis of `cases` and of their own parameters."""

    def one(own_of_case: Array, case: LoadCaseInput) -> Prediction:
        return predict_parts(structure, values, structure.parts(theta, own_of_case), case, active)

    return jax.vmap(one)(own, cases)


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


def tip_kinematics_batch(topology: Topology, values: FingerValues, posture: ArrayLike) -> TipKinematics:
    """Jacobian of the load point and orientation of the tip for postures (n, rotations) [rad]."""
    every = np.asarray(posture)
    return joined([_tips(topology, values, every[k]) for k in in_pieces(len(every), PREDICTED)], len(every))


def straight(topology: Topology, values: FingerValues, posture: ArrayLike) -> NDArray[np.bool_]:
    """Whether each posture (n, rotations) [rad] leaves the finger straight: torques do not give the tip force."""
    jacobian = np.asarray(tip_kinematics_batch(topology, values, posture).jacobian)
    # A typical lever makes rows of force and of moment comparable.
    unit = np.array([[1.0 if c < 3 else 20.0] for c in topology.reactions])
    square = jacobian[:, list(topology.reactions)] * unit
    finite = np.isfinite(square).all(axis=(1, 2))
    condition = np.full(len(square), np.inf)
    condition[finite] = np.linalg.cond(square[finite])
    return condition > _STRAIGHT


@partial(jax.jit, static_argnums=0)
def _tips(topology: Topology, values: FingerValues, posture: Array) -> TipKinematics:
    return jax.vmap(lambda q: tip_kinematics(topology, values, joint_poses(topology, values, q)))(posture)


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
    if any(isinstance(given, jax.core.Tracer) for given in (*values, posture, tension)):
        return _forces(topology, values, jnp.asarray(posture), jnp.asarray(tension))
    q, t = np.asarray(posture, dtype=float), np.asarray(tension, dtype=float)
    if not suits(topology):
        return forces_of_any(topology, values, q, t)
    tip, bone = many_cases(topology, values).forces(q, t)
    return ClampForces(cast(Array, tip), cast(Array, bone))


def forces_of_any(
    topology: Topology, values: FingerValues, posture: NDArray[np.float64], tension: NDArray[np.float64]
) -> ClampForces:
    """`clamp_forces_batch` of a finger of any kind, through the stages of `predict_case`."""
    # An elastic hood takes as many steps as the slowest case of its piece.
    rows = in_pieces(len(posture), PREDICTED)
    return joined([_forces(topology, values, posture[k], tension[k]) for k in rows], len(posture))


@stored(ClampForces)
def _forces(topology: Topology, values: FingerValues, posture: Array, tension: Array) -> ClampForces:
    def one(q: Array, t: Array) -> ClampForces:
        poses = joint_poses(topology, values, q)
        pulls = joint_pulls(topology, values, poses)
        torque = joint_torques(poses, pulls, segment_tensions(topology, values, t, poses))
        return clamp_forces(topology, values, poses, t, torque)

    return jax.vmap(one)(posture, tension)
