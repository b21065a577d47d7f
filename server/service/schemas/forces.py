"""Forms of forces inside the finger: assigned to a measured session, or to a recorded movement."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import ConfigDict, Field, JsonValue

from server.service.schemas.common import Answered, Form, Plain, Shown, WarningOfCheck
from server.service.schemas.figures import FigureShown
from server.service.schemas.predictions import Angle, Name

MOST_STEPS = 2000
Closure = Literal["minimal", "chao", "least_squares"]


class Force(Shown):
    """A force with its standard deviation."""

    force_N: float
    sd_N: float
    hung_N: float | None = Field(description="What really pulled [N]; of a contact, what the model makes of that.")


class InvertedCase(Shown):
    """Forces that a closure assigns to one load case."""

    id: str
    role: str
    posture: str
    masses_g: dict[str, float]
    muscles: dict[str, Force]
    slips: dict[str, Force] = Field(description="Every tendon and slip of the hood.")
    contacts: dict[str, Force] = Field(description="Magnitude by joint.")
    pushes: list[str] = Field(description="Muscles that are asked to push, which none can.")
    unread: list[str] = Field(description="Of what the clamp carries, what was not read and may be anything.")
    unbalanced_Nmm: float = Field(description="Norm of the torque that no tensions that pull can make.")


class InvertedMuscle(Shown):
    """Performance of the closure on one muscle over the cases."""

    name: str
    merged: list[str] = Field(description="The finger's muscles that it stands for.")
    rms_error_N: float = Field(description="Root mean square of assigned less hung.")
    within_2sd: int = Field(description="Cases in which the two differ by at most two standard deviations.")
    pushes: int
    pushes_beyond_2sd: int


class Inverted(Shown):
    """Muscle and joint contact forces of every case at the tip, beside the weights that really hung."""

    schema_: str = Field(alias="schema", examples=["fingertwin/invert/1"])
    session: str
    model: str
    warnings: list[WarningOfCheck]
    amendments: list[Plain] = Field(description="What load cases really were, beside what was entered.")
    excluded: dict[str, str] = Field(description="Cases left out, and why.")
    closure: str
    closure_title: str
    cases: list[InvertedCase]
    muscles: list[InvertedMuscle]
    found: int = Field(description="Cases in which every muscle's load is found within two standard deviations.")
    left_out: list[str] = Field(description="Cases at the tip that were not read in full.")
    inversion_notes: list[str]
    sentences: list[str] = Field(description="What came of it.")
    figures: list[FigureShown]


class AskedMovement(Form):
    """A movement, the finger that makes it, and its muscles."""

    model_config = ConfigDict(json_schema_extra={"example": {"motion": "wu2008_tap", "steps": 50}})

    motion: Annotated[str, Field(max_length=100, description="A shipped movement.")] = "wu2008_tap"
    document: Annotated[
        dict[str, JsonValue] | None, Field(description="Or a movement of one's own: motion/1, as its YAML file has it.")
    ] = None
    finger: Annotated[str, Field(max_length=100, description="Of GET /api/v1/fingers, one that `moves`.")] = (
        "wu2008_index"
    )
    muscles: Annotated[str, Field(max_length=100, description="A shipped muscle set.")] = "wu2008"
    steps: Annotated[int, Field(ge=2, le=MOST_STEPS, description="Instants over the movement.")] = 200


class Moved(Shown):
    """Joint torques and muscle forces over a movement."""

    schema_: str = Field(alias="schema", examples=["fingertwin/move/1"])
    motion: str
    finger: str
    muscle_set: str
    rotations: list[str]
    muscles: list[str]
    contact_s: list[float] | None = Field(description="First and last time of contact [s]; null without.")
    peaks: list[Plain] = Field(description="Of each muscle: peak_N, at_s, passive_share, over_tip_force.")
    times_s: list[float]
    tip_force_N: list[list[float]] = Field(description="On the finger, axes of the first bone.")
    torque_Nmm: dict[str, list[float]] = Field(description="By rotation, flexion positive.")
    force_N: dict[str, list[float]] = Field(description="By muscle, active and passive together.")
    figures: list[FigureShown]


class MovementChoices(Answered):
    """Choices for a movement."""

    motions: list[str]
    muscles: list[str]
    fingers: list[str] = Field(description="Those whose bones have inertia.")


Share = Annotated[float, Field(ge=0.0, le=1.0)]


class AskedActivation(Form):
    """A finger that is held at the tip, and how far its muscles are active; by default all of them fully."""

    model_config = ConfigDict(json_schema_extra={"example": {"finger": "barry2018_index", "lost": {"FDI": 0.5}}})

    finger: Annotated[str, Field(max_length=100, description="Of GET /api/v1/fingers, one that `activates`.")] = (
        "barry2018_index"
    )
    muscles: Annotated[
        str | None, Field(max_length=100, description="A shipped muscle set; by default the one named like the finger.")
    ] = None
    posture_deg: Annotated[
        dict[Name, Angle],
        Field(default_factory=dict, max_length=20, description="Angles that differ from the default posture [deg]."),
    ]
    activation: Annotated[
        dict[Name, Share] | None,
        Field(max_length=40, description="Share of full activation by muscle; those not named rest."),
    ] = None
    force_N: Annotated[
        dict[Name, Annotated[float, Field(ge=0.0, le=1000.0)]] | None,
        Field(max_length=6, description="Instead: tip force by direction (palmar, dorsal, radial, …) [N]."),
    ] = None
    lost: Annotated[
        dict[Name, Share],
        Field(default_factory=dict, max_length=40, description="Share of its activation that each muscle loses."),
    ]


class Deficit(Shown):
    """Tip force while one muscle loses its activation."""

    muscle: str
    levels_pct: list[float] = Field(description="Of its activation [%].")
    force_N: list[list[float]]
    magnitude_N: list[float]
    magnitude_change_pct: list[float | None]
    direction_change_deg: list[float | None]


class Activated(Shown):
    """A held finger with its muscles active, and what deficits of each change."""

    schema_: str = Field(alias="schema", examples=["fingertwin/activate/1"])
    finger: str
    muscle_set: str
    posture_deg: dict[str, float]
    activation: dict[str, float] = Field(description="Share by muscle, heads apart.")
    tension_N: dict[str, float]
    force_N: list[float] = Field(description="On the clamp: proximal, dorsal, radial.")
    magnitude_N: float
    alone: list[Plain] = Field(description="Tip force of each muscle alone, fully active [N], in space and by plane.")
    deficits: list[Deficit]
    together: Plain | None = Field(description="All of `lost` at once; null where nothing was.")
    activation_notes: list[str]
    figures: list[FigureShown]
