"""The service's OpenAPI document: refusals under their own media type, and who needs a token."""

from __future__ import annotations

import re
from typing import Any

from fastapi import FastAPI, Request
from fastapi.openapi.utils import get_openapi
from starlette.exceptions import HTTPException
from starlette.responses import Response

from server.service.web.examples import EXAMPLES
from server.service.web.problems import Problem, ProblemError, shortened
from server.service.web.workers import run

_METHODS = ("get", "put", "post", "delete", "patch")
_BEARER = {
    "type": "http",
    "scheme": "bearer",
    "description": "A token of `fingertwin token create`. On loopback none is needed; elsewhere every address wants "
    "one, and what changes anything wants one with the role `write`.",
}


def document_of(app: FastAPI) -> dict[str, Any]:
    """Return the document, made once.

    Args:
        app: whose routes are described.
    """
    if app.openapi_schema is None:
        document = get_openapi(
            title=app.title,
            version=app.version,
            description=app.description,
            routes=app.routes,
            license_info=app.license_info,
        )
        schemas = document["components"]["schemas"]
        schemas[Problem.__name__] = Problem.model_json_schema(ref_template="#/components/schemas/{model}")
        for path in document["paths"].values():
            for method in _METHODS:
                for status, answer in path.get(method, {}).get("responses", {}).items():
                    if status in ("204", "304"):
                        answer.pop("content", None)  # nothing is sent
        # Put in here, since the framework leaves out of an example what is null.
        for name in schemas.keys() & EXAMPLES.keys():
            schemas[name]["example"] = EXAMPLES[name]
        document["components"].setdefault("securitySchemes", {})["bearer"] = _BEARER
        document["security"] = [{}, {"bearer": []}]
        app.openapi_schema = document
    return app.openapi_schema


async def answer_wrong_method(request: Request, error: Exception) -> Response:
    """Answer that an address does not take a method, and which it takes."""
    document = await run("readers", document_of, request.app)
    methods = methods_of(document, request.url.path)
    if not methods and isinstance(error, HTTPException):
        methods = [m.strip() for m in (error.headers or {}).get("Allow", "").split(",") if m.strip()]
    headers = {"Allow": ", ".join(methods)}
    found, expected = f"the method {shortened(request.method)}", " or ".join(methods)
    return ProblemError(405, found, expected, headers=headers).answer()


def methods_of(document: dict[str, Any], path: str) -> list[str]:
    """Return the methods documented for an address, by the fitting template with the fewest blanks."""
    fitting = [t for t in document["paths"] if re.fullmatch(re.sub(r"\{[^}]*\}", "[^/]+", t), path)]
    template = min(fitting, key=lambda t: t.count("{"), default="")
    return [m.upper() for m in _METHODS if m in document["paths"].get(template, {})]
