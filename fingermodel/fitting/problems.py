"""What is minimised in a refit: which readings, with which covariance, over which parameters with which priors."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from daq.errors import SessionError
from fingermodel.comparison.observations import Observations
from fingermodel.fingers import Plane, require_plane
from fingermodel.model import Model
from fingermodel.stages import LoadCaseInput
from fingermodel.structure import Pieces

Floats = NDArray[np.float64]

# Weights of Eq 5 on normalised coordinates (Synek et al. 2019, p. 9).
EQ5_WEIGHT = {"DIP": 10.0, "PIP": 10.0, "MCP": 1.0}


# Load cases that are differentiated at once: what that takes grows with their number.
DIFFERENTIATED = 40


class Whitener(Protocol):
    """What makes readings independent and of variance 1."""

    def __matmul__(self, other: Floats) -> Floats:
        """Whiten a vector (n,) or columns (n, k)."""
        ...


@dataclass(frozen=True, eq=False)
class Differentiated:
    """Readings whose slopes are asked for.

    Attributes:
        cases: that they are of.
        at: (rows,) where each stands in the flattened (cases, 6) wrench of these.
        own: (rows, own) of each one's load case, as of `Compact.own_of`.
    """

    cases: Pieces
    at: NDArray[np.intp]
    own: NDArray[np.intp]

    @classmethod
    def of(cls, model: Model, inputs: LoadCaseInput, rows: NDArray[np.intp]) -> Differentiated:
        """Pick rows (n,) of the flattened (cases, 6) wrench out of all readings."""
        used, case = np.unique(rows // 6, return_inverse=True)
        cases = Pieces.of(model.compact, inputs.rows(used), DIFFERENTIATED)
        return cls(cases, 6 * case + rows % 6, model.compact.own_of(inputs)[rows // 6])


@dataclass(frozen=True, eq=False)
class FittedReadings:
    """Only the cases that are fitted: the others would be differentiated for nothing.

    Attributes:
        of: rows, observations and finger that these are made of.
        every_case: all cases, to be predicted.
        differentiated: readings that are fitted.
        measured: (rows,) [N, N mm].
    """

    of: tuple[object, ...]
    every_case: Pieces
    differentiated: Differentiated
    measured: Floats

    @classmethod
    def of_problem(cls, problem: Problem) -> FittedReadings:
        """Pick them out of all readings."""
        rows, observations = problem.rows, problem.observations
        return cls(
            problem.source,
            problem.model.pieces(observations.inputs),
            Differentiated.of(problem.model, observations.inputs, rows),
            np.nan_to_num(observations.wrench).reshape(-1)[rows],
        )


@dataclass(frozen=True, eq=False)
class Problem:
    """A weighted least-squares problem with priors over the parameters of a model.

    Attributes:
        model: whose parameters they are.
        observations: whose cases they are.
        rows: (residuals,) indices into the flattened (cases, 6) wrench.
        whitener: makes the residuals independent with unit variance (or unit weight, Eq 5).
        weighted: whether the objective counts in standard uncertainties (Eq 5 does not).
        start: (parameters,).
        centre: (parameters,) of the priors.
        sd: (parameters,) of the priors, inf where flat.
        lower: (parameters,).
        upper: (parameters,).
        free: (parameters,) bool.
    """

    model: Model
    observations: Observations
    rows: NDArray[np.intp]
    whitener: Whitener
    weighted: bool
    start: Floats
    centre: Floats
    sd: Floats
    lower: Floats
    upper: Floats
    free: NDArray[np.bool_]
    _fitted: list[FittedReadings] = field(default_factory=list, repr=False, compare=False)

    @property
    def fitted_readings(self) -> FittedReadings:
        """What the solver takes; made once for all problems that differ in what is free."""
        if not self._fitted or any(a is not b for a, b in zip(self._fitted[0].of, self.source, strict=True)):
            self._fitted[:] = [FittedReadings.of_problem(self)]
        return self._fitted[0]

    @property
    def source(self) -> tuple[object, ...]:
        """What the fitted readings follow from."""
        return self.rows, self.observations, self.model.finger

    @property
    def scale(self) -> Floats:
        """Natural step of each parameter: its prior's width, or a tenth of its range where the prior is flat."""
        span = np.where(np.isfinite(self.upper - self.lower), self.upper - self.lower, 10.0)
        scale = np.where(np.isfinite(self.sd) & (self.sd > 0), self.sd, span / 10.0)
        return np.where(scale > 0, scale, 1.0)

    @property
    def weight(self) -> Floats:
        """Prior precision in scaled coordinates."""
        return np.where(np.isfinite(self.sd), 1.0, 0.0)


def weighted_problem(
    model: Model,
    observations: Observations,
    rows: NDArray[np.intp],
    whitener: Whitener,
    plane: Plane,
    effects: Collection[str] = (),
) -> Problem:
    """All parameters with the budget's priors and bounds, for some readings with a covariance of their own.

    Args:
        model: finger, budget and effects.
        observations: of one session.
        rows: (residuals,) indices into the flattened (cases, 6) wrench.
        whitener: of these readings.
        plane: which force components count.
        effects: names of the effects' parameters that are free; all others stay at their null.

    Raises:
        InputError: there is no such plane.
    """
    table = model.parameters
    free = table.free & (~table.of_kind("effect") | np.isin(table.names, list(effects)))
    return Problem(
        model=model,
        observations=observations,
        rows=rows,
        whitener=whitener,
        weighted=True,
        start=table.centre.copy(),
        centre=table.centre,
        sd=table.sd,
        lower=table.lower,
        upper=table.upper,
        free=free & ~out_of_plane(model) if require_plane(plane) == "sagittal" else free,
    )


def out_of_plane(model: Model) -> NDArray[np.bool_]:
    """Parameters that move only what a sagittal fit does not look at, or leak the unpredicted Fz into it."""
    sideways = [r for r in model.finger.topology.rotations if r not in {j.name for j in model.finger.topology.joints}]
    out = []
    for name in model.parameters.names:
        group, _, rest = name.partition(".")
        last = rest.rpartition(".")[2]
        out.append(
            (group in ("point", "zero", "mount_offset", "zero_offset", "tare_drift") and last == "z")
            or group == "axis_tilt"
            or (group == "cell_crosstalk" and "Fz" in rest)
            or (group == "suture_angle" and last == "frontal")
            or (group in ("mounting_rotation", "cell_rotation") and last in ("x", "y"))
            or (group == "posture_angle" and last in sideways)
            or (group == "cell_gain" and last in ("Fz", "Tx", "Ty"))
        )
    return np.array(out)


def eq5_problem(model: Model, observations: Observations) -> Problem:
    """The published objective (Eq 5): squared forces in the x-y plane and a penalty on x and y of the tendon points.

    The hood's fractions have no penalty; those that the published study fixed stay fixed.
    """
    fitted = [6 * i + c for i, role in enumerate(observations.roles) if role != "validation" for c in (0, 1)]
    rows = np.array([row for row in fitted if np.isfinite(observations.wrench.flat[row])], dtype=np.intp)
    require_rows(rows)
    table, unit = model.parameters, model.finger.length_unit_mm
    sd = np.zeros(len(table))
    fixed = {
        f"fraction.{name}"
        for name, prior in zip(model.finger.topology.fractions, model.finger.fraction_priors, strict=True)
        if prior.sd == 0
    }
    for i, name in enumerate(table.names):
        if name.startswith("point.") and not name.endswith(".z"):
            sd[i] = unit / np.sqrt(EQ5_WEIGHT.get(name.split(".")[1], 1.0))
        elif name.startswith("fraction.") and name.endswith("_ES") and name not in fixed:
            sd[i] = np.inf
    return Problem(
        model=model,
        observations=observations,
        rows=rows,
        whitener=np.eye(len(rows)),
        weighted=False,
        start=table.centre.copy(),
        centre=table.centre,
        sd=sd,
        lower=table.lower,
        upper=table.upper,
        free=sd > 0,
    )


def require_rows(rows: NDArray[np.intp]) -> None:
    """Refuse a session in which nothing is fitted.

    Raises:
        SessionError: no identification case.
    """
    if len(rows) == 0:
        raise SessionError(
            "no case with the role identification",
            "at least one to fit to",
            "Give cases role: identification; validation cases are never fitted",
        )


def objective_at(problem: Problem, theta: Floats) -> float:
    """Objective of a parameter vector: weighted squared residuals plus the priors' penalty."""
    residual = residual_at(problem, theta)
    z = (theta - problem.centre) / problem.scale
    penalty = float(np.sum(problem.weight[problem.free] * z[problem.free] ** 2))
    return float(residual @ residual) + penalty


def residual_at(problem: Problem, theta: Floats) -> Floats:
    """Whitened residuals (residuals,) of a parameter vector."""
    reading = np.asarray(problem.model.predict(problem.observations.inputs, theta).reading).reshape(-1)
    wrench = np.nan_to_num(problem.observations.wrench).reshape(-1)
    out: Floats = problem.whitener @ (wrench - reading)[problem.rows]
    return out
