"""Fingers: the shipped parameter sets, and their exchange with OpenSim and MuJoCo."""

from __future__ import annotations

import pathlib
from tempfile import TemporaryDirectory
from typing import Annotated, Any, Literal, get_args

import numpy as np
from fastapi import APIRouter, Path, Query, Request, Response

from daq.errors import InputError
from fingermodel.fingers.files import finger_from_dict, finger_names, finger_text, read_finger
from fingermodel.studies.scaling import scale_finger, scaled_document, scaled_heading
from server.application.exchange import UNSOURCED, imported_body, read_foreign
from server.application.species import compare_species
from server.figures.species import species_plots
from server.service.answers import JsonAnswer
from server.service.figures.answer import Theme, drawn_plots
from server.service.figures.fingers import exported, finger_shown, known_finger
from server.service.routes.exports import MEDIA, files
from server.service.schemas.common import documented
from server.service.schemas.fingers import (
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
from server.service.web.strict_requests import ApartRoute, ReadingRoute

quick = APIRouter(route_class=ReadingRoute, prefix="/fingers", tags=["fingers"])
slow = APIRouter(route_class=ApartRoute, prefix="/fingers", tags=["fingers"])

Name = Annotated[str, Path(max_length=100, description="Of the finger.", examples=["an1979_middle"])]
FingerFormat = Literal["finger", "osim", "mjcf"]
Format = Annotated[
    FingerFormat,
    Query(alias="format", description="finger: finger/1 as YAML; osim: OpenSim 4; mjcf: MuJoCo."),
]


@quick.get(
    "",
    responses=documented(FingerList),
)
def listed() -> JsonAnswer:
    """List the fingers that come with the software: bones, joints, tendons, what they are judged in."""
    rows = [finger_shown(name) for name in finger_names()]
    return JsonAnswer({"schema": "fingertwin/fingers/1", "fingers": rows})


@quick.get("/{finger}", responses=documented(FingerRead))
def one(finger: Name) -> JsonAnswer:
    """Return a finger with every number and its source."""
    shown = finger_shown(known_finger(finger))
    return JsonAnswer({"schema": "fingertwin/finger/1"} | shown | {"document": read_finger(finger).document})


@slow.get("/{finger}/formats", responses=documented(FingerFormats))
def in_formats(finger: Name, request: Request) -> JsonAnswer:
    """Say which formats a finger can be exported to, and what each cannot say of it."""
    known_finger(finger)
    found: list[dict[str, Any]] = []
    for file_format in get_args(FingerFormat):
        try:
            file, _, notes = exported(finger, file_format)
        except InputError:
            continue  # a finger that this format cannot hold is not offered in it
        found.append({"format": file_format, "file": file, "notes": [f"{n}." for n in notes]})
    return JsonAnswer({"schema": "fingertwin/finger-formats/1", "formats": found})


@slow.get("/{finger}/export", response_class=Response, responses=files(get_args(FingerFormat), "The file."))
def export(finger: Name, request: Request, file_format: Format) -> Response:
    """Write a finger for OpenSim or MuJoCo, or as the file that it is here."""
    name, text, _ = exported(known_finger(finger), file_format)
    return Response(text, 200, {"Content-Disposition": attachment(name)}, MEDIA[file_format])


@slow.post("/imports", responses=documented(FingerImported))
def take_in(body: FingerImport, request: Request) -> JsonAnswer:
    """Make a finger/1 file of an OpenSim or MJCF finger chain with path points; nothing is kept."""
    with TemporaryDirectory(prefix="fingertwin-", ignore_cleanup_errors=True) as folder:
        file = pathlib.Path(folder) / body.name
        file.write_text(body.text, encoding="utf-8")
        found = read_foreign(file, None if body.load_point_mm is None else np.array(body.load_point_mm))
    heading = f"Made of {body.name}. {UNSOURCED}"
    head = {"schema": "fingertwin/finger-import/1", "name": body.name} | imported_body(found)
    return JsonAnswer(head | {"document": found.document, "file": finger_text(found.document, heading)})


@slow.post("/{finger}/scalings", responses=documented(Scaled))
def scale(finger: Name, body: AskedScaling, request: Request) -> JsonAnswer:
    """Scale a finger to a specimen's bone lengths, and its tendons to measured moment arms; nothing is kept."""
    found = scale_finger(known_finger(finger), body.bones_mm, body.moment_arms_mm, body.reference_mm, body.name)
    document = scaled_document(found)
    finger_from_dict(document, body.name)
    head = {"schema": "fingertwin/scale/1"} | found.as_dict()
    return JsonAnswer(head | {"document": document, "file": finger_text(document, scaled_heading(found))})


@slow.get("/{finger}/comparison", responses=documented(FingersCompared))
def compare(
    finger: Name,
    request: Request,
    other: Annotated[str, Query(max_length=100, description="A finger too.", examples=["synek2019_bonobo"])],
    figures: Annotated[
        Theme | None, Query(description="Draws figures for a light or a dark page; none by default.")
    ] = (None),
) -> JsonAnswer:
    """Set two fingers side by side: bone lengths, moment arms, and force ratios by posture and load."""
    found = compare_species(known_finger(finger), known_finger(other))
    drawn = drawn_plots(lambda: species_plots(found), figures)
    return JsonAnswer({"schema": "fingertwin/species/1"} | found.as_dict() | {"figures": drawn})


router = APIRouter()
router.include_router(quick)
router.include_router(slow)
