"""Forms of predictions and comparisons."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import ConfigDict, Field, model_validator

from daq.vocabulary import LARGEST_FACTOR
from fingermodel.predicting import ANGLE_DEG, GRAVITY_M_S2, MOST_LOAD
from server.service.schemas.common import Answered, Form, Plain, Shown, Summary, Vector, WarningOfCheck

MOST_ROWS = 100_000
# Far beyond any mass in g and tension in N, and far from where sums overflow.
Number = Annotated[float, Field(ge=-MOST_LOAD, le=MOST_LOAD)]
Angle = Annotated[float, Field(ge=ANGLE_DEG[0], le=ANGLE_DEG[1])]
Name = Annotated[str, Field(max_length=60)]
Column = Annotated[list[Number], Field(min_length=1, max_length=MOST_ROWS)]
Columns = Annotated[dict[Name, Column], Field(max_length=40)]
Angles = Annotated[list[Angle], Field(min_length=1, max_length=MOST_ROWS)]


class Asked(Form):
    """Load cases to predict, by column: row i of each column is load case i; a column of one number holds for all."""

    model: Annotated[
        str,
        Field(max_length=200, description="A finger's name or a revision's id.", examples=["an1979_middle"]),
    ] = "an1979_middle"
    postures_deg: Annotated[
        dict[Name, Angles],
        Field(
            max_length=40,
            description="Angle of each joint [deg], flexion positive. An abduction that is left out is 0.",
        ),
    ]
    masses_g: Annotated[Columns | None, Field(description="Weight hung on each tendon [g].")] = None
    tensions_N: Annotated[Columns | None, Field(description="Or the tension in each tendon [N].")] = None
    tension_factor: Annotated[
        float,
        Field(
            gt=0,
            le=LARGEST_FACTOR,
            description="Friction correction c: tension = c m g; of masses alone. A session states its own.",
        ),
    ] = 1.0
    gravity_m_s2: Annotated[float, Field(ge=GRAVITY_M_S2[0], le=GRAVITY_M_S2[1])] = 9.81

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    @model_validator(mode="after")
    def _one_of_two(self) -> Asked:
        if (self.masses_g is None) == (self.tensions_N is None):
            raise ValueError("give masses_g or tensions_N, and not both")
        return self


class Predicted(Answered):
    """Forces that the finger exerts on what holds it: x proximal, y dorsal, z radial."""

    model: str
    n: int = Field(description="Load cases.")
    tip_force_N: list[Vector] = Field(description="In the distal phalanx's axes [N].")
    tip_moment_Nmm: list[Vector] = Field(description="About the load point in the mid pulp [N mm].")
    bone_force_N: list[Vector] = Field(description="In the metacarpal's axes [N].")
    undetermined: list[int] = Field(description="Rows whose finger is straight: their forces are null.")


class Friction(Answered):
    """Friction factor by force balance, as `fingertwin friction --json`."""

    cases: list[Plain] = Field(description="Factor of each pair of cases.")
    specimens: list[Plain] = Field(description="Mean of each specimen.")
    pooled: Plain = Field(description="Mean over specimens, clustered by them.")
    warnings: list[WarningOfCheck]


class ComparedCase(Shown):
    """A load case: what was read and what the model says should have been read."""

    id: str
    role: str
    posture: str
    location: str
    masses_g: dict[str, float]
    measured_N: Vector
    measured_sd_N: Vector
    predicted_N: Vector
    residual_N: Vector
    measured_Nmm: Vector | None
    predicted_Nmm: Vector | None
    z: float | None = Field(description="Mahalanobis norm of the residual.")


class Compared(Answered):
    """Predicted against measured, as `fingertwin compare --json`, with what it came from."""

    session: str
    model: str
    outdated: bool = Field(description="Whether the session was changed since the model was fitted to it.")
    warnings: list[WarningOfCheck]
    cases: list[ComparedCase]
    summary: Summary = Field(description="Errors by role and location.")
    by_muscle: dict[str, Any]
    by_posture: dict[str, Any]
    waiting: dict[str, str] = Field(description="Cases whose readings are not all there, and what is missing.")
    failed: dict[str, str] = Field(description="Cases that could not be measured, and why.")
    excluded: dict[str, str] = Field(description="Cases left out, and why.")
    blinded: list[str] = Field(description="Validation cases that are hidden until the bench closes the session.")
    provenance: Plain = Field(description="Readings, corrections, model and software that it came from.")
