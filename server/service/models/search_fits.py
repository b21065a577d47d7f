"""The refits of a search as models: `JOB/nothing`, or `JOB/EFFECT+EFFECT` for an explanation that it fitted."""

from __future__ import annotations

from typing import Any

from sqlalchemy import select

from fingermodel.fingers.files import finger_document
from fingermodel.model_files import FORMAT, Revision, revision_of
from fingermodel.revisions import held_by
from fingermodel.session import Session
from server.service.storage.database import Database
from server.service.storage.schema import jobs
from server.service.web.problems import ProblemError, shortened

NOTHING = "nothing"


def asked(database: Database, name: str, session: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the answer of a search for a session, and the row of its ranking that a name means.

    Args:
        database: that keeps the jobs.
        name: such as `JOB/hanger_mass`.
        session: its id.

    Raises:
        ProblemError: 422 there is no such search of the session, or it fitted no such explanation.
    """
    job, _, wanted = name.partition("/")
    with database.reading() as connection:
        row = connection.execute(select(jobs.c.session, jobs.c.result).where(jobs.c.id == job)).first()
    result = {} if row is None or row.result is None else row.result
    answer = (result.get("each") or {}).get(session) or (result if row is not None and row.session == session else {})
    members = [] if wanted == NOTHING else wanted.split("+")
    for found in answer.get("ranking", ()):
        if found["candidates"] == members and found.get("fit") is not None:
            return answer, found
    raise ProblemError(
        422,
        f"there is no model {shortened(name)!r}",
        f"JOB/{NOTHING} or JOB/EFFECT of a search of {session}, a revision's id, or a finger of GET /api/v1/fingers",
    )


def fit_revision(bench: Session, name: str, answer: dict[str, Any], found: dict[str, Any]) -> Revision:
    """Make a model of a search's refit.

    Args:
        bench: the session with the model that was searched, the catalogue and the users' effects of the fit held.
        name: as in `asked`.
        answer: of the search.
        found: the row of its ranking.
    """
    model, session, index = bench.model, bench.measured.session.id, bench.model.parameters.index
    # A session that was changed since the search may lack a setting or a mounting.
    theta = bench.at_values({name: value for name, value in found["fit"].items() if name in index}).theta
    job, _, wanted = name.partition("/")
    what = "nothing" if wanted == NOTHING else wanted.replace("+", " + ")
    title = f"{bench.loaded.name} with {what} added (search {job[:6]})"
    fitted = model.finger.replace_values(**model.values_at(theta)._asdict())
    free = [*bench.loaded.added, *(p["name"] for p in found["parameters"])]
    document = {
        "format": FORMAT,
        "id": title,
        "parent": bench.loaded.name,
        "session": {"id": session, "measured_sha256": answer.get("measured_sha256")},
        "budget": model.budget.as_dict(),
        "effects": list(held_by(bench, free)),
        "parameters": [{"name": n, "value": float(theta[i])} for n, i in index.items() if theta[i] != model.initial[i]],
        "finger": finger_document(fitted, "fit", f"fitted to session {session} by a search", "fitted"),
        "prior_finger": finger_document(model.finger, "fit", "an earlier fit", "fitted"),
        "history": list(bench.loaded.history),
    }
    return revision_of(document, title)
