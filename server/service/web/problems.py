"""Error answers of the service: `application/problem+json` (RFC 9457) with a remedy."""

from __future__ import annotations

import math
from collections.abc import Sequence
from http import HTTPStatus
from typing import Any

from fastapi import Request
from fastapi.exceptions import RequestValidationError
from pydantic import BaseModel, ConfigDict, Field
from starlette.exceptions import HTTPException
from starlette.responses import Response

from daq.errors import InputError
from server.service.answers import JsonAnswer
from server.service.storage.checksums import DamagedError

PROBLEM = "application/problem+json"
# Longer texts of a client's are not sent back, nor are longer parts of a problem.
_SHOWN, _SAID = 200, 1000
# So many faults of a request are told in its line, and up to 50 beside it.
_FAULTS = 3
# Of whatever is not there.
_ELSEWHERE = "Look how it is spelt, and ask for one that is there"


class Problem(BaseModel):
    """A refusal or a failure."""

    model_config = ConfigDict(extra="allow")

    type: str = "about:blank"
    title: str = Field(description="What the status means.")
    status: int = Field(description="The HTTP status.")
    detail: str = Field(description="What was found, what was expected, what to do, in one line.")
    found: str | None = None
    expected: str | None = None
    remedy: str | None = None
    errors: list[dict[str, Any]] | None = Field(default=None, description="Each fault of a body, with its place.")


class ProblemError(Exception):
    """To be answered with a status and a problem.

    Args:
        status: of HTTP.
        found: what was found.
        expected: what was expected.
        remedy: what to do; where something is not there, by default to look how it is spelt.
        headers: of the answer.
        more: further members of the problem.
    """

    def __init__(
        self,
        status: int,
        found: str,
        expected: str = "",
        remedy: str = "",
        *,
        headers: dict[str, str] | None = None,
        **more: Any,
    ) -> None:
        remedy = remedy or (_ELSEWHERE if status == HTTPStatus.NOT_FOUND else "")
        found, expected, remedy = (shortened(t, _SAID) for t in (found, expected, remedy))
        error = InputError(found, expected, remedy)
        super().__init__(str(error))
        self.status, self.headers = status, headers
        self.found, self.expected, self.remedy = found, expected, remedy
        self.body = body_of(status, str(error)) | {"found": found, "expected": expected, "remedy": remedy} | more

    def answer(self) -> Response:
        """Return it as an answer."""
        return _answered(self.status, self.body, self.headers)


def body_of(status: int, detail: str) -> dict[str, Any]:
    """Return the plain data of a problem."""
    try:
        title = HTTPStatus(status).phrase
    except ValueError:
        title = "Error"
    return {"type": "about:blank", "title": title, "status": status, "detail": detail}


def not_found(what: str, name: str, where: str) -> ProblemError:
    """Return a problem about something that is not there."""
    return ProblemError(404, f"there is no {what} {shortened(name)}", f"one of GET {where}")


def shortened(text: object, most: int = _SHOWN) -> str:
    """Return a client's text, not too long to be sent back."""
    shown = str(text)
    return shown if len(shown) <= most else f"{shown[:most]}… ({len(shown)} characters)"


def _answered(status: int, body: dict[str, Any], headers: dict[str, str] | None = None) -> Response:
    return JsonAnswer(body, status, headers, media_type=PROBLEM)


async def answer_problem(_: Request, error: Exception) -> Response:
    """Answer with a problem that was raised."""
    assert isinstance(error, ProblemError)  # noqa: S101 - the handler is registered for no other
    return error.answer()


async def answer_input_error(_: Request, error: Exception) -> Response:
    """Answer that what was given cannot be used."""
    assert isinstance(error, InputError)  # noqa: S101
    return ProblemError(422, error.found, error.expected, error.remedy).answer()


async def answer_damaged(request: Request, error: Exception) -> Response:
    """Answer that what was stored is damaged; the health says so from then on."""
    assert isinstance(error, DamagedError)  # noqa: S101
    request.app.state.services.scrub.note((error.what,))
    return ProblemError(
        500,
        str(error),
        "what was stored",
        "Restore a backup (fingertwin restore), or leave out the load case; GET /api/v1/health names what is damaged",
    ).answer()


async def answer_http(request: Request, error: Exception) -> Response:
    """Answer what the framework refuses, such as an unknown address."""
    assert isinstance(error, HTTPException)  # noqa: S101
    if error.status_code == HTTPStatus.NOT_FOUND:
        return not_found("address", request.url.path, "/api/v1/openapi.json").answer()
    headers = dict(error.headers or {}) or None
    return _answered(error.status_code, body_of(error.status_code, shortened(error.detail)), headers)


async def answer_invalid(_: Request, error: Exception) -> Response:
    """Answer that a request does not have the form that is documented."""
    assert isinstance(error, RequestValidationError)  # noqa: S101
    faults = [_fault(e) for e in error.errors()]
    problem = next((e for e in error.errors() if e.get("type") == "json_invalid"), None)
    if problem is not None:
        found = (
            f"the body cannot be read as JSON: {problem.get('ctx', {}).get('error', '')} at byte {problem['loc'][-1]}"
        )
        wanted = "JSON without NaN, zero characters and lone surrogates, at most 32 levels deep"
        return ProblemError(422, found, wanted, errors=faults).answer()
    told = "; ".join(f"{f['where']}: {f['found']}" for f in faults[:_FAULTS]) or "the request: not readable"
    more = f"; and {len(faults) - _FAULTS} more faults" if len(faults) > _FAULTS else ""
    wanted = "the form that GET /api/v1/openapi.json describes"
    return ProblemError(422, f"{told}{more}", wanted, errors=faults[:50]).answer()


def failure() -> Response:
    """Return that the fault is ours."""
    text = "The service has failed; the fault is in its log, nothing that was acknowledged is lost."
    return _answered(500, body_of(500, text))


async def answer_failure(_: Request, __: Exception) -> Response:
    """Answer that the fault is ours."""
    return failure()


def _fault(error: Any) -> dict[str, Any]:
    where: Sequence[object] = error.get("loc", ())
    value = error.get("input")
    shown = None if isinstance(value, dict | list | bytes) or value is None else shortened(value)
    if isinstance(value, float) and not math.isfinite(value):
        shown = str(value)
    place = shortened(".".join(str(w) for w in where))
    return {"where": place, "found": shortened(error.get("msg", "")), "value": shown}


def problems(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """Return the documentation of refusals, for a route's `responses`."""
    # As a reference: a model for each refusal of each route would take half a second of the service's start.
    content = {PROBLEM: {"schema": {"$ref": f"#/components/schemas/{Problem.__name__}"}}}
    return {s: {"description": HTTPStatus(s).phrase, "content": content} for s in statuses}
