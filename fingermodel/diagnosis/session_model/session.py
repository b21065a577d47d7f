"""One bench session as a generative model: readings, their noise by case, and what disturbs them beside any effect.

    y = f(θ, φ) + F ε + K τ + L υ + s R η + e_case + e

Readings are fitted (identification cases and checks) or only predicted (validation cases). Noise, scatter and bad cases
are independent by case; everything else is a column with a Gaussian weight.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from daq.errors import SessionError
from fingermodel.arrays import Floats, Ints, Mask
from fingermodel.comparison.observations import Observations
from fingermodel.diagnosis.session_model.bad_cases import bad_size
from fingermodel.diagnosis.session_model.case_noise import CaseErrors, CaseNoise, Scatter
from fingermodel.diagnosis.session_model.group_errors import GroupErrors
from fingermodel.diagnosis.session_model.reading_changes import LinearisedErrors, ReadingChanges
from fingermodel.diagnosis.session_model.whitening import NoiseWhitening, Whitened, is_smooth
from fingermodel.fingers import Plane, require_plane
from fingermodel.fitting.problems import Problem, require_rows, weighted_problem
from fingermodel.fitting.roots import root_of
from fingermodel.model import Model

# Share of the loads that a heavy one exceeds.
_HEAVY = 0.9
# Loads that differ by less are alike, relative.
_ALIKE = 0.05


@dataclass(frozen=True, eq=False)
class Session:
    """A session's readings with all that acts on them beside the model."""

    problem: Problem  # which readings are fitted, over which parameters with which priors; its noise is as measured
    rows: Ints  # (n,) indices into the flattened (cases, 6) wrench of fitted and validation readings
    fitted: Mask  # (n,) which of them are fitted
    plane: Plane  # of the force components that count
    stated_scatter: float  # of the tensions from case to case, by the session or its budget; 0 where none is stated
    changes: ReadingChanges  # of the readings by what disturbs them
    errors: LinearisedErrors  # of tensions and of groups of cases, about some finger

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

    def columns(self, block: str) -> Floats:
        """(n, k) columns of a block of weights that are no parameters.

        Args:
            block: `budget`, an error by group (see `GroupErrors`), or something smooth (see `ReadingChanges.smooth`);
                any other has none.
        """
        if is_smooth(block):
            return self.changes.smooth(block)
        if block in GroupErrors._fields:
            return self.errors.by_group[block]
        return self.changes.nuisances if block == "budget" else np.zeros((len(self.rows), 0))

    def seen_from(self, theta: Floats) -> Session:
        """The same with its errors linearised about a parameter vector (parameters,)."""
        return replace(self, errors=LinearisedErrors(self.changes, theta))

    def without(self, gone: Mask) -> Session:
        """The same without some of the fitted readings (n,)."""
        kept = self.fitted.copy()
        kept[np.flatnonzero(self.fitted)[gone]] = False
        return replace(self, fitted=kept)

    @cached_property
    def fitted_noise(self) -> CaseNoise:
        """By case, of the fitted readings."""
        return self.noise_of(self.fitted)

    def noise_of(self, chosen: Mask) -> CaseNoise:
        """By case, of some readings (n,)."""
        places = self.changes.places
        moment, measured = places.moment[chosen], self.measured[chosen]
        pulled_N = np.asarray(self.observations.inputs.tension).sum(axis=1)
        # Some cases may have been entered with far too much.
        usual_N = float(np.quantile(pulled_N[pulled_N > 0.0], _HEAVY)) if pulled_N.any() else 0.0
        size = bad_size(moment, measured, pulled_N[self.rows[chosen] // 6], usual_N)
        own, assumed = self.observations.noise.alone, self.observations.noise_assumed
        scatter = Scatter(self.errors.by_tension[chosen], self.changes.by_stated_angle[chosen])
        return CaseNoise.of(own, self.rows[chosen], scatter, places.unit[chosen], size, assumed)

    def whitened_smooth(self, errors: CaseErrors, bad: frozenset[int]) -> Whitened:
        """The fitted readings' noise, and smooth columns under it; kept, since every explanation asks for them."""
        # Columns are many times as large as their inner products, and made again in no time.
        for kept in self._kept.values():
            kept.columns.clear()
        key = (errors, bad)
        if key not in self._kept:
            tares = self.changes.tares[self.fitted]
            whitening = NoiseWhitening.of(*self.fitted_noise.whitening(*key), tares)
            changes, fitted = self.changes, self.fitted
            self._kept[key] = Whitened(whitening, lambda block: changes.smooth(block)[fitted])
        return self._kept[key]

    def drawn_noise(self, errors: CaseErrors, rng: np.random.Generator) -> Floats:
        """Draw errors of the fitted readings (n,): noise and scatter of these sizes, and tares."""
        tares = self.changes.tares[self.fitted]
        z = rng.standard_normal(len(tares))
        out: Floats = tares @ rng.standard_normal(tares.shape[1])
        for rows, blocks in self.fitted_noise.covariances(errors, ()):
            out[rows] += (root_of(blocks) @ z[rows][..., None])[..., 0]
        return out

    def forget(self) -> None:
        """Let go of what is smooth, whitened or not; what is asked of it again is made again."""
        self.changes.forget()
        self._kept.clear()

    @cached_property
    def _kept(self) -> dict[tuple[CaseErrors, frozenset[int]], Whitened]:
        return {}

    @cached_property
    def groups_shown(self) -> frozenset[str]:
        """Errors by group of cases (see `GroupErrors`) that the fitted readings can show."""
        columns = self.errors.by_group_among(self.fitted)
        return frozenset(name for name, changes in columns.items() if changes.any())

    @cached_property
    def unlike_fitted(self) -> frozenset[int]:
        """Validation cases in a posture, with tendons loaded together, or under a load that no fitted case has."""
        tension, fitted, unseen = np.asarray(self.observations.inputs.tension), self.fitted_cases, self._unseen_cases
        loads, most = {tuple(tension[i] > 0.0) for i in fitted}, tension[fitted].max(axis=0) * (1.0 + _ALIKE)
        strange = np.array([tuple(tension[i] > 0.0) not in loads or bool((tension[i] > most).any()) for i in unseen])
        return frozenset(unseen[strange | self._in_new_posture].tolist())

    @cached_property
    def beyond_fitted(self) -> Mask:
        """(cases,) validation cases in a posture that no fitted case has, or not as loaded as any fitted one."""
        out, unseen = np.zeros(len(self.observations.ids), dtype=bool), self._unseen_cases
        out[unseen] = self._in_new_posture | ~self.as_loaded(unseen).any(axis=1)
        return out

    def as_loaded(self, cases: Ints) -> Mask:
        """(cases, fitted cases) which fitted ones load the same tendons together at the same mount, as much or more."""
        tension, fitted = np.asarray(self.observations.inputs.tension), self.fitted_cases
        alike = self.load_sets[cases, None] == self.load_sets[fitted]
        return np.asarray(alike & (tension[cases, None] <= tension[fitted] * (1.0 + _ALIKE)).all(axis=2))

    @cached_property
    def fitted_cases(self) -> Ints:
        """(fitted cases,) indices of the cases of which readings are fitted."""
        return np.unique(self.rows[self.fitted] // 6)

    @property
    def _unseen_cases(self) -> Ints:
        return np.unique(self.rows[~self.fitted] // 6)

    @property
    def _in_new_posture(self) -> Mask:
        """(validation cases,) whether no fitted case is in their posture."""
        postures = np.array(self.observations.postures)
        return ~np.isin(postures[self._unseen_cases], postures[self.fitted_cases])

    @cached_property
    def load_sets(self) -> Ints:
        """(cases,) numbers of the sets of tendons that are loaded together at one mount."""
        inputs = self.observations.inputs
        loads = np.column_stack([np.asarray(inputs.tension) > 0.0, np.asarray(inputs.at_bone)])
        return np.unique(loads, axis=0, return_inverse=True)[1].astype(np.intp)


def session_of(
    model: Model,
    observations: Observations,
    plane: Plane | None = None,
    held: Collection[str] = (),
    counted: tuple[Ints, Mask] | None = None,
) -> Session:
    """Set up the model of a session.

    Args:
        model: with the candidates among its effects, all at their null.
        observations: of the session.
        plane: of the forces that count; by default what the finger's axes can predict.
        held: parameters of effects that the model has already; free throughout.
        counted: `rows` and `fitted` of the session; by default those that the observations show.

    Raises:
        SessionError: no identification case, or a reading without any uncertainty.
        InputError: there is no such plane.
    """
    chosen = model.finger.judged_in if plane is None else require_plane(plane)
    rows, fitted = counted or _rows_of(observations, chosen)
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
    changes = ReadingChanges(model, observations.inputs, observations, problem.centre, rows)
    return Session(problem, rows, fitted, chosen, stated, changes, LinearisedErrors(changes))


def _rows_of(observations: Observations, plane: Plane) -> tuple[Ints, Mask]:
    """Readings that count, and which of them are fitted.

    Forces of all cases and checks, and all moments at the tip; moments at the bone depend on a clamp point that nobody
    measures. In the sagittal plane x, y and Mz.
    """
    forces, moments = ([0, 1], [5]) if plane == "sagittal" else ([0, 1, 2], [3, 4, 5])
    roles, at_tip = np.array(observations.roles), np.array(observations.locations) == "tip"
    unseen, counts = roles == "validation", np.zeros(observations.wrench.shape, dtype=bool)
    counts[:, forces] = True
    counts[np.ix_(at_tip & (roles != "check"), moments)] = True
    counts &= np.isfinite(observations.wrench)
    counts[unseen] &= observations.noise.variance.reshape(-1, 6)[unseen] > 0.0
    rows = np.flatnonzero(counts)
    return rows, ~unseen[rows // 6]
