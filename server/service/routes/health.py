"""`/health`, `/health/live`, `/health/ready`, and `/metrics` for Prometheus."""

from __future__ import annotations

from typing import Literal

from fastapi import APIRouter, Request
from pydantic import BaseModel, Field
from starlette.responses import Response

from server.service.operation.health import Health, HealthAnswer
from server.service.schemas.common import documented
from server.service.web.metrics import CONTENT_TYPE, Metrics
from server.service.web.problems import ProblemError
from server.service.web.workers import run

router = APIRouter(prefix="/health", tags=["health"])
# Beside the interface: Prometheus asks for it at the root.
metrics_router = APIRouter(tags=["health"])


class Live(BaseModel):
    """Sign that the service runs."""

    schema_: Literal["fingertwin/live/1"] = Field(default="fingertwin/live/1", serialization_alias="schema")
    live: Literal[True] = True


class Ready(BaseModel):
    """Sign that the service takes requests."""

    schema_: Literal["fingertwin/ready/1"] = Field(default="fingertwin/ready/1", serialization_alias="schema")
    ready: Literal[True] = True


def _health(request: Request) -> Health:
    found: Health = request.app.state.health
    return found


@router.get("", summary="How the service is", response_model=HealthAnswer, responses=documented(HealthAnswer))
async def health(request: Request) -> HealthAnswer:
    """Return version, database, disk and workers; `degraded` says that something needs a person."""
    return await run("health", _health(request).answer)


@router.get("/live", summary="Whether the service runs", response_model=Live, responses=documented(Live))
async def live() -> Live:
    """Answer; no token is needed."""
    return Live()


@router.get("/ready", summary="Whether the service may be asked", response_model=Ready, responses=documented(Ready))
async def ready(request: Request) -> Ready:
    """Answer 503 until models are warm and the database is up to date; no token is needed."""
    if not _health(request).ready:
        raise ProblemError(
            503, "the service is not ready", "models that are compiled", "Ask again", headers={"Retry-After": "1"}
        )
    return Ready()


@metrics_router.get(
    "/metrics",
    summary="Metrics for Prometheus",
    response_class=Response,
    responses=documented(BaseModel) | {200: {"content": {"text/plain": {"schema": {"type": "string"}}}}},
)
async def metrics(request: Request) -> Response:
    """Return counters, gauges and histograms in Prometheus' text format."""
    found: Metrics = request.app.state.metrics
    return Response(await run("health", found.text), media_type=CONTENT_TYPE)
