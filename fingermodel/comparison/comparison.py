"""Predicted against measured forces: per load case and summarised (Synek et al. 2019, Eqs 6 and 7)."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.errors import InputError
from fingermodel.comparison.observations import Observations
from fingermodel.fingers import PLANES, Plane, require_plane
from fingermodel.model import Model

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CaseComparison:
    """One load case: what was read and what the model says the cell should have read.

    Forces in N and torques in N mm, in the mount's frame; `z` is the Mahalanobis norm of the force residual,
    `z_sagittal` that of its x and y alone.
    """

    id: str
    role: str
    posture: str
    location: str
    masses_g: dict[str, float]
    measured_N: Floats
    measured_sd_N: Floats
    predicted_N: Floats
    measured_Nmm: Floats | None
    predicted_Nmm: Floats | None
    z: float | None
    z_sagittal: float | None = None

    @property
    def residual_N(self) -> Floats:  # noqa: N802 - N is the unit
        """Measured less predicted force (3,) [N]."""
        return self.measured_N - self.predicted_N

    @property
    def muscles(self) -> str:
        """Loaded tendons, such as `FDP` or `FDP+FDS`."""
        return muscles_of(self.masses_g)

    def z_in(self, plane: Plane) -> float | None:
        """Mahalanobis norm of the force residual in a plane; None without any uncertainty.

        Raises:
            InputError: there is no such plane.
        """
        return self.z_sagittal if require_plane(plane) == "sagittal" else self.z

    def as_dict(self) -> dict[str, Any]:
        """Return the contract's case object."""
        return {
            "id": self.id,
            "role": self.role,
            "posture": self.posture,
            "location": self.location,
            "masses_g": self.masses_g,
            "measured_N": self.measured_N.tolist(),
            "measured_sd_N": self.measured_sd_N.tolist(),
            "predicted_N": self.predicted_N.tolist(),
            "residual_N": self.residual_N.tolist(),
            "measured_Nmm": None if self.measured_Nmm is None else self.measured_Nmm.tolist(),
            "predicted_Nmm": None if self.predicted_Nmm is None else self.predicted_Nmm.tolist(),
            "z": self.z,
            "z_sagittal": self.z_sagittal,
        }


@dataclass(frozen=True)
class ErrorSummary:
    """Errors over some load cases in one plane, as published.

    Attributes:
        cases: how many.
        components: scalar force components (2 or 3 a case).
        rmse_N: over the components (Eq 6).
        rmse_rel_pct: of the mean measured norm (Eq 7).
        magnitude_error_N: mean absolute difference of the norms of predicted and measured force.
        magnitude_error_pct: the same relative to each measured norm.
        direction_error_deg: mean unsigned angle, where the measured force stands out from its uncertainty.
        direction_cases: how many cases that is.
    """

    cases: int
    components: int
    rmse_N: float | None
    rmse_rel_pct: float | None
    magnitude_error_N: float | None
    magnitude_error_pct: float | None
    direction_error_deg: float | None
    direction_cases: int

    def as_dict(self) -> dict[str, Any]:
        """Return the contract's error summary."""
        return dict(self.__dict__)


@dataclass(frozen=True, repr=False)
class Comparison:
    """All load cases of a session under one model.

    Attributes:
        cases: measured and predicted, in the session's order.
        noise_assumed: whether any case states no uncertainty of its own, so that the budget's stands in.
        judged_in: plane whose forces the finger's axes can predict.
    """

    cases: tuple[CaseComparison, ...]
    noise_assumed: bool
    judged_in: Plane = "space"

    def __repr__(self) -> str:
        rmse = self.errors(self.judged_in).rmse_N
        return f"<Comparison of {len(self.cases)} load cases{'' if rmse is None else f': RMSE {rmse:.3g} N'}>"

    def select(
        self,
        role: str | None = None,
        location: str | None = None,
        muscles: str | None = None,
        posture: str | None = None,
    ) -> Comparison:
        """Return the cases that match everything given."""
        chosen = tuple(
            c
            for c in self.cases
            if (role is None or c.role == role)
            and (location is None or c.location == location)
            and (muscles is None or c.muscles == muscles)
            and (posture is None or c.posture == posture)
        )
        return replace(self, cases=chosen)

    def without(self, ids: Collection[str]) -> Comparison:
        """Return the cases that are none of these."""
        return replace(self, cases=tuple(c for c in self.cases if c.id not in ids))

    def errors(self, plane: str) -> ErrorSummary:
        """Summarise all cases in the `sagittal` plane or in `space`.

        Raises:
            InputError: there is no such plane.
        """
        return summarise(self.cases, PLANES[require_plane(plane)])

    def rmse_N(self, group: str, plane: Plane | None = None) -> float:  # noqa: N802 - N is the unit
        """Return the root mean square error [N] of the force components of a group of load cases (Eq 6).

        Args:
            group: `role/location`, such as `validation/tip`.
            plane: `sagittal` or `space`; by default the one that the finger is judged in.

        Raises:
            InputError: there is no such group or plane.
        """
        role, _, location = group.partition("/")
        error = self.select(role, location).errors(self.judged_in if plane is None else plane).rmse_N
        if error is None:
            groups = dict.fromkeys(f"{c.role}/{c.location}" for c in self.cases)
            raise InputError(f"no load case of {group}", f"one of {', '.join(groups) or 'none: no case is left'}")
        return error

    def table(self) -> dict[str, list[Any]]:
        """Return the cases by column, one entry a case; `pandas.DataFrame` takes it as it is.

        Forces [N] stand by component: `measured_x_N`, `measured_sd_x_N`, `predicted_x_N`, `residual_x_N` and so on.
        """
        cases = self.cases
        columns: dict[str, list[Any]] = {
            key: [getattr(c, key) for c in cases] for key in ("id", "role", "posture", "location", "muscles")
        }
        columns["mass_g"] = [sum(c.masses_g.values()) for c in cases]
        for key in ("measured_N", "measured_sd_N", "predicted_N", "residual_N"):
            for i, axis in enumerate("xyz"):
                columns[f"{key.removesuffix('_N')}_{axis}_N"] = [float(getattr(c, key)[i]) for c in cases]
        columns["z"] = [c.z for c in cases]
        return columns

    def both(self) -> dict[str, Any]:
        """Return the summaries of both planes."""
        return {plane: self.errors(plane).as_dict() for plane in PLANES}

    def summary(self) -> dict[str, Any]:
        """Summaries by role and location, keys `role/location`."""
        keys = dict.fromkeys((c.role, c.location) for c in self.cases)
        return {f"{role}/{location}": self.select(role, location).both() for role, location in keys}

    def by(self, what: str) -> dict[str, Any]:
        """Summaries by `muscles`, `posture` or `location`, with each role and location apart below them."""
        out = {}
        for key in dict.fromkeys(getattr(c, what) for c in self.cases):
            part = self.select(**{what: key})
            out[str(key)] = part.both() | part.summary()
        return out

    def as_dict(self) -> dict[str, Any]:
        """Return the contract's comparison, without schema."""
        return {
            "cases": [c.as_dict() for c in self.cases],
            "summary": self.summary(),
            "by_muscle": self.by("muscles"),
            "by_posture": self.by("posture"),
            "by_location": self.by("location"),
            "moments": self.moments(),
            "noise_assumed": self.noise_assumed,
        }

    def moments(self) -> dict[str, Any]:
        """RMSE of Mz [N mm] by role and location, where moments were read."""
        out: dict[str, Any] = {}
        for key in dict.fromkeys((c.role, c.location) for c in self.cases):
            rows = [
                (c.measured_Nmm[2] - c.predicted_Nmm[2], c.measured_Nmm[2])
                for c in self.select(*key).cases
                if c.measured_Nmm is not None and c.predicted_Nmm is not None and c.location == "tip"
            ]
            if rows:
                values = np.array(rows)
                out["/".join(key)] = {
                    "cases": len(rows),
                    "rmse_Mz_Nmm": rmse(values[:, 0]),
                    "mean_abs_Mz_Nmm": float(np.mean(np.abs(values[:, 1]))),
                }
        return out


def muscles_of(masses_g: Mapping[str, float]) -> str:
    """Name what is loaded: `FDP`, `FDP+FDS`, or `none`; alphabetical, in whatever order the weights were written."""
    return "+".join(sorted(m for m, mass in masses_g.items() if mass)) or "none"


def compare(model: Model, observations: Observations, theta: Floats | None = None) -> Comparison:
    """Compare a model's readings with the measured ones, case by case.

    Args:
        model: finger, budget and effects for the session's layout.
        observations: of the session.
        theta: (parameters,) fitted; by default the model before any fit.
    """
    reading = np.asarray(model.predict(observations.inputs, theta).reading)
    covariance = observations.case_covariance[:, :3, :3]
    residuals = observations.wrench[:, :3] - reading[:, :3]
    z, z_sagittal = _norms(residuals, covariance), _norms(residuals[:, :2], covariance[:, :2, :2])
    cases = []
    for i, role in enumerate(observations.roles):
        if role == "check":
            continue
        measured, predicted = observations.wrench[i], reading[i]
        torque_known = bool(np.isfinite(measured[3:]).all())
        # At the bone the clamp's point is not known, so the model has no moment to compare.
        has_prediction = torque_known and observations.locations[i] == "tip"
        cases.append(
            CaseComparison(
                id=observations.ids[i],
                role=role,
                posture=observations.postures[i],
                location=observations.locations[i],
                masses_g=observations.masses_g[i],
                measured_N=measured[:3],
                measured_sd_N=np.sqrt(np.diag(covariance[i])),
                predicted_N=predicted[:3],
                measured_Nmm=measured[3:] if torque_known else None,
                predicted_Nmm=predicted[3:] if has_prediction else None,
                z=z[i],
                z_sagittal=z_sagittal[i],
            )
        )
    return Comparison(tuple(cases), observations.noise_assumed, model.finger.judged_in)


def _norms(residuals: Floats, covariances: Floats) -> list[float | None]:
    """Mahalanobis norm of each residual (n, k) with its covariance (n, k, k), None without any uncertainty."""
    known = np.asarray((np.diagonal(covariances, axis1=1, axis2=2) > 0).all(axis=1))
    try:
        solved = np.linalg.solve(covariances[known], residuals[known, :, None])[:, :, 0]
    except np.linalg.LinAlgError:
        # Channels that say the very same: no direction is known better than the others by more than this.
        size, axes = np.linalg.eigh(covariances[known])
        floored = np.maximum(size, 1e-9 * size[:, -1:])
        solved = np.einsum("nij,nj,nkj,nk->ni", axes, 1.0 / floored, axes, residuals[known])
    norms = iter(np.sqrt((residuals[known] * solved).sum(axis=1)).tolist())
    return [next(norms) if one else None for one in known.tolist()]


def rmse(errors: Floats) -> float:
    """Return the root mean square of errors, each of one component of one case (Eq 6)."""
    return float(np.sqrt(np.mean(errors**2)))


def summarise(cases: Iterable[CaseComparison], components: int) -> ErrorSummary:
    """Summarise errors over the first `components` force components (2: sagittal, 3: space)."""
    rows = list(cases)
    if not rows:
        return ErrorSummary(0, 0, None, None, None, None, None, 0)
    measured = np.array([c.measured_N[:components] for c in rows])
    predicted = np.array([c.predicted_N[:components] for c in rows])
    sd = np.array([c.measured_sd_N[:components] for c in rows])
    norm, norm_predicted = np.linalg.norm(measured, axis=1), np.linalg.norm(predicted, axis=1)
    error = rmse(measured - predicted)
    magnitude = np.abs(norm_predicted - norm)
    some = norm > 0
    # A direction means something only where the force stands out: three standard uncertainties along itself.
    unit = measured / np.where(some, norm, 1.0)[:, None]
    along = np.sqrt(np.sum((unit * sd) ** 2, axis=1))
    clear = some & (norm >= 3.0 * along) & (norm_predicted > 0)
    cosine = np.sum(measured * predicted, axis=1)[clear] / (norm * norm_predicted)[clear]
    angle = np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0)))
    mean_norm = float(norm.mean())
    return ErrorSummary(
        cases=len(rows),
        components=len(rows) * components,
        rmse_N=error,
        rmse_rel_pct=100.0 * error / mean_norm if mean_norm > 0 else None,
        magnitude_error_N=float(magnitude.mean()),
        magnitude_error_pct=100.0 * float((magnitude[some] / norm[some]).mean()) if some.any() else None,
        direction_error_deg=float(angle.mean()) if clear.any() else None,
        direction_cases=int(clear.sum()),
    )
