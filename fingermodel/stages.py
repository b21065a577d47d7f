"""The five stages from hung masses to a reading, and what may act at each.

    tension ─▶ geometry ─▶ sharing ─▶ torque ─▶ reading

An effect is a small final class: parameters declared once, and one method at one stage, written for one load case in
array code. Sums of effects act in their order. At the null value of its parameters an effect changes nothing, exactly.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple

import jax
import numpy as np
from jax import Array
from numpy.typing import ArrayLike, NDArray

from fingermodel.fingers import FingerValues, Topology
from fingermodel.kinematics import JointPose
from fingermodel.parameters import Parameter
from fingermodel.tendons import Pulls

Stage = Literal["tension", "geometry", "sharing", "torque", "reading"]
STAGES: tuple[Stage, ...] = ("tension", "geometry", "sharing", "torque", "reading")


@dataclass(frozen=True)
class Layout:
    """What a session needs parameters for: its settings of a posture and its mountings of the cell.

    Attributes:
        settings: (posture, how many times it had been set) of each setting.
        mountings: (location, how many times it had been moved) of each mounting.
    """

    settings: tuple[tuple[str, int], ...]
    mountings: tuple[tuple[str, int], ...]

    def setting_name(self, index: int) -> str:
        """`hook`, or `hook#1` once the posture has been set anew."""
        name, count = self.settings[index]
        return f"{name}#{count}" if count else name

    def mounting_name(self, index: int) -> str:
        """`bone`, or `bone#1` once the cell has been moved."""
        name, count = self.mountings[index]
        return f"{name}#{count}" if count else name


class LoadCaseInput(NamedTuple):
    """One load case as the model sees it; a batch has a leading axis on every field.

    Attributes:
        posture: (rotations,) [rad].
        tension: (muscles,) hung weight times friction factor [N].
        at_bone: whether the cell reads the bone, and not the tip.
        known_force: (3,) weight hung on the cell itself [N], mount frame.
        is_check: whether only `known_force` acts (a check with a known weight).
        setting: index into `Layout.settings`.
        mounting: index into `Layout.mountings`.
        weight: what a gram pulls at the finger: gravity times friction factor [N/g].
        unloading: whether the last motion of the load took weight off.
        since_tare: time from the tare to the loaded reading, as a share of the session; 0 where no time is known.
        elapsed: time of the loaded reading, as a share of the session; 0 where no time is known.
    """

    posture: Array
    tension: Array
    at_bone: Array
    known_force: Array
    is_check: Array
    setting: Array
    mounting: Array
    weight: Array
    unloading: Array
    since_tare: Array
    elapsed: Array

    @classmethod
    def batch(cls, **columns: ArrayLike) -> LoadCaseInput:
        """Many load cases, every field by its name with a leading axis.

        Transferred, not made by JAX: it would compile a program for each new shape, some 10 ms each. What is
        transferred may share its memory with JAX, and so is a copy.
        """
        batch: LoadCaseInput = jax.device_put(cls(**{name: np.array(column) for name, column in columns.items()}))  # type: ignore[arg-type]
        return batch

    def rows(self, index: NDArray[np.intp]) -> LoadCaseInput:
        """Some load cases of a batch."""
        return self.batch(**{name: np.asarray(column)[index] for name, column in self._asdict().items()})


class State(NamedTuple):
    """What the stages hand on. Fields fill in from left to right.

    Attributes:
        topology: of the finger.
        posture: (rotations,) [rad].
        values: the finger's numbers.
        tension: (muscles,) [N], as it leaves the first bone.
        poses: of the joints; after `geometry`.
        pulls: of the tendon segments on the joints; after `geometry`.
        segment_tension: (segments,) [N]; after `sharing`.
        torque: (rotations,) [N mm]; after `torque`.
        wrench: (6,) reading [N, N mm]; after `reading`.
    """

    topology: Topology
    posture: Array
    values: FingerValues
    tension: Array
    poses: tuple[JointPose, ...] = ()
    pulls: tuple[Pulls, ...] = ()
    segment_tension: Array | None = None
    torque: Array | None = None
    wrench: Array | None = None


class Effect:
    """Base of every effect: nothing at any stage. Subclasses are final and override the method of their stage.

    `p` is the effect's own slice of the parameter vector, in the order of `parameters`.

    Attributes:
        name: in the catalogue.
        stage: at which it acts.
        title: what happens, in a few plain words.
        formula: what it changes.
        source: of the form and the range.
        tell: what gives it away in the data.
        shown_by: what measurement besides a load case would show it, as an instruction; nothing where none is known.
        always: whether it is part of every model, so that nothing is gained by asking whether it acts.
        of_each: setting or mounting, if it has parameters for each of them, all alike, after those that all share. A
            load case sees those of its own only, so that a session of more of them needs no other program.
        after_mounting: whether it is an error of what the cell says, and no force: a mounting that is a little off, as
            the budget allows, neither turns nor levers it.
        rests_on_clamp_assumption: whether only out-of-plane forces can support it, which a real clamp carries in part.
        outside: whether it is known to happen in rigs, but is no effect of the catalogue: if it acts, the verdict is
            that something outside the catalogue does.
    """

    name: str = ""
    stage: ClassVar[Stage] = "tension"
    title: ClassVar[str] = ""
    formula: ClassVar[str] = ""
    source: ClassVar[str] = ""
    tell: ClassVar[str] = ""
    shown_by: ClassVar[str] = ""
    rests_on_clamp_assumption: ClassVar[bool] = False
    after_mounting: ClassVar[bool] = False
    always: ClassVar[bool] = False
    of_each: ClassVar[Literal["", "setting", "mounting"]] = ""
    outside: ClassVar[bool] = False

    def parameters(self, topology: Topology, layout: Layout) -> tuple[Parameter, ...]:
        """Declare the parameters for this finger and session; none where the finger lacks what the effect acts on."""
        raise NotImplementedError

    def variants(self, topology: Topology, layout: Layout) -> Mapping[str, tuple[tuple[str, ...], ...]]:
        """Say which parameters make up a candidate: candidate name → alternatives, each a set of parameter names.

        Several candidates (one pulley of six) share the effect's prior; so do several alternatives of one candidate
        (the cell turned in both mountings alike, or in one).
        """
        return {self.name: (tuple(p.name for p in self.parameters(topology, layout)),)}

    def remedy(self, candidate: str) -> str:
        """Say what measurement besides a load case would settle one of its candidates; nothing where none is known."""
        return self.shown_by

    def tension(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Change what reaches each tendon."""
        return state

    def geometry(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Change the posture, points, axes or lengths."""
        return state

    def sharing(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Change how tension is shared among segments."""
        return state

    def torque(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Change the joint torques."""
        return state

    def reading(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Change what the cell reports."""
        return state
