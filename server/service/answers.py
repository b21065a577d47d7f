"""JSON as the service writes it: NumPy arrays as lists, NaN and infinities as null."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Any

import numpy as np
import orjson
from starlette.responses import JSONResponse, Response


def dumps(value: Any) -> bytes:
    """Return the JSON of plain data and NumPy arrays."""
    return orjson.dumps(value, _listed, option=orjson.OPT_SERIALIZE_NUMPY | orjson.OPT_NON_STR_KEYS)


def _listed(value: Any) -> Any:
    """Return a column of a table, which is not in one piece of memory."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} is not plain data")


def plain(value: dict[str, Any]) -> dict[str, Any]:
    """Return what a reader of the JSON gets, as it can be kept in a database."""
    out: dict[str, Any] = orjson.loads(dumps(value))
    return out


class JsonAnswer(JSONResponse):
    """An answer of plain data, written as it is, without being checked again."""

    def render(self, content: Any) -> bytes:
        """Return the body."""
        return content if isinstance(content, bytes) else dumps(content)


def page_of(kind: str, rows: list[dict[str, Any]], limit: int) -> JsonAnswer:
    """Answer with rows of a list, such as `jobs`, and the id after which the next ones come; None after the last."""
    last = rows[-1]["id"] if len(rows) == limit else None
    return JsonAnswer({"schema": f"fingertwin/{kind}/1", kind: rows, "next": last})


@dataclass(frozen=True)
class Tagged:
    """JSON as it is answered, with a tag for clients that have it already."""

    body: bytes  # JSON
    tag: str  # of the body

    @classmethod
    def of(cls, value: Any) -> Tagged:
        """Write plain data and NumPy arrays."""
        body = dumps(value)
        return cls(body, hashlib.sha256(body).hexdigest()[:32])

    def answer(self, matched: str | None) -> Response:
        """Answer with a body and its tag, or without a body where the request names this tag (`If-None-Match`)."""
        headers = {"ETag": f'"{self.tag}"', "Cache-Control": "no-cache"}
        if matched is not None and matched.strip(' W/"') == self.tag:
            return Response(status_code=304, headers=headers)
        return JsonAnswer(self.body, 200, headers)
