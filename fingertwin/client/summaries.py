"""Parts that several answers share: errors in both planes, parameters, vectors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from daq.errors import InputError
from fingertwin.client.exchange import Body

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Made = TypeVar("Made", bound="DataclassInstance")
Floats = NDArray[np.float64]
PLANES = ("sagittal", "space")


@dataclass(frozen=True)
class Errors:
    """Errors of predicted against measured forces over some load cases (Synek et al. 2019, Eqs 6, 7).

    Attributes:
        cases: how many load cases.
        components: scalar force components, two or three a case.
        rmse_N: root mean square over the components; None, here and below, where there is no case.
        rmse_rel_pct: of the mean measured norm.
        magnitude_error_N: mean error of the magnitude.
        magnitude_error_pct: relative to each measured magnitude.
        direction_error_deg: mean unsigned angle.
        direction_cases: cases whose force stands out from its uncertainty.
    """

    cases: int
    components: int
    rmse_N: float | None
    rmse_rel_pct: float | None
    magnitude_error_N: float | None
    magnitude_error_pct: float | None
    direction_error_deg: float | None
    direction_cases: int

    @classmethod
    def of(cls, body: Body) -> Errors:
        """Of plain data."""
        return made(cls, body)


@dataclass(frozen=True)
class InPlanes:
    """Errors in the sagittal plane, as published, and in space."""

    sagittal: Errors
    space: Errors


Summary = Mapping[str, InPlanes]


def summary_of(body: Body | None) -> Summary:
    """Errors by `role/location`, such as `validation/tip`."""
    return {
        group: InPlanes(Errors.of(planes["sagittal"]), Errors.of(planes["space"]))
        for group, planes in (body or {}).items()
    }


def rmse_of(summary: Summary, group: str, plane: str) -> float:
    """Return the RMSE of a group of load cases in a plane [N]; NaN where it has no case that counts.

    Raises:
        InputError: there is no such group or plane.
    """
    if group not in summary:
        raise InputError(f"group {group!r}", f"one of {', '.join(summary) or 'none: no load case was compared'}")
    if plane not in PLANES:
        raise InputError(f"plane {plane!r}", f"one of {', '.join(PLANES)}")
    found: Errors = getattr(summary[group], plane)
    return np.nan if found.rmse_N is None else found.rmse_N


@dataclass(frozen=True)
class Parameter:
    """A parameter of a model, as fitted.

    Attributes:
        name: such as `worn_pulley.FDP`.
        value: in its unit.
        sd: its standard uncertainty; None where it is not known.
        unit: of value and uncertainty.
    """

    name: str
    value: float
    sd: float | None
    unit: str

    @classmethod
    def of(cls, body: Body) -> Parameter:
        """Of plain data."""
        return made(cls, body, sd=body.get("sd"))


def made(kind: type[Made], body: Body, /, **other: Any) -> Made:
    """Make a record of an answer: its fields by their names, and those that are given."""
    plain = {field.name: body[field.name] for field in fields(kind) if field.name not in other}
    return kind(**plain, **other)


def vector(values: Sequence[float | None]) -> Floats:
    """Return three components; NaN where one is unknown."""
    return np.array(values, dtype=np.float64)


def vector_or_none(values: Sequence[float | None] | None) -> Floats | None:
    """Return three components, or None where there are none."""
    return None if values is None else vector(values)


def names(values: Any) -> tuple[str, ...]:
    """Return a list of texts as a tuple."""
    return tuple(str(value) for value in values or ())
