"""The service's OpenAPI document: refusals under their own media type, and who needs a token."""

from __future__ import annotations

import re
from typing import Any

from fastapi import FastAPI, Request
from fastapi.openapi.utils import get_openapi
from starlette.exceptions import HTTPException
from starlette.responses import Response

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
        _restore_nulls(document, schemas)
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


def _restore_nulls(value: Any, schemas: dict[str, Any]) -> None:
    """Put back into examples what the framework leaves out of them: required members that are null."""
    if isinstance(value, list):
        for item in value:
            _restore_nulls(item, schemas)
    if not isinstance(value, dict):
        return
    schema: dict[str, Any] = value["schema"] if isinstance(value.get("schema"), dict) else value
    schema = schemas.get(str(schema.get("$ref", "")).rpartition("/")[2], schema)
    several = value.get("examples")
    for example in (value.get("example"), *(several if isinstance(several, list) else ())):
        if isinstance(example, dict):
            example.update({name: None for name in schema.get("required", ()) if name not in example})
    for key, item in value.items():
        if key not in ("example", "examples"):
            _restore_nulls(item, schemas)
