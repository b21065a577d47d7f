"""Forms of fingers: parameter sets of the model, and what they are exchanged as."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import ConfigDict, Field

from server.service.schemas.common import Answered, Form, Plain, Shown
from server.service.schemas.figures import FigureShown
from server.service.web.examples import EXAMPLES


class FingerShown(Shown):
    """A finger: bones, joints, tendons, what it is judged in."""

    name: str
    id: str
    title: str
    bones: list[str] = Field(description="From the one that is clamped.")
    joints: list[str] = Field(description="Angles, as postures name them.")
    tendons: list[str]
    judged_in: str = Field(description="sagittal or space.")
    moves: bool = Field(description="Whether its bones have inertia, so that movements can be worked out.")
    activates: bool = Field(description="Whether a muscle set of its name is shipped, so that it can be activated.")


class FingerRead(FingerShown, Answered):
    """A finger with every number and its source."""

    model_config = ConfigDict(
        json_schema_extra={
            "example": EXAMPLES["FingerShown"] | {"schema": "fingertwin/finger/1", "document": {"format": "finger/1"}}
        }
    )

    document: Plain = Field(description="finger/1.")


class FingerList(Answered):
    """Fingers that come with the software."""

    fingers: list[FingerShown]


class FingerFormat(Shown):
    """A format that a finger can be exported to."""

    format: str = Field(description="osim (OpenSim 4), mjcf (MuJoCo) or finger (finger/1, YAML).")
    file: str = Field(description="Its name.")
    notes: list[str] = Field(description="What the format cannot say of this finger.")


class FingerFormats(Answered):
    """The formats that a finger can be exported to."""

    formats: list[FingerFormat]


class FingerImport(Form):
    """A finger as OpenSim (.osim) or MuJoCo (MJCF, .xml) has it."""

    name: Annotated[
        str,
        Field(
            min_length=5,
            max_length=120,
            pattern=r"^[A-Za-z0-9][A-Za-z0-9 ._()-]*\.(osim|xml|mjcf)$",
            description="Of the file; its ending says which format it is.",
            examples=["theirs.osim"],
        ),
    ]
    text: Annotated[str, Field(max_length=4 << 20, description="The file's content.")]
    load_point_mm: Annotated[
        list[float] | None,
        Field(
            min_length=3,
            max_length=3,
            description="Where the clamp holds the last bone, in its own axes [mm]; instead of the file's.",
        ),
    ] = None


class ImportCheck(Shown):
    """Moment arms of an imported finger held against those of the engine that the file was made for."""

    engine: str = Field(examples=["MuJoCo 4.0.0"])
    postures: int = Field(description="Drawn at random, and along each angle.")
    between: str = Field(description="Of which angles.")
    worst_mm: dict[str, float] = Field(description="Greatest error of each tendon's moment arms [mm].")


class FingerImported(Answered):
    """A finger that was read out of another software's file. The service does not keep it."""

    id: str
    bones: list[str]
    rotations: list[str] = Field(description="Angles, as postures name them.")
    segments: list[str] = Field(description="Tendon segments.")
    reactions: list[str] = Field(description="What the tip clamp carries.")
    notes: list[str] = Field(description="What was taken how, and what the file does not say.")
    read: str = Field(description="What was read of the file.")
    check: ImportCheck | None = Field(description="Against the engine's moment arms; null where it is not installed.")
    document: Plain = Field(description="finger/1.")
    file: str = Field(description="The same as YAML, to be saved and used as any finger file.")


Length = Annotated[float, Field(gt=0.0, le=1000.0)]
_MEASURES: dict[str, Any] = {"max_length": 20}


class AskedScaling(Form):
    """A specimen's sizes, to which a finger is scaled."""

    model_config = ConfigDict(json_schema_extra={"example": {"bones_mm": {"PP": 40.1, "MP": 25.2}, "name": "H07"}})

    bones_mm: Annotated[
        dict[Annotated[str, Field(max_length=60)], Length],
        Field(min_length=1, description="Length of its phalanges [mm]; the others scale by their mean.", **_MEASURES),
    ]
    moment_arms_mm: Annotated[
        dict[Annotated[str, Field(max_length=60)], Annotated[float, Field(ge=-100.0, le=100.0)]],
        Field(
            default_factory=dict,
            description="Mean flexion moment arm by tendon and joint, such as FDP@MCP [mm].",
            **_MEASURES,
        ),
    ]
    reference_mm: Annotated[
        dict[Annotated[str, Field(max_length=60)], Length],
        Field(
            description="The same phalanges of the finger that is scaled, where they are measured between other "
            "landmarks than its joint centres [mm].",
            default_factory=dict,
            **_MEASURES,
        ),
    ]
    name: Annotated[
        str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,59}$", description="Of the new finger.", examples=["H07"])
    ] = "scaled"


class Scaled(Answered):
    """A finger scaled to a specimen. The service does not keep it."""

    bones: list[Plain] = Field(description="bone, before_mm, after_mm, factor, how.")
    moment_arms: list[Plain] = Field(description="Before and after, by posture [mm].")
    assumptions: list[str]
    document: Plain = Field(description="finger/1.")
    file: str = Field(description="The same as YAML.")


class FingersCompared(Answered):
    """Two fingers side by side: bones, moment arms, force ratios, predicted and where sessions are shipped measured."""

    figures: list[FigureShown]
