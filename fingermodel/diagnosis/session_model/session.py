"""One bench session as a generative model: readings, their noise by case, and what disturbs them beside any effect.

    y = f(θ, φ) + F ε + K τ + L υ + s R η + e_case + e

Readings are fitted (identification cases and checks) or only predicted (validation cases). Noise, scatter and bad cases
are independent by case; everything else is a column with a Gaussian weight.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from functools import cached_property

import jax
import numpy as np
from numpy.typing import NDArray

from daq.errors import SessionError
from fingermodel.comparison.observations import Observations
from fingermodel.diagnosis.session_model.bad_cases import bad_size
from fingermodel.diagnosis.session_model.case_noise import CaseErrors, CaseNoise, Scatter
from fingermodel.diagnosis.session_model.discrepancy import (
    Places,
    constant_columns,
    loaded_columns,
    tension_columns,
    torque_columns,
)
from fingermodel.diagnosis.session_model.group_errors import by_group, zero_moments
from fingermodel.diagnosis.session_model.whitening import NoiseWhitening, WhitenedSmooth
from fingermodel.diagnosis.settings import CLAMP_SHARE
from fingermodel.fingers import Plane
from fingermodel.fitting.problems import Problem, require_rows, weighted_problem
from fingermodel.fitting.roots import root_of
from fingermodel.model import Model, tip_kinematics_batch
from fingermodel.stages import LoadCaseInput
from fingermodel.structure import Pieces

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]
Mask = NDArray[np.bool_]

# Step of a derivative by the logarithm of a tension, and by an angle [rad].
_STEP = 1e-3
# Share of the loads that a heavy one exceeds.
_HEAVY = 0.9
# Loads that differ by less are alike, relative.
_ALIKE = 0.05
# What does not depend on where the scatter's columns are made.
_THE_SAME_FROM_ANYWHERE = (
    "places",
    "tares",
    "nuisances",
    "torque_answer",
    "_answer_by_row",
    "_by_angle",
    "_by_stated_tension",
    "_pieces",
    "_smooth",
    "_tips",
)


@dataclass(frozen=True, eq=False)
class Session:
    """A session's readings with all that acts on them beside the model.

    Attributes:
        problem: which readings are fitted, over which parameters with which priors; its noise is as measured.
        rows: (n,) indices into the flattened (cases, 6) wrench of fitted and validation readings.
        fitted: (n,) which of them are fitted.
        plane: of the force components that count.
        stated_scatter: of the tensions from case to case, by the session or its budget; 0 where none is stated.
        about: (parameters,) at which the scatter's columns are made; by default the priors' centre.
    """

    problem: Problem
    rows: Rows
    fitted: Mask
    plane: Plane
    stated_scatter: float
    about: Floats | None = None

    @property
    def model(self) -> Model:
        """With every candidate at its null."""
        return self.problem.model

    @property
    def observations(self) -> Observations:
        """Of the session."""
        return self.problem.observations

    @property
    def measured(self) -> Floats:
        """(n,) readings [N, N mm]."""
        return np.nan_to_num(self.observations.wrench).reshape(-1)[self.rows]

    def seen_from(self, theta: Floats) -> Session:
        """The same with the scatter's columns made at a parameter vector (parameters,)."""
        other = replace(self, about=theta)
        for name in _THE_SAME_FROM_ANYWHERE:
            other.__dict__[name] = getattr(self, name)
        return other

    @cached_property
    def places(self) -> Places:
        """Where each reading belongs."""
        return Places.of(self.observations, self.rows)

    @property
    def carriers(self) -> tuple[str, ...]:
        """What something smooth may be of: of everything (""), of one tendon alone, of one rotation alone."""
        tendons = [
            m for m, load in zip(self.model.finger.topology.muscles, self.places.load.T, strict=True) if load.any()
        ]
        return ("", *tendons, *self.model.finger.topology.rotations)

    def smooth(self, block: str) -> Floats:
        """(n, k) columns of something smooth.

        Args:
            block: its family and what carries it (see `carriers`), as in `torque:FDP`. Families are `torque` of joints;
                `tension`: what gets through of each; `loaded`: readings, growing with the load; `constant`: readings,
                whatever the load.
        """
        if block not in self._smooth:
            family, carrier = block.split(":")
            muscles, rotations = list(self.model.finger.topology.muscles), list(self.model.finger.topology.rotations)
            at = self.places.of_muscle(muscles.index(carrier)) if carrier in muscles else self.places
            if family == "torque":
                only = [rotations.index(carrier)] if carrier in rotations else range(len(rotations))
                self._smooth[block] = torque_columns(at, self._answer_by_row[:, list(only)])
            elif family == "tension":
                only = [muscles.index(carrier)] if carrier in muscles else range(len(muscles))
                self._smooth[block] = tension_columns(at, self._by_stated_tension[:, list(only)])
            else:
                self._smooth[block] = (loaded_columns if family == "loaded" else constant_columns)(at)
        return self._smooth[block]

    @cached_property
    def _smooth(self) -> dict[str, Floats]:
        return {}

    @cached_property
    def _answer_by_row(self) -> Floats:
        answer = self.torque_answer.reshape(len(self.observations.ids), -1, 6)
        out: Floats = answer[self.rows // 6, :, self.rows % 6]
        return out

    @cached_property
    def torque_answer(self) -> Floats:
        """(cases, rotations, 6) change of every reading per N mm of torque about a rotation."""
        topology, jacobian = self.model.finger.topology, self._tips[0]
        rows = list(topology.reactions)
        wrench = np.zeros((len(jacobian), len(topology.rotations), 6))
        wrench[:, :, rows] = np.swapaxes(np.linalg.inv(np.swapaxes(jacobian[:, rows], 1, 2)), 1, 2)
        return self._as_read(wrench)

    @cached_property
    def _tips(self) -> tuple[Floats, Floats]:
        """Jacobian (cases, 6, rotations) of the load point, and (cases, 3, 3) from its axes to the metacarpal's."""
        tip = tip_kinematics_batch(self.model.finger.topology, self.model.values, self.observations.inputs.posture)
        return np.asarray(tip.jacobian), np.asarray(tip.to_base)

    def _as_read(self, wrench: Floats) -> Floats:
        """Changes of the tip's wrench (cases, k, 6) as the cell reads them at either mount; a check reads none."""
        inputs = self.observations.inputs
        bone = np.zeros_like(wrench)
        bone[:, :, :3] = -np.einsum("nij,nkj->nki", self._tips[1], wrench[:, :, :3])
        at_bone, check = np.asarray(inputs.at_bone), np.asarray(inputs.is_check)
        out: Floats = np.where(at_bone[:, None, None], bone, wrench) * ~check[:, None, None]
        return out

    @cached_property
    def fitted_noise(self) -> CaseNoise:
        """By case, of the fitted readings."""
        return self.noise_of(self.fitted)

    def noise_of(self, chosen: Mask) -> CaseNoise:
        """By case, of some readings (n,)."""
        moment, measured = self.places.moment[chosen], self.measured[chosen]
        pulled_N = np.asarray(self.observations.inputs.tension).sum(axis=1)
        # Some cases may have been entered with far too much.
        usual_N = float(np.quantile(pulled_N[pulled_N > 0.0], _HEAVY)) if pulled_N.any() else 0.0
        size = bad_size(moment, measured, pulled_N[self.rows[chosen] // 6], usual_N)
        own, assumed = self.observations.noise.alone, self.observations.noise_assumed
        scatter, unit = Scatter(self._by_tension[chosen], self._by_angle[chosen]), self.places.unit[chosen]
        return CaseNoise.of(own, self.rows[chosen], scatter, unit, size, assumed)

    def whitened_smooth(self, errors: CaseErrors, bad: frozenset[int]) -> WhitenedSmooth:
        """The fitted readings' noise, and smooth columns under it; kept, since every explanation asks for them."""
        # Columns are many times as large as their inner products, and made again in no time.
        self._columns.clear()
        key = (errors, bad)
        if key not in self._kept:
            whitening = NoiseWhitening.of(*self.fitted_noise.whitening(*key), self.tares[self.fitted])
            # A cycle of references would keep all columns until the garbage collector runs.
            session = weakref.proxy(self)

            def part(block: str) -> Floats:
                return session.smooth(block)[session.fitted]

            self._kept[key] = WhitenedSmooth(whitening, part, self._columns)
        return self._kept[key]

    def drawn_noise(self, errors: CaseErrors, rng: np.random.Generator) -> Floats:
        """Draw errors of the fitted readings (n,): noise and scatter of these sizes, and tares."""
        tares = self.tares[self.fitted]
        z = rng.standard_normal(len(tares))
        out: Floats = tares @ rng.standard_normal(tares.shape[1])
        for rows, blocks in self.fitted_noise.covariances(errors, ()):
            out[rows] += (root_of(blocks) @ z[rows][..., None])[..., 0]
        return out

    def forget(self) -> None:
        """Let go of what is smooth, whitened or not; what is asked of it again is made again."""
        for kept in (self._kept, self._columns, self._smooth):
            kept.clear()

    @cached_property
    def _kept(self) -> dict[tuple[CaseErrors, frozenset[int]], WhitenedSmooth]:
        return {}

    @cached_property
    def _columns(self) -> dict[tuple[int, str], Floats]:
        return {}

    @cached_property
    def unlike_fitted(self) -> frozenset[int]:
        """Validation cases in a posture, with tendons loaded together, or under a load that no fitted case has."""
        tension, postures = np.asarray(self.observations.inputs.tension), self.observations.postures
        fitted, unseen = (np.unique(self.rows[chosen] // 6).tolist() for chosen in (self.fitted, ~self.fitted))
        known = {postures[i] for i in fitted}
        loads, most = {tuple(tension[i] > 0.0) for i in fitted}, tension[fitted].max(axis=0) * (1.0 + _ALIKE)
        return frozenset(
            i
            for i in unseen
            if postures[i] not in known or tuple(tension[i] > 0.0) not in loads or (tension[i] > most).any()
        )

    @cached_property
    def tares(self) -> Floats:
        """(n, k) columns of the tares that several cases share."""
        columns = self.observations.shared_tares[self.rows]
        return columns[:, np.abs(columns).sum(axis=0) > 0.0]

    @cached_property
    def _by_tension(self) -> Floats:
        """(n, muscles) change of every reading by the logarithm of each tension."""
        if self.about is None:
            return self._by_stated_tension
        return self.by_tension(self.about)[self.rows // 6, self.rows % 6]

    @cached_property
    def _by_stated_tension(self) -> Floats:
        """The same about the priors' centre, wherever it is linearised."""
        return self.by_tension(self.problem.centre)[self.rows // 6, self.rows % 6]

    def by_tension(self, theta: Floats) -> Floats:
        """(cases, 6, muscles) change of every reading by the logarithm of each tension, about some parameters."""
        inputs = self.observations.inputs
        tension = np.asarray(inputs.tension)
        step = {k: _STEP * tension[:, k] for k in np.flatnonzero(tension.any(axis=0)).tolist()}
        return self._derivatives(theta, tension, step, lambda moved: inputs._replace(tension=moved))

    @cached_property
    def _by_angle(self) -> Floats:
        """(n, rotations) change of every reading per radian of each joint angle, about the priors' centre."""
        return self.by_angle(self.problem.centre)[self.rows // 6, self.rows % 6]

    def by_angle(self, theta: Floats) -> Floats:
        """(cases, 6, rotations) change of every reading per radian of each joint angle, about some parameters."""
        inputs = self.observations.inputs
        posture = np.asarray(inputs.posture)
        step = {k: np.full(len(posture), _STEP) for k in range(posture.shape[1])}
        return self._derivatives(theta, posture, step, lambda moved: inputs._replace(posture=moved))

    def _derivatives(
        self, theta: Floats, values: Floats, steps: dict[int, Floats], moved: Callable[[jax.Array], LoadCaseInput]
    ) -> Floats:
        """(cases, 6, k) change of every reading by columns of an input (cases, k), per `_STEP`; 0 by those that stay.

        Args:
            theta: (parameters,).
            values: the input's.
            steps: (cases,) by which a column is moved.
            moved: the load cases with other values of that input.
        """
        now = self.readings(theta)
        out = np.zeros((*now.shape, values.shape[1]))
        for k, step in steps.items():
            other = values.copy()
            other[:, k] += step
            there = self.model.predict(moved(jax.device_put(other)), theta).reading
            out[:, :, k] = (np.asarray(there) - now) / _STEP
        return out

    def readings(self, theta: Floats) -> Floats:
        """(cases, 6) what the model predicts [N, N mm]."""
        return np.asarray(self.model.predict(self._pieces, theta).reading)

    @cached_property
    def _pieces(self) -> Pieces:
        """The load cases, made ready once for all predictions."""
        return self.model.pieces(self.observations.inputs)

    @cached_property
    def nuisances(self) -> Floats:
        """(n, k) columns of the rig's budget that the model has no parameter for.

        A clamp at the tip that resists twist carries a share of the abduction torque as Mx and My, one of each for
        every setting. What the tare missed at the tip has a moment.
        """
        size_N = self.model.budget.zero_tip_sd_N
        columns = [*self._clamp_twist(), *zero_moments(self.observations, self.places, self.rows, size_N)]
        return np.array(columns).T if columns else np.zeros((len(self.rows), 0))

    @cached_property
    def by_group(self) -> dict[str, Floats]:
        """(n, k) change of every reading per unit of each error by group of cases (see `GroupErrors`), by its name."""
        suture = np.asarray(self.model.values.suture)
        return by_group(self.observations, self.rows, suture, self._by_tension, self._by_angle)

    def _clamp_twist(self) -> list[Floats]:
        model, inputs, topology = self.model, self.observations.inputs, self.model.finger.topology
        carried, rotations = list(topology.reactions), list(topology.rotations)
        free = [c for c in (3, 4) if c not in carried]
        aside = [r for r in rotations if r not in {j.name for j in topology.joints}]
        if not free or not aside or not self.places.moment.any():
            return []
        jacobian = self._tips[0]
        torque = np.asarray(model.predict(inputs, self.problem.centre).torque)[:, rotations.index(aside[0])]
        setting, out = np.asarray(inputs.setting), []
        for c in free:
            wrench = np.zeros((len(torque), 6))
            wrench[:, c] = 1.0
            lever = np.swapaxes(jacobian[:, carried], 1, 2)
            wrench[:, carried] = -np.linalg.solve(lever, jacobian[:, c, :, None])[..., 0]
            change = self._as_read(CLAMP_SHARE * torque[:, None, None] * wrench[:, None])[:, 0]
            for k in np.unique(setting):
                column = (change * (setting == k)[:, None]).reshape(-1)[self.rows]
                if column.any():
                    out.append(column)
        return out


def session_of(
    model: Model, observations: Observations, plane: Plane | None = None, held: Collection[str] = ()
) -> Session:
    """Set up the model of a session.

    Args:
        model: with the candidates among its effects, all at their null.
        observations: of the session.
        plane: of the forces that count; by default what the finger's axes can predict.
        held: parameters of effects that the model has already; free throughout.

    Raises:
        SessionError: no identification case, or a reading without any uncertainty.
    """
    chosen = plane or model.finger.judged_in
    rows, fitted = _rows_of(observations, chosen)
    require_rows(rows[fitted])
    hung = np.asarray(observations.inputs.tension)[rows[fitted] // 6]
    if not hung.any():
        raise SessionError(
            "no weight hangs in any identification case",
            "a load on at least one tendon",
            "Give masses_g, or add cases that load a tendon",
        )
    known = observations.noise.variance[rows] > 0.0
    if not known.all():
        raise SessionError(
            "a reading states no uncertainty at all",
            "noise above zero in every component",
            "Give force_sd_N, or a budget with reading_sd_N",
        )
    stated = model.budget.tension_factor_case_sd
    problem = weighted_problem(model, observations, rows[fitted], np.eye(int(fitted.sum())), chosen, held)
    return Session(problem, rows, fitted, chosen, stated)


def _rows_of(observations: Observations, plane: Plane) -> tuple[Rows, Mask]:
    """Readings that count, and which of them are fitted.

    Forces of all cases and checks, and all moments at the tip; moments at the bone depend on a clamp point that nobody
    measures. In the sagittal plane x, y and Mz.
    """
    forces, moments = ([0, 1], [5]) if plane == "sagittal" else ([0, 1, 2], [3, 4, 5])
    known = observations.noise.variance.reshape(-1, 6) > 0.0
    rows, fitted = [], []
    for i, role in enumerate(observations.roles):
        components = [*forces, *(moments if observations.locations[i] == "tip" and role != "check" else [])]
        read = [c for c in components if np.isfinite(observations.wrench[i, c])]
        if role == "validation":
            read = [c for c in read if known[i, c]]
        rows += [6 * i + c for c in read]
        fitted += [role != "validation"] * len(read)
    return np.array(rows, dtype=np.intp), np.array(fitted, dtype=bool)
