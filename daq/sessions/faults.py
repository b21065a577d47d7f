"""One line for each fault of a session's description: where it lies, what was found, expected, and the remedy."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from pydantic import BaseModel, ValidationError

from daq.errors import SessionError
from daq.sessions.models import Environment, Event, KnownWeight, LoadCase, LoadCell, Mount, Posture, Session, Specimen
from daq.sessions.rules import Fault, Place
from daq.vocabulary import did_you_mean, shown

_WANTED = {
    "float_type": "a number",
    "int_type": "a whole number",
    "string_type": "text",
    "dict_type": "keys with values",
    "model_type": "keys with values",
    "model_attributes_type": "keys with values",
    "tuple_type": "a list",
    "list_type": "a list",
}
_LACKING: Mapping[str, str] = {
    "tension_factor": "the friction correction c, such as 0.835, or {estimate: force_balance}",
    "masses_g": "the mass on each tendon in g, such as {FDP: 950}",
    "postures_deg": "joint angles by posture, such as hook: {MCP: 0, PIP: 65, DIP: 50}",
    "cases": "a list of load cases",
    "format": "bench-session/1",
    "finger": "a parameter set of data/fingers, such as an1979_middle, or a path",
    "specimen": "{id: P07, species: human, digit: third, side: left}, the id being a pseudonym",
    "species": "human, bonobo, …",
    "digit": "second, third, …",
    "id": "a name of its own",
    "posture": "one of postures_deg",
    "side": "left or right",
    "role": "identification or validation",
    "location": "tip or bone",
}


def lines_of(error: ValidationError, data: object, file: str) -> list[SessionError]:
    """Turn a validation error into one SessionError a fault, in the order of the file.

    Args:
        error: what pydantic found.
        data: the plain data that it found it in, from which the ids of cases are taken.
        file: name of the file, for the reader.
    """
    out = []
    for fault in error.errors():
        kind, at = str(fault["type"]), tuple(fault["loc"])
        context: Mapping[str, Any] = fault.get("ctx", {})
        if kind == "refused" and not at:
            continue  # what does not agree between the parts is listed by `faults_between`, with its place
        if kind == "refused":
            place = place_name(at, data) + str(context["below"])
            found = f"{place.lstrip('.') or 'the session'} {context['found']}"
            out.append(_line(file, found, context["expected"], context["remedy"]))
        elif kind == "missing":
            expected = _LACKING.get(str(at[-1]), "")
            out.append(_line(file, f"{place_name(at, data)} is missing", expected))
        elif kind == "extra_forbidden":
            known = _keys_at(at)
            hint = did_you_mean(str(at[-1]), known)
            found = f"{place_name(at, data)} is not a known key"
            out.append(_line(file, found, f"one of {' '.join(known)}", hint))
        else:
            found = f"{place_name(at, data)} is {shown(fault['input'])}"
            out.append(_line(file, found, _WANTED.get(kind, str(fault["msg"]))))
    return out


def line_of(fault: Fault, data: object, file: str) -> SessionError:
    """Turn a fault between the parts of a session into its line."""
    return _line(file, f"{place_name(fault.at, data) or 'the session'} {fault.found}", fault.expected, fault.remedy)


def require_posture(name: str, angles: Mapping[str, Any]) -> None:
    """Make sure that a session can have a posture of these angles [deg].

    Raises:
        SessionError: an angle is missing, impossible, or of no joint.
    """
    try:
        Posture.model_validate(angles)
    except ValidationError as error:
        said: Mapping[str, Any] = error.errors()[0].get("ctx", {})
        found = f"posture {name}{said.get('below', '')} {said.get('found', 'cannot be read')}"
        raise SessionError(found, said.get("expected", ""), said.get("remedy", "")) from None


def place_name(at: Sequence[str | int], data: object) -> str:
    """Return a place in the file as a reader finds it, `cases[3] (c004): masses_g.FPD`."""
    text = ""
    node: Any = data
    for key in at:
        if key == "[key]":
            continue
        if isinstance(key, int):
            text += f"[{key}]"
            node = node[key] if isinstance(node, list | tuple) and key < len(node) else None
            name = node.get("id") if isinstance(node, Mapping) else None
            text += f" ({name}):" if isinstance(name, str | int) else ""
            continue
        text += f"{'' if not text else ' ' if text.endswith(':') else '.'}{key}"
        node = node.get(key) if isinstance(node, Mapping) else None
    return text.removesuffix(":")


def summary(faults: Sequence[SessionError]) -> SessionError:
    """Return the first fault, saying how many more there are."""
    first, more = faults[0], len(faults) - 1
    if not more:
        return first
    others = f"`fingertwin check` lists {more} more"
    return SessionError(first.found, first.expected, f"{first.remedy}. {others}" if first.remedy else others)


def _line(file: str, found: str, expected: str, remedy: str = "") -> SessionError:
    return SessionError(f"{file}: {found}" if file else found, expected, remedy)


def _keys_at(at: Place) -> Iterable[str]:
    models: Mapping[str, type[BaseModel]] = {
        "specimen": Specimen,
        "mounts": Mount,
        "load_cell": LoadCell,
        "checks": KnownWeight,
        "cases": LoadCase,
        "events": Event,
        "environment": Environment,
    }
    for key in reversed(at[:-1]):
        if isinstance(key, str) and key in models:
            return models[key].model_fields
    return ("estimate",) if "tension_factor" in at else Session.model_fields
