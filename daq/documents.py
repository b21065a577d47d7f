"""YAML files that follow a schema: read, validated, and every fault said in one line."""

from __future__ import annotations

import json
import re
from collections.abc import Hashable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic_core import ErrorDetails

from daq.errors import InputError
from daq.vocabulary import did_you_mean

try:  # libyaml is ten times faster, and not built everywhere
    from yaml import CSafeLoader as SafeLoader
except ImportError:
    from yaml import SafeLoader  # type: ignore[assignment]


class Document(BaseModel):
    """Base of a schema: nothing unknown, nothing infinite, nothing changed later."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class RepeatedNameError(json.JSONDecodeError):
    """A key of a JSON text is there twice, so that only one could count; its place in the text is not known."""

    def __str__(self) -> str:
        """Return what is wrong, without a place."""
        return self.msg


def unique_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Make an object of a JSON text, as `object_pairs_hook`; a key given twice is refused, since only one could count.

    Raises:
        RepeatedNameError: a key is there twice.
    """
    out = dict(pairs)
    if len(out) < len(pairs):
        names = [key for key, _ in pairs]
        twice = next(key for key in names if names.count(key) > 1)
        raise RepeatedNameError(f"key {twice[:60]!r} is there twice", "", 0)
    return out


Schema = TypeVar("Schema", bound=Document)


# What is expected of keys, and the remedy.
EACH_ONCE = ("each key once", "Remove one of them")


class RepeatedKeyError(yaml.constructor.ConstructorError):
    """A key of a YAML text is there twice, so that only one could count."""


def load_yaml(text: str) -> Any:
    """Read YAML as plain data, refusing a key given twice.

    Raises:
        yaml.YAMLError: it is no YAML; RepeatedKeyError where a key is there twice.
        TypeError, ValueError: a list as a key, the 45th of a month.
    """
    return yaml.load(text, Loader=_Loader)  # noqa: S506 - a subclass of the safe loader


def yaml_fault(fault: Exception) -> str:
    """Say in what line of a YAML text what is wrong."""
    mark = getattr(fault, "problem_mark", None)
    where = f" in line {mark.line + 1}, column {mark.column + 1}" if mark else ""
    return f"{where}: {getattr(fault, 'problem', None) or ' '.join(str(fault).split())}"


class _Loader(SafeLoader):
    """YAML's safe loader, which takes plain numbers alone for numbers, and refuses a key given twice."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        """Build a mapping whose keys differ."""
        seen = set()
        for key, _ in node.value:
            if key.value in seen and key.tag != "tag:yaml.org,2002:merge":
                raise RepeatedKeyError(None, None, f"key {key.value!r} is there twice", key.start_mark)
            seen.add(key.value)
        out: dict[Hashable, Any] = super().construct_mapping(node, deep)
        return out


# Nobody means what YAML 1.1 makes of 0650 (octal), 0x10, 12_1 and 1:30 (base 60), so these stay text.
# Where a number is expected, 0650 is then read as 650, and 1:30 is refused.
_PLAIN_NUMBERS = {
    "tag:yaml.org,2002:int": re.compile(r"[-+]?(?:0|[1-9][0-9]*)$"),
    "tag:yaml.org,2002:float": re.compile(
        r"(?:(?:[-+]?[0-9]+\.[0-9]*|\.[0-9]+)(?:[eE][-+][0-9]+)?|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))$"
    ),
}
_Loader.yaml_implicit_resolvers = {
    first: [(tag, _PLAIN_NUMBERS.get(tag, form)) for tag, form in forms]
    for first, forms in SafeLoader.yaml_implicit_resolvers.items()
}


def read_document(path: Path, wanted: str, error: type[InputError] = InputError) -> Any:
    """Read a YAML file as plain data.

    Args:
        path: of the file.
        wanted: what it should be, such as `a finger/1 file`.
        error: to raise.
    """
    try:
        return load_yaml(path.read_text(encoding="utf-8"))
    except UnicodeDecodeError as fault:
        raise error(f"{path.name} is not text", f"{wanted} in UTF-8", "Save it as UTF-8") from fault
    except RepeatedKeyError as fault:
        raise error(f"{path.name}{yaml_fault(fault)}", *EACH_ONCE) from fault
    except (yaml.YAMLError, TypeError, ValueError) as fault:  # the latter two: a list as a key, the 45th of a month
        raise error(f"{path.name} is not YAML{yaml_fault(fault)}", wanted) from fault


def _path(place: Sequence[int | str], raw: Any) -> Iterator[str]:
    """Yield names of a place in the file, without what tells which of several forms was meant."""
    here = raw
    for i, part in enumerate(place):
        if isinstance(here, Mapping):
            if part not in here and i + 1 < len(place):
                continue
            here = here.get(part)
        elif isinstance(here, list) and isinstance(part, int) and part < len(here):
            here = here[part]
        yield str(part)


def _misspelt(schema: type[Document], fault: ValidationError) -> tuple[ErrorDetails, str] | None:
    """Return the first unknown key that looks like one that is missing, or like one of the schema's, and the hint."""
    faults = fault.errors()
    for one in faults:
        if one["type"] == "extra_forbidden":
            *above, key = one["loc"]
            missing = [o["loc"][-1] for o in faults if o["type"] == "missing" and [*o["loc"][:-1]] == above]
            known = map(str, [*missing, *(() if above else schema.model_fields)])
            if hint := did_you_mean(str(key), known):
                return one, hint
    return None


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
        first, hint = _misspelt(schema, fault) or (fault.errors()[0], "")
        place = ".".join(_path(first["loc"], raw))
        if hint:
            words, remedy = f"{place} is not a known key", hint
        elif first["type"] == "model_type":
            words = f"{place or 'it'} has no keys with values"
        else:
            said = first["msg"].removeprefix("Value error, ").replace("Input should be", "must be")
            words = f"{place}: {said}" if place else said
        raise error(f"{where}: {words}", wanted, remedy) from fault
