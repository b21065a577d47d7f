"""Jobs over REST: how far they are, what came out, and cancelling one."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Path, Query, Request

from server.service.answers import JsonAnswer, page_of
from server.service.schemas.common import Limit, documented
from server.service.schemas.jobs import JobList, JobShown, State
from server.service.services import of
from server.service.web.examples import EXAMPLES
from server.service.web.strict_requests import StrictRoute

router = APIRouter(prefix="/jobs", route_class=StrictRoute, tags=["jobs"])

JobId = Annotated[str, Path(max_length=200, description="Id of the job.", examples=[EXAMPLES["JobShown"]["id"]])]


@router.get("", responses=documented(JobList))
def listed(
    request: Request,
    session: Annotated[str | None, Query(max_length=200, description="That they are about.")] = None,
    state: Annotated[State | None, Query(description="In which they are.")] = None,
    limit: Limit = 100,
    after: Annotated[str | None, Query(max_length=200, description="Those older than this one.")] = None,
) -> JsonAnswer:
    """List jobs, newest first, without their results."""
    rows = [job.as_dict() for job in of(request).jobs.list(session, state, limit, after)]
    return page_of("jobs", rows, limit)


@router.get("/{job}", responses=documented(JobShown))
def read(job: JobId, request: Request) -> JsonAnswer:
    """Return a job: how far it is, and once it is done its result."""
    return JsonAnswer(of(request).jobs.get(job).as_dict())


@router.post("/{job}/cancel", responses=documented(JobShown))
def cancel(job: JobId, request: Request) -> JsonAnswer:
    """Cancel a job that is queued or running; one that is finished answers 409."""
    return JsonAnswer(of(request).jobs.cancel(job).as_dict())
