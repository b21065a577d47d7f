"""JSON as the service writes it: NumPy arrays as lists, NaN and infinities as null."""

from __future__ import annotations

from typing import Any

import numpy as np
import orjson
from starlette.responses import JSONResponse


def dumps(value: Any) -> bytes:
    """Return the JSON of plain data and NumPy arrays."""
    return orjson.dumps(value, _listed, option=orjson.OPT_SERIALIZE_NUMPY | orjson.OPT_NON_STR_KEYS)


def _listed(value: Any) -> Any:
    """A column of a table, which is not in one piece of memory."""
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
