"""How the readings of a session change with all that disturbs them beside the effects: columns of its model."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import groupby

import jax
import numpy as np

from fingermodel.arrays import Floats, Ints, Mask
from fingermodel.comparison.observations import Observations
from fingermodel.diagnosis.session_model.discrepancy import (
    Places,
    constant_columns,
    loaded_columns,
    tension_columns,
    torque_columns,
)
from fingermodel.diagnosis.session_model.group_errors import by_group, in_each, zero_moments
from fingermodel.diagnosis.session_model.slips import PossibleSlips
from fingermodel.kinematics import TipKinematics
from fingermodel.model import Model, tip_kinematics_batch
from fingermodel.stages import LoadCaseInput
from fingermodel.structure import Pieces

# Postures, changes of posture or mount, and weights, from which on they are not looked at: there would be too many.
MOST_BLOCKS = 20
# Step of a derivative by the logarithm of a tension, and by an angle [rad].
_STEP = 1e-3
# Share of the abduction torque that a clamp which resists twist carries as Mx and My.
_CLAMP_SHARE = 0.1


@dataclass(frozen=True, eq=False)
class CaseChanges:
    """How each reading of some load cases changes, measured or not."""

    model: Model  # with every candidate at its null
    inputs: LoadCaseInput  # the load cases

    @cached_property
    def torque_answer(self) -> Floats:
        """(cases, rotations, 6) change of every reading per N mm of torque about a rotation."""
        topology, jacobian = self.model.finger.topology, self.jacobian
        rows = list(topology.reactions)
        wrench = np.zeros((len(jacobian), len(topology.rotations), 6))
        wrench[:, :, rows] = np.swapaxes(np.linalg.inv(np.swapaxes(jacobian[:, rows], 1, 2)), 1, 2)
        return self.as_read(wrench)

    def by_tension(self, theta: Floats) -> Floats:
        """(cases, 6, muscles) change of every reading by the logarithm of each tension, about some parameters."""
        return self._derivatives(theta, "tension", np.asarray(self.inputs.tension))

    def less_by_newton(self, theta: Floats) -> Floats:
        """(cases, 6, muscles) change of every reading by a newton that each tendon pulls less, hung on or not."""
        return -self._derivatives(theta, "tension", np.ones(np.shape(self.inputs.tension)))

    def by_angle(self, theta: Floats) -> Floats:
        """(cases, 6, rotations) change of every reading per radian of each joint angle, about some parameters."""
        return self._derivatives(theta, "posture", np.ones(np.shape(self.inputs.posture)))

    def readings(self, theta: Floats) -> Floats:
        """(cases, 6) what the model predicts [N, N mm]."""
        return np.asarray(self.model.predict(self._pieces, theta).reading)

    def _derivatives(self, theta: Floats, name: str, unit: Floats) -> Floats:
        """(cases, 6, k) change of every reading per unit of each column of an input, to first order.

        Args:
            theta: (parameters,).
            name: of the input.
            unit: (cases, k) of each column; nothing changes by one that has none.
        """
        now = self.readings(theta)
        out = np.zeros((*now.shape, unit.shape[1]))
        for k in np.flatnonzero(unit.any(axis=0)):
            moved = np.array(getattr(self.inputs, name))
            moved[:, k] += _STEP * unit[:, k]
            there = self.model.predict(self.inputs._replace(**{name: jax.device_put(moved)}), theta).reading
            out[:, :, k] = (np.asarray(there) - now) / _STEP
        return out

    @cached_property
    def _pieces(self) -> Pieces:
        """The load cases, made ready once for all predictions."""
        return self.model.pieces(self.inputs)

    @cached_property
    def jacobian(self) -> Floats:
        """(cases, 6, rotations) of the load point, in the distal phalanx's axes."""
        return np.asarray(self._tips.jacobian)

    @cached_property
    def to_base(self) -> Floats:
        """(cases, 3, 3) takes these axes to the metacarpal's."""
        return np.asarray(self._tips.to_base)

    @cached_property
    def _tips(self) -> TipKinematics:
        return tip_kinematics_batch(self.model.finger.topology, self.model.values, self.inputs.posture)

    def as_read(self, wrench: Floats) -> Floats:
        """Changes of the tip's wrench (cases, k, 6) as the cell reads them at either mount; a check reads none."""
        bone = np.zeros_like(wrench)
        bone[:, :, :3] = -np.einsum("nij,nkj->nki", self.to_base, wrench[:, :, :3])
        at_bone, check = np.asarray(self.inputs.at_bone), np.asarray(self.inputs.is_check)
        return np.where(at_bone[:, None, None], bone, wrench) * ~check[:, None, None]


@dataclass(frozen=True, eq=False)
class ReadingChanges(CaseChanges):
    """How each reading of a session changes, whichever of them are fitted."""

    observations: Observations  # of the session
    centre: Floats  # (parameters,) of the priors
    rows: Ints  # (n,) indices of the readings into the flattened (cases, 6) wrench
    _smooth: dict[str, Floats] = field(default_factory=dict, repr=False)

    @cached_property
    def places(self) -> Places:
        """Where each reading belongs."""
        return Places.of(self.observations, self.rows)

    @cached_property
    def slips(self) -> PossibleSlips:
        """What may have been done in each case instead of what was entered."""
        return PossibleSlips(self.model, self.observations)

    @cached_property
    def tares(self) -> Floats:
        """(n, k) columns of the tares that several cases share."""
        columns = self.observations.shared_tares[self.rows]
        return columns[:, np.abs(columns).sum(axis=0) > 0.0]

    @cached_property
    def nuisances(self) -> Floats:
        """(n, k) columns of the rig's budget that the model has no parameter for.

        A clamp at the tip that resists twist carries a share of the abduction torque as Mx and My, one of each for
        every setting. What the tare missed at the tip has a moment.
        """
        missed = zero_moments(self.observations, self.rows, self.model.budget.zero_tip_sd_N)
        return np.concatenate([self._clamp_twist(), missed], axis=1)

    @property
    def carriers(self) -> tuple[str, ...]:
        """What something smooth may be of: of everything (""), of one tendon, rotation or posture alone."""
        topology = self.model.finger.topology
        tendons = [m for m, load in zip(topology.muscles, self.places.load.T, strict=True) if load.any()]
        return ("", *tendons, *topology.rotations, *self._postures)

    @property
    def _postures(self) -> list[str]:
        """Postures of the session, where there are several."""
        names = postures_in_use(self.observations)
        return names if len(names) > 1 else []

    def smooth(self, block: str) -> Floats:
        """(n, k) columns of something smooth.

        Args:
            block: its family and what has it (see `carriers`), as in `torque:FDP`. Families are `torque` of joints;
                `tension`: what gets through of each; `loaded`: readings, growing with the load; `constant`: readings,
                whatever the load.
        """
        if block not in self._smooth:
            family, carrier = block.split(":")
            topology = self.model.finger.topology
            tendons, rotations = _carrying(carrier, topology.muscles), _carrying(carrier, topology.rotations)
            in_posture = of_label(self.observations.postures, carrier)[self.rows // 6]
            here = in_posture if carrier in self._postures else np.ones(len(self.rows), dtype=bool)
            at = replace(self.places, load=self.places.load[:, tendons], kinds=[k & here for k in self.places.kinds])
            if family == "torque":
                answer = self.of_rows(np.swapaxes(self.torque_answer, 1, 2)) * here[:, None]
                self._smooth[block] = torque_columns(at, answer[:, rotations])
            elif family == "tension":
                self._smooth[block] = tension_columns(at, self.by_stated_tension[:, tendons] * here[:, None])
            else:
                self._smooth[block] = (loaded_columns if family == "loaded" else constant_columns)(at)
        return self._smooth[block]

    def forget(self) -> None:
        """Let go of what is smooth, and of slips; what is asked of them again is made again."""
        self._smooth.clear()
        self.__dict__.pop("slips", None)

    @cached_property
    def by_stated_tension(self) -> Floats:
        """(n, muscles) change of every reading by the logarithm of each tension, about the priors' centre."""
        return self.of_rows(self.by_tension(self.centre))

    @cached_property
    def by_stated_angle(self) -> Floats:
        """(n, rotations) change of every reading per radian of each joint angle, about the priors' centre."""
        return self.of_rows(self.by_angle(self.centre))

    def of_rows(self, changes: Floats) -> Floats:
        """(n, k) of the readings, from changes (cases, 6, k) of all components."""
        return changes[self.rows // 6, self.rows % 6]

    def _clamp_twist(self) -> Floats:
        """(n, k) columns of Mx and My in every setting, with what the tip then carries besides."""
        model, inputs, topology = self.model, self.inputs, self.model.finger.topology
        carried, rotations = list(topology.reactions), list(topology.rotations)
        free = [c for c in (3, 4) if c not in carried]
        aside = [r for r in rotations if r not in {j.name for j in topology.joints}]
        if not free or not aside or not self.places.moment.any():
            return np.zeros((len(self.rows), 0))
        torque = np.asarray(model.predict(inputs, self.centre).torque)[:, rotations.index(aside[0])]
        jacobian = self.jacobian
        wrench = np.zeros((len(torque), len(free), 6))
        wrench[:, np.arange(len(free)), free] = 1.0
        lever = np.swapaxes(jacobian[:, carried], 1, 2)
        wrench[:, :, carried] = -np.linalg.solve(lever[:, None], jacobian[:, free, :, None])[..., 0]
        change = self.of_rows(np.swapaxes(self.as_read(_CLAMP_SHARE * torque[:, None, None] * wrench), 1, 2))
        setting = np.asarray(inputs.setting)[self.rows // 6]
        here = [setting == k for k in np.unique(setting)]
        return np.concatenate([in_each(here, of_moment[:, None]) for of_moment in change.T], axis=1)


def postures_in_use(observations: Observations) -> list[str]:
    """Postures of the cases; none where they are so many that a block of cases is hardly more than one."""
    names = list(observations.posture_angles)
    return names if len(names) <= MOST_BLOCKS else []


def set_up_once(observations: Observations, *further: Iterable[Hashable]) -> list[list[int]]:
    """Runs of cases for which the finger was set up once, alike in what further is given of each case."""
    o = observations
    each = list(zip(o.postures, o.locations, np.asarray(o.inputs.setting).tolist(), *further, strict=True))
    return [list(alike) for _, alike in groupby(range(len(each)), each.__getitem__)]


def of_label(labels: Sequence[str], label: str) -> Mask:
    """(cases,) which of them have a label."""
    return np.array([one == label for one in labels])


def _carrying(carrier: str, names: Sequence[str]) -> list[int]:
    """Indices of what carries something smooth among some names: of one, or of all where it is none of them."""
    return [k for k, name in enumerate(names) if name == carrier] or list(range(len(names)))


@dataclass(frozen=True, eq=False)
class LinearisedErrors:
    """Errors of tensions and of groups of cases, linearised about a finger."""

    changes: ReadingChanges  # of the readings
    about: Floats | None = None  # (parameters,) of the finger; by default the priors' centre

    @cached_property
    def by_tension(self) -> Floats:
        """(n, muscles) change of every reading by the logarithm of each tension."""
        if self.about is None:
            return self.changes.by_stated_tension
        return self.changes.of_rows(self.changes.by_tension(self.about))

    @cached_property
    def by_group(self) -> dict[str, Floats]:
        """(n, k) change of every reading per unit of each error by group of cases (see `GroupErrors`), by its name."""
        return self.by_group_among(np.ones(len(self.changes.rows), dtype=bool))

    def by_group_among(self, chosen: Mask) -> dict[str, Floats]:
        """The same of some readings (n,), as if there were no others: what these can show by themselves."""
        changes = self.changes
        suture, by_angle = np.asarray(changes.model.values.suture), changes.by_stated_angle[chosen]
        return by_group(changes.observations, changes.rows[chosen], suture, self.by_tension[chosen], by_angle)
