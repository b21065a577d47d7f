"""Forces inside the finger: assigned to what a session's tip cell read, or to a recorded movement."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query, Request

from server.service.answers import JsonAnswer
from server.service.figures.answer import Theme
from server.service.figures.forces import activation, invertible, movement, movement_choices
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
from server.service.web.strict_requests import ReadingRoute
from server.service.web.workers import run

router = APIRouter(route_class=ReadingRoute, tags=["forces"])

By = Annotated[
    Closure,
    Query(
        description="What settles which tendon pulls: minimal (four muscles, no hood), chao (the hood's sharing laws), "
        "least_squares (least stress).",
    ),
]
OnPage = Annotated[Theme | None, Query(description="Draws figures for a light or a dark page; none by default.")]


@router.get("/sessions/{session}/inversion", responses=documented(Inverted))
async def inversion(
    session: SessionId, request: Request, closure: By = "chao", model: ModelName = None, figures: OnPage = None
) -> JsonAnswer:
    """Find the muscle and joint forces behind a session's tip forces, beside the weights that really hung.

    The session must be closed: what is assigned to validation cases would tell of their predictions.
    """
    return JsonAnswer(await run("apart", lambda: invertible(of(request), session, closure, model, figures)))


@router.get("/movements", responses=documented(MovementChoices))
def choices() -> JsonAnswer:
    """List the movements, muscle sets and fingers that a movement can be worked out with."""
    return JsonAnswer({"schema": "fingertwin/movements/1"} | movement_choices())


@router.post("/movements", responses=documented(Moved))
async def move(body: AskedMovement, request: Request, figures: OnPage = None) -> JsonAnswer:
    """Work out a movement: joint torques by inverse dynamics, muscle forces by min/max recruitment."""
    return JsonAnswer(await run("apart", lambda: movement(body.model_dump(), figures)))


@router.post("/activations", responses=documented(Activated))
async def activate(body: AskedActivation, request: Request, figures: OnPage = None) -> JsonAnswer:
    """Hold a finger at the tip with its muscles active: the force of each, and what deficits of each change."""
    return JsonAnswer(await run("apart", lambda: activation(body.model_dump(), figures)))
