"""Published studies, computed again as jobs: every figure beside ours."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Path, Request

from server.reproduce.study import STUDIES, Study
from server.service.answers import JsonAnswer
from server.service.jobs.studies import last_of, study_named
from server.service.schemas.common import documented
from server.service.schemas.jobs import JobShown
from server.service.schemas.studies import AskedReproduction, StudyComputed, StudyList
from server.service.services import of
from server.service.web.strict_requests import StrictRoute

router = APIRouter(route_class=StrictRoute, prefix="/studies", tags=["studies"])

Name = Annotated[str, Path(max_length=100, description="Of the study.", examples=["synek2019"])]


@router.get("", responses=documented(StudyList))
def listed(request: Request) -> JsonAnswer:
    """List the published studies that can be computed."""
    return JsonAnswer({"schema": "fingertwin/studies/1", "studies": [_shown(request, s) for s in STUDIES]})


@router.get("/{study}", responses=documented(StudyComputed))
def one(study: Name, request: Request) -> JsonAnswer:
    """Return a study: every published figure beside ours, as it was computed last; no rows where it never was."""
    found = study_named(study)
    done = last_of(of(request).jobs, found.name, done=True)
    result: dict[str, Any] = {} if done is None else done.result or {}
    figures = [{"name": f["name"], "heading": f["heading"]} for f in result.get("figures", ())]
    bare: dict[str, Any] = {"rows": [], "assumptions": [], "sheets": [], "version": None}
    body = bare | result | {"schema": "fingertwin/reproduce/1"} | _shown(request, found) | {"figures": figures}
    return JsonAnswer(body)


@router.post("/{study}/reproductions", status_code=202, responses=documented(JobShown, status=202))
def reproduce(study: Name, body: AskedReproduction, request: Request) -> JsonAnswer:
    """Compute a study again."""
    found = study_named(study)
    job = of(request).jobs.submit("reproduce", None, {"study": found.name}, body.timeout_s)
    return JsonAnswer(job.as_dict(), 202, {"Location": f"/api/v1/jobs/{job.id}"})


def _shown(request: Request, study: Study) -> dict[str, Any]:
    last = last_of(of(request).jobs, study.name)
    state = {"job": None if last is None else last.id, "state": None if last is None else last.state}
    return study._asdict() | state
