"""State of a bench, and the finger as it is held there: data for a page beside the live stream."""

from __future__ import annotations

from fastapi import APIRouter, Request

from server.service.answers import JsonAnswer
from server.service.figures.bench_finger import bench_finger
from server.service.figures.held_finger import held_finger
from server.service.schemas.bench_view import BenchShown, FingerDrawn
from server.service.schemas.common import InCase, ModelName, Posture, SessionId, documented
from server.service.services import of
from server.service.sessions.bench_view import bench_view
from server.service.web.strict_requests import ReadingRoute, StrictRoute

states = APIRouter(route_class=StrictRoute, prefix="/sessions/{session}/bench", tags=["bench"])
drawn = APIRouter(route_class=ReadingRoute, prefix="/sessions/{session}/bench", tags=["bench"])


@states.get("/state", responses=documented(BenchShown))
def state(session: SessionId, request: Request) -> JsonAnswer:
    """Return how a bench stands: its steps, what to do now, the tare in force and its drift, and what is wrong now.

    It is put together from the events that the bench has sent; what hangs this very moment comes with the live stream.
    """
    parts = of(request)
    record = parts.sessions.read(session)
    connected = parts.live.benches.shown(frozenset({session}))
    out = {"schema": "fingertwin/bench-state/1"} | bench_view(parts.database, record, parts.windows)
    return JsonAnswer(out | {"control": connected[0]["body"] if connected else None})


@drawn.get("/finger", responses=documented(FingerDrawn))
def finger(
    session: SessionId, request: Request, posture: Posture = None, case: InCase = None, model: ModelName = None
) -> JsonAnswer:
    """Return the finger in a posture as lines to be drawn, with what hangs on it and the forces that may be seen.

    Forces that come live are laid into the same drawing with the matrices of `places`. The prediction of a validation
    case is left out until the bench has closed its session.
    """
    parts = of(request)
    held = held_finger(parts, parts.measuring.of(session), posture, case, model)
    return JsonAnswer({"schema": "fingertwin/bench-finger/1", "session": session} | bench_finger(held))


router = APIRouter()
router.include_router(states)
router.include_router(drawn)
