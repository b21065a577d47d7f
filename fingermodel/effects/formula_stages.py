"""The five kinds of effects made of formulas, one a stage."""

from __future__ import annotations

from typing import ClassVar, final

import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from fingermodel.effects.formula_effect import FormulaEffect, Mask
from fingermodel.effects.formula_language import AXES, Target
from fingermodel.extensor import segment_tensions
from fingermodel.stages import LoadCaseInput, Stage, State


def _ones(chosen: list[bool]) -> NDArray[np.float64]:
    return np.array(chosen, dtype=float)


@final
class TensionFormula(FormulaEffect):
    """Formulas of `tension[MUSCLE]`."""

    stage: ClassVar[Stage] = "tension"

    def tension(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Change the tensions."""
        if p.shape[0] == 0:
            return state

        def chosen(target: Target) -> tuple[Mask | None, ...]:
            return (_ones([m == target.name for m in state.topology.muscles]),)

        (tension,) = self.acted((state.tension,), chosen, self.named(p, case, state))
        return state._replace(tension=tension)


@final
class GeometryFormula(FormulaEffect):
    """Formulas of `posture[ROTATION]`, and of `point[JOINT.SLIP].AXIS`, which moves both points of the segment."""

    stage: ClassVar[Stage] = "geometry"

    def geometry(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Change the posture and the points."""
        if p.shape[0] == 0:
            return state
        topology, values = state.topology, state.values

        def chosen(target: Target) -> tuple[Mask | None, ...]:
            if target.what == "posture":
                return _ones([r == target.name for r in topology.rotations]), None, None
            rows = _ones([s.name == target.name for s in topology.segments])
            both = np.outer(rows, [a == target.axis for a in AXES])
            return None, both, both

        points = (jnp.asarray(values.proximal_point), jnp.asarray(values.distal_point))
        posture, proximal, distal = self.acted((state.posture, *points), chosen, self.named(p, case, state))
        return state._replace(posture=posture, values=values._replace(proximal_point=proximal, distal_point=distal))


@final
class SharingFormula(FormulaEffect):
    """Formulas of `fraction[NAME]`, after which the hood shares anew, and of `segment_tension[JOINT.SLIP]`."""

    stage: ClassVar[Stage] = "sharing"

    def sharing(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Change the fractions and the segments' tensions."""
        if p.shape[0] == 0:
            return state
        topology, values = state.topology, state.values

        def of_hood(target: Target) -> tuple[Mask | None, ...]:
            return (_ones([f == target.name for f in topology.fractions]) if target.what == "fraction" else None,)

        def of_segments(target: Target) -> tuple[Mask | None, ...]:
            here = [s.name == target.name for s in topology.segments]
            return (_ones(here) if target.what == "segment_tension" else None,)

        assert state.segment_tension is not None  # noqa: S101 - the stage before has filled it
        names, shared = self.named(p, case, state), state.segment_tension
        if any(f.target.what == "fraction" for f in self.parsed):
            (fraction,) = self.acted((jnp.asarray(values.fraction),), of_hood, names)
            changed = values._replace(fraction=fraction)
            # The difference, so that what earlier effects did to the segments stays.
            before, after = (segment_tensions(topology, v, state.tension, state.poses) for v in (values, changed))
            values, shared = changed, shared + (after - before)
        (shared,) = self.acted((shared,), of_segments, names)
        return state._replace(values=values, segment_tension=shared)


@final
class TorqueFormula(FormulaEffect):
    """Formulas of `torque[ROTATION]`."""

    stage: ClassVar[Stage] = "torque"

    def torque(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Change the torques."""
        if p.shape[0] == 0:
            return state

        def chosen(target: Target) -> tuple[Mask | None, ...]:
            return (_ones([r == target.name for r in state.topology.rotations]),)

        assert state.torque is not None  # noqa: S101 - the stage before has filled it
        (torque,) = self.acted((state.torque,), chosen, self.named(p, case, state))
        return state._replace(torque=torque)


@final
class ReadingFormula(FormulaEffect):
    """Formulas of `force[AXIS]` and `moment[AXIS]`, at one location of the cell or at both."""

    stage: ClassVar[Stage] = "reading"

    def reading(self, p: Array, case: LoadCaseInput, state: State) -> State:
        """Change what the cell reports."""
        if p.shape[0] == 0:
            return state

        def chosen(target: Target) -> tuple[Mask | None, ...]:
            here = _ones([(what, a) == (target.what, target.name) for what in ("force", "moment") for a in AXES])
            if not target.place:
                return (here,)
            return (here * jnp.where(case.at_bone == (target.place == "bone"), 1.0, 0.0),)

        assert state.wrench is not None  # noqa: S101 - the stage before has filled it
        (wrench,) = self.acted((state.wrench,), chosen, self.named(p, case, state))
        return state._replace(wrench=wrench)


OF_STAGE: dict[Stage, type[FormulaEffect]] = {
    kind.stage: kind for kind in (TensionFormula, GeometryFormula, SharingFormula, TorqueFormula, ReadingFormula)
}
