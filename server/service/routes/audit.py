"""The audit trail: who changed what, when and from where."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response
from pydantic import Field

from server.service.answers import JsonAnswer
from server.service.routes.exports import files
from server.service.schemas.common import Answered, Plain, Shown, documented
from server.service.services import of
from server.service.storage.audit import entries, faults_of
from server.service.web.strict_requests import StrictRoute

router = APIRouter(route_class=StrictRoute, prefix="/audit", tags=["operation"])


class EntryShown(Shown):
    """A change."""

    number: int = Field(description="From 1, without gaps.")
    at_utc: str
    who: str = Field(description="Name of the token; `local` for whoever needs none; a user on the command line.")
    origin: str = Field(description="Address, with the token's id.")
    what: str = Field(description="Kind of change.", examples=["session edited"])
    about: str | None = Field(description="The session; null for what concerns none.")
    details: Plain
    before: str = Field(description="SHA-256 of the entry before it.")
    sha256: str = Field(description="Of all the rest of the entry.")


class Trail(Answered):
    """Changes, oldest first."""

    entries: list[EntryShown]
    faults: list[str] | None = Field(description="Where the whole trail is not as it was written; null: not asked for.")


Session = Annotated[str | None, Query(max_length=200, description="To leave the others out.")]


@router.get("", responses=documented(Trail))
def listed(
    request: Request,
    session: Session = None,
    after: Annotated[int, Query(ge=0, le=1 << 53, description="Number of an entry; younger ones follow.")] = 0,
    limit: Annotated[int, Query(ge=1, le=1000)] = 200,
    check: Annotated[bool, Query(description="Whether to follow the whole chain of checksums.")] = False,
) -> JsonAnswer:
    """List changes with who asked for them; nothing is ever removed from them."""
    database = of(request).database
    found: list[dict[str, Any]] = [asdict(e) for e in entries(database, session, after, limit)]
    return JsonAnswer(
        {"schema": "fingertwin/audit/1", "entries": found, "faults": faults_of(database) if check else None}
    )


@router.get("/export", response_class=Response, responses=files(["jsonl"], "The trail, an entry a line."))
def export(request: Request, session: Session = None) -> Response:
    """Return the trail as lines of JSON, as `fingertwin audit` reads it."""
    lines = [json.dumps(asdict(e), ensure_ascii=False) + "\n" for e in entries(of(request).database, session)]
    named = {"Content-Disposition": 'attachment; filename="audit.jsonl"'}
    return Response("".join(lines), media_type="application/jsonl", headers=named)
