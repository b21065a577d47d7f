"""Predicted against measured forces of a session."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fingertwin.client.exchange import Body, Exchange, reading
from fingertwin.client.figures import figure, model_of
from fingertwin.client.summaries import Floats, Summary, made, names, rmse_of, summary_of, vector, vector_or_none

if TYPE_CHECKING:
    import plotly.graph_objects as go

_AXES = ("x", "y", "z")


@dataclass(frozen=True, eq=False)
class ComparedCase:
    """A load case: what was read, and what the model says should have been read.

    Attributes:
        id: of the case.
        role: `identification`, which is fitted, or `validation`, which never is.
        posture: name of the posture.
        location: `tip` or `bone`.
        masses_g: weight hung on each tendon.
        measured_N, measured_sd_N, predicted_N, residual_N: (3,) in the mount's axes; NaN where unknown.
        measured_Nmm, predicted_Nmm: (3,) moment, None where the case has none.
        z: Mahalanobis norm of the residual.
    """

    id: str
    role: str
    posture: str
    location: str
    masses_g: Mapping[str, float]
    measured_N: Floats
    measured_sd_N: Floats
    predicted_N: Floats
    residual_N: Floats
    measured_Nmm: Floats | None
    predicted_Nmm: Floats | None
    z: float | None

    @property
    def tendons(self) -> str:
        """Loaded tendons, such as `FDP+FDS`."""
        return "+".join(sorted(name for name, mass in self.masses_g.items() if mass)) or "none"

    @classmethod
    def of(cls, body: Body) -> ComparedCase:
        """Of plain data."""
        forces = {key: vector(body[key]) for key in ("measured_N", "measured_sd_N", "predicted_N", "residual_N")}
        moments = {key: vector_or_none(body[key]) for key in ("measured_Nmm", "predicted_Nmm")}
        return made(cls, body, **forces, **moments)


@dataclass(frozen=True, eq=False)
class Comparison:
    """All load cases of a session under one model.

    Attributes:
        session: id of the session.
        model: a finger's name or a revision's id.
        cases: that were measured, in the session's order.
        summary: errors by `role/location`, such as `validation/tip`, in both planes.
        judged_in: plane that the model's axes can predict: `sagittal` or `space`.
        waiting, failed, excluded: cases that are not compared, and why.
        blinded: validation cases whose predictions are hidden until their bench closes the session.
        provenance: readings, corrections, model and software that it came from.
        body: the whole answer, as `fingertwin compare --json` gives it.
    """

    session: str
    model: str
    cases: tuple[ComparedCase, ...] = field(repr=False)
    summary: Summary = field(repr=False)
    judged_in: str
    waiting: Mapping[str, str]
    failed: Mapping[str, str]
    excluded: Mapping[str, str]
    blinded: tuple[str, ...]
    provenance: Mapping[str, Any] = field(repr=False)
    body: Body = field(repr=False)
    _exchange: Exchange = field(repr=False)
    _asked: str | None = field(repr=False)

    @classmethod
    def of(cls, exchange: Exchange, body: Body, asked: str | None) -> Comparison:
        """Of the service's answer; `asked` is the model by the name that it was asked for."""
        with reading("a comparison"):
            cases = tuple(ComparedCase.of(case) for case in body["cases"])
            blinded = names(body["blinded"])
            return made(
                cls,
                body,
                cases=cases,
                summary=summary_of(body["summary"]),
                blinded=blinded,
                body=body,
                _exchange=exchange,
                _asked=asked,
            )

    def rmse_N(self, group: str, plane: str | None = None) -> float:  # noqa: N802 - N is the unit
        """Return the RMSE of a group of load cases.

        Args:
            group: a key of `summary`, such as `validation/tip`.
            plane: `sagittal` or `space`; by default the one that the finger is judged in.

        Raises:
            InputError: there is no such group or plane.
        """
        return rmse_of(self.summary, group, plane or self.judged_in)

    def table(self) -> dict[str, NDArray[Any]]:
        """Return the cases by column, one entry a case; `pandas.DataFrame` takes it as it is.

        Forces are apart by component: `measured_x_N`, `measured_sd_x_N`, `predicted_x_N`, `residual_x_N` and so on.
        """
        cases = self.cases
        columns: dict[str, NDArray[Any]] = {
            key: np.array([getattr(case, key) for case in cases], dtype=np.str_)
            for key in ("id", "role", "posture", "location", "tendons")
        }
        columns["mass_g"] = np.array([sum(case.masses_g.values()) for case in cases], dtype=np.float64)
        for key in ("measured", "measured_sd", "predicted", "residual"):
            stacked = np.array([getattr(case, f"{key}_N") for case in cases], dtype=np.float64).reshape(-1, 3)
            columns |= {f"{key}_{axis}_N": stacked[:, i] for i, axis in enumerate(_AXES)}
        columns["z"] = np.array([case.z for case in cases], dtype=np.float64)
        return columns

    def plot(self, name: str = "scatter") -> go.Figure:
        """Return a figure of it, drawn by the service.

        Args:
            name: scatter (predicted against measured, identification cases), scatter_validation, vectors, bone, errors
                or z.
        """
        model = model_of(self._exchange, self._asked, self.model)
        return figure(self._exchange, f"comparison/{name}", session=self.session, model=model)
