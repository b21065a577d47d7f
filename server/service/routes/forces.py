"""Forces inside the finger: assigned to what a session's tip cell read, or to a recorded movement."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query, Request

from fingermodel.dynamics.motion import motion_from_dict, motion_names, read_motion
from fingermodel.fingers.files import finger_names, read_finger
from fingermodel.muscles.muscle_files import muscle_set_names, read_muscles
from fingermodel.studies.activation import activate as held_active
from fingermodel.studies.inversion import invert_bench
from fingermodel.studies.movement import work_out
from server.application.provenance import provenance
from server.figures.activation import activation_plots
from server.figures.inversion import inversion_plots
from server.figures.movement import movement_plots
from server.service.answers import JsonAnswer
from server.service.figures.answer import Theme, drawn_plots
from server.service.figures.fingers import finger_shown, known_finger
from server.service.figures.parts import resolved
from server.service.schemas.common import ModelName, SessionId, documented
from server.service.schemas.forces import (
    Activated,
    AskedActivation,
    AskedMovement,
    Closure,
    Inverted,
    Moved,
    MovementChoices,
)
from server.service.services import of
from server.service.sessions.blinding import require_closed
from server.service.web.problems import not_found
from server.service.web.strict_requests import ApartRoute, ReadingRoute

quick = APIRouter(route_class=ReadingRoute, tags=["forces"])
slow = APIRouter(route_class=ApartRoute, tags=["forces"])

By = Annotated[
    Closure,
    Query(
        description="What settles which tendon pulls: minimal (four muscles, no hood), chao (the hood's sharing laws), "
        "least_squares (least stress).",
    ),
]
OnPage = Annotated[Theme | None, Query(description="Draws figures for a light or a dark page; none by default.")]


@slow.get("/sessions/{session}/inversion", responses=documented(Inverted))
def inversion(
    session: SessionId, request: Request, closure: By = "chao", model: ModelName = None, figures: OnPage = None
) -> JsonAnswer:
    """Find the muscle and joint forces behind a session's tip forces, beside the weights that really hung.

    The session must be closed: what is assigned to validation cases would tell of their predictions.
    """
    parts = of(request)
    measured = parts.measuring.of(session)
    require_closed(measured)
    bench = parts.models.bench(measured, resolved(parts, measured, model))
    found = invert_bench(bench, closure)
    head = {"schema": "fingertwin/invert/1"} | provenance(bench) | {"excluded": measured.excluded}
    drawn = drawn_plots(lambda: inversion_plots(found), figures)
    head |= parts.models.provenance(measured, bench)
    return JsonAnswer(head | found.as_dict() | {"sentences": found.verdicts(), "figures": drawn})


@quick.get("/movements", responses=documented(MovementChoices))
def choices() -> JsonAnswer:
    """List the movements, muscle sets and fingers that a movement can be worked out with."""
    fingers = [name for name in finger_names() if finger_shown(name)["moves"]]
    known = {"motions": motion_names(), "muscles": muscle_set_names(), "fingers": fingers}
    return JsonAnswer({"schema": "fingertwin/movements/1"} | known)


@slow.post("/movements", responses=documented(Moved))
def move(body: AskedMovement, request: Request, figures: OnPage = None) -> JsonAnswer:
    """Work out a movement: joint torques by inverse dynamics, muscle forces by min/max recruitment."""
    if body.muscles not in muscle_set_names():
        raise not_found("muscle set", body.muscles, "/api/v1/movements")
    if body.document is None and body.motion not in motion_names():
        raise not_found("movement", body.motion, "/api/v1/movements")
    finger = read_finger(known_finger(body.finger))
    motion = read_motion(body.motion) if body.document is None else motion_from_dict(body.document, "document")
    found = work_out(motion, finger, read_muscles(body.muscles, finger), body.steps)
    drawn = drawn_plots(lambda: movement_plots(found), figures)
    return JsonAnswer({"schema": "fingertwin/move/1"} | found.as_dict() | {"figures": drawn})


@slow.post("/activations", responses=documented(Activated))
def activate(body: AskedActivation, request: Request, figures: OnPage = None) -> JsonAnswer:
    """Hold a finger at the tip with its muscles active: the force of each, and what deficits of each change."""
    asked = body.model_dump()
    finger, muscles = known_finger(asked.pop("finger")), asked.pop("muscles")
    if muscles is not None and muscles not in muscle_set_names():
        raise not_found("muscle set", muscles, "/api/v1/movements")
    found = held_active(finger, muscles, **asked)
    drawn = drawn_plots(lambda: activation_plots(found), figures)
    return JsonAnswer({"schema": "fingertwin/activate/1"} | found.as_dict() | {"figures": drawn})


router = APIRouter()
router.include_router(slow)
router.include_router(quick)
