"""Fingers: the shipped parameter sets, and their exchange with OpenSim and MuJoCo."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import APIRouter, Path, Query, Request, Response

from fingermodel.fingers.files import finger_names, read_finger
from server.service.answers import JsonAnswer
from server.service.figures.answer import Theme
from server.service.figures.fingers import compared, exported, finger_shown, formats, imported, known_finger, scaled
from server.service.routes.exports import files
from server.service.schemas.common import documented
from server.service.schemas.fingers import (
    FINGER,
    AskedScaling,
    FingerFormats,
    FingerImport,
    FingerImported,
    FingerList,
    FingerRead,
    FingersCompared,
    Scaled,
)
from server.service.web.downloads import attachment
from server.service.web.strict_requests import ReadingRoute
from server.service.web.workers import run

router = APIRouter(route_class=ReadingRoute, prefix="/fingers", tags=["fingers"])

Name = Annotated[str, Path(max_length=100, description="Of the finger.", examples=["an1979_middle"])]
Format = Annotated[
    Literal["finger", "osim", "mjcf"],
    Query(alias="format", description="finger: finger/1 as YAML; osim: OpenSim 4; mjcf: MuJoCo."),
]
MEDIA = {"finger": "application/yaml", "osim": "application/xml", "mjcf": "application/xml"}


@router.get("", responses=documented(FingerList, example={"schema": "fingertwin/fingers/1", "fingers": [FINGER]}))
def listed() -> JsonAnswer:
    """List the fingers that come with the software: bones, joints, tendons, what they are judged in."""
    rows = [finger_shown(name) for name in finger_names()]
    return JsonAnswer({"schema": "fingertwin/fingers/1", "fingers": rows})


@router.get("/{finger}", responses=documented(FingerRead))
def one(finger: Name) -> JsonAnswer:
    """Return a finger with every number and its source."""
    shown = finger_shown(known_finger(finger))
    return JsonAnswer(shown | {"document": read_finger(finger).document})


@router.get("/{finger}/formats", responses=documented(FingerFormats))
async def in_formats(finger: Name, request: Request) -> JsonAnswer:
    """Say which formats a finger can be exported to, and what each cannot say of it."""
    known_finger(finger)
    found = await run("apart", lambda: formats(finger))
    return JsonAnswer({"schema": "fingertwin/finger-formats/1", "formats": found})


@router.get("/{finger}/export", response_class=Response, responses=files(MEDIA, "The file."))
async def export(finger: Name, request: Request, file_format: Format) -> Response:
    """Write a finger for OpenSim or MuJoCo, or as the file that it is here."""
    known_finger(finger)
    name, text, _ = await run("apart", lambda: exported(finger, file_format))
    return Response(text, 200, {"Content-Disposition": attachment(name)}, MEDIA[file_format])


@router.post("/imports", responses=documented(FingerImported))
async def take_in(body: FingerImport, request: Request) -> JsonAnswer:
    """Make a finger/1 file of an OpenSim or MJCF finger chain with path points; nothing is kept."""
    return JsonAnswer(await run("apart", lambda: imported(body.name, body.text, body.load_point_mm)))


@router.post("/{finger}/scalings", responses=documented(Scaled))
async def scale(finger: Name, body: AskedScaling, request: Request) -> JsonAnswer:
    """Scale a finger to a specimen's bone lengths, and its tendons to measured moment arms; nothing is kept."""
    known_finger(finger)
    return JsonAnswer(await run("apart", lambda: scaled(finger, **body.model_dump())))


@router.get("/{finger}/comparison", responses=documented(FingersCompared))
async def compare(
    finger: Name,
    request: Request,
    other: Annotated[str, Query(max_length=100, description="A finger too.", examples=["synek2019_bonobo"])],
    figures: Annotated[
        Theme | None, Query(description="Draws figures for a light or a dark page; none by default.")
    ] = (None),
) -> JsonAnswer:
    """Set two fingers side by side: bone lengths, moment arms, and force ratios by posture and load."""
    names = known_finger(finger), known_finger(other)
    return JsonAnswer(await run("apart", lambda: compared(*names, figures)))
