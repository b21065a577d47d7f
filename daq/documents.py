"""YAML files that follow a schema: read, validated, and every fault said in one line."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError

from daq.errors import InputError


class Document(BaseModel):
    """Base of a schema: nothing unknown, nothing infinite, nothing changed later."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


Schema = TypeVar("Schema", bound=Document)


def read_document(path: Path, wanted: str, error: type[InputError] = InputError) -> Any:
    """Read a YAML file as plain data.

    Args:
        path: of the file.
        wanted: what it should be, such as `a finger/1 file`.
        error: to raise.
    """
    try:
        return yaml.safe_load(path.read_text(encoding="utf-8"))
    except UnicodeDecodeError as fault:
        raise error(f"{path.name} is not text", f"{wanted} in UTF-8") from fault
    except (yaml.YAMLError, TypeError, ValueError) as fault:  # the latter two: a list as a key, the 45th of a month
        raise error(f"{path.name} is not YAML ({' '.join(str(fault).split())})", wanted) from fault


def _path(place: Sequence[int | str], raw: Any) -> Iterator[str]:
    """Names of a place in the file, without what tells which of several forms was meant."""
    here = raw
    for i, part in enumerate(place):
        if isinstance(here, Mapping):
            if part not in here and i + 1 < len(place):
                continue
            here = here.get(part)
        elif isinstance(here, list) and isinstance(part, int) and part < len(here):
            here = here[part]
        yield str(part)


def validated(
    schema: type[Schema],
    raw: Any,
    where: str,
    wanted: str,
    error: type[InputError] = InputError,
    remedy: str = "",
) -> Schema:
    """Hold plain data against a schema; the first fault is raised with its place.

    Args:
        schema: to hold it against.
        raw: what the file holds.
        where: name of the file, for the reader.
        wanted: what it should be.
        error: to raise.
        remedy: what to do.
    """
    try:
        return schema.model_validate(raw)
    except ValidationError as fault:
        first = fault.errors()[0]
        place = ".".join(_path(first["loc"], raw)) or "the file"
        raise error(f"{where}: {place}: {first['msg']}", wanted, remedy) from fault
