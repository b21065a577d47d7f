"""Published studies in the service: which there are, and when each was computed last."""

from __future__ import annotations

from server.reproduce.study import STUDIES, Study
from server.service.jobs.kinds import DONE, Job
from server.service.jobs.service import JobService
from server.service.web.problems import not_found

# Older ones have been forgotten by then, or were asked for by somebody in a loop.
_LOOKED_AT = 200


def study_named(name: str) -> Study:
    """Return the study of that name.

    Raises:
        ProblemError: 404 there is none.
    """
    for study in STUDIES:
        if study.name == name:
            return study
    raise not_found("study", name, "/api/v1/studies")


def last_of(jobs: JobService, study: str, *, done: bool = False) -> Job | None:
    """Return the job that computed a study last, or None.

    Args:
        jobs: of the service.
        study: its name.
        done: whether it must be done; it then brings its result.
    """
    for job in jobs.list(None, DONE if done else None, _LOOKED_AT, None, ("reproduce",)):
        if job.request["study"] == study:
            return jobs.get(job.id) if done else job
    return None
