"""What both readers share: XML that cannot do harm, and its numbers."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn
from xml.etree import ElementTree as ET
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from daq.documents import unique_keys
from daq.errors import ModelError

Floats = NDArray[np.float64]
MILLIMETRES = 1000.0
_MOST_BYTES = 16 << 20


def read_root(path: Path, wanted: str) -> ET.Element:
    """Parse a file.

    Args:
        path: of the file.
        wanted: what it should be, such as `an OpenSim model (.osim)`.

    Raises:
        ModelError: it is missing, too large, no XML, or declares markup of its own.
    """
    try:
        with path.open("rb") as stream:
            content = stream.read(_MOST_BYTES + 1)
    except OSError as error:
        raise ModelError(f"{path} cannot be read ({error.strerror or error})", wanted) from error
    if len(content) > _MOST_BYTES:
        raise ModelError(f"{path.name} is larger than {_MOST_BYTES >> 20} MiB", wanted)
    try:
        _refuse_markup(content, path.name)
        return ET.fromstring(content)  # noqa: S314 - bounded, and without a document type and its entities
    except (ET.ParseError, expat.ExpatError, ValueError, LookupError) as error:
        if isinstance(error, ModelError):
            raise
        raise ModelError(f"{path.name} is not XML ({error})", wanted) from error


def _refuse_markup(content: bytes, name: str) -> None:
    """Entities are of no use in a model, and can be made to grow without bound or to read other files."""

    def found(*_: object) -> NoReturn:
        raise ModelError(f"{name} declares its own markup (<!DOCTYPE>)", "a model without", "Remove that line")

    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = found
    parser.Parse(content, True)


def vector(text: str | None, count: int, what: str, missing: str = "") -> Floats:
    """So many numbers.

    Raises:
        ModelError: there are not, or they are not finite; `what` says whose they should be.
    """
    try:
        values = np.array([float(word) for word in (text if text is not None else missing).split()])
    except ValueError:
        values = np.zeros(0)
    if len(values) != count or not np.isfinite(values).all():
        shown = "nothing" if text is None else repr(text[:60])
        raise ModelError(f"{what} is {shown}", "a number" if count == 1 else f"{count} numbers")
    return values


def about_of(text: str | None, where: str) -> dict[str, Any]:
    """What fingertwin wrote into the file; empty where there is nothing of it.

    Raises:
        ModelError: it is damaged.
    """
    if text is None:
        return {}
    try:
        body = json.loads(text, object_pairs_hook=unique_keys)
    except ValueError:
        body = None

    def words(value: Any) -> bool:
        return isinstance(value, list) and all(isinstance(x, str) for x in value)

    shapes: dict[str, Callable[[Any], bool]] = {
        "length_unit_mm": lambda v: isinstance(v, int | float) and not isinstance(v, bool) and 0 < v < 1e6,
        "muscles": words,
        "joints": lambda v: isinstance(v, dict) and all(words(x) for x in v.values()),
        "flexion": lambda v: isinstance(v, dict),
        "reactions": words,
    }
    damaged = not isinstance(body, dict) or any(k not in body or not ok(body[k]) for k, ok in shapes.items())
    hood = {} if damaged else body.get("hood", {})
    fractions = hood.get("fractions", {}) if isinstance(hood, dict) else None
    if damaged or not isinstance(fractions, dict) or not all(isinstance(v, dict) for v in fractions.values()):
        raise ModelError(
            f"{where}: the text that fingertwin wrote is damaged", "it whole, or none of it", "Export the finger again"
        )
    found: dict[str, Any] = body
    return found
