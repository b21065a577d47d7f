"""Names, texts and numbers of a document within what is kept, what an address holds, and what a bench can measure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from server.service.web.problems import ProblemError, shortened

MOST_NAME, MOST_TEXT = 100, 10_000
# Load cases of a session, and how often posture or cell may be set anew: each has error parameters of its own.
MOST_CASES, MOST_SETTINGS = 5000, 500
# Beyond any force, angle, mass and time, and far from where squares overflow.
MOST = 1e12


def require_sizes(document: Mapping[str, Any]) -> None:
    """Refuse a session's document, or a part of it, with something in it that is far too large.

    Raises:
        ProblemError: 422 a text, a name or a number is too large, or a case's id can stand in no address.
    """
    specimen = document.get("specimen")
    name = specimen.get("id") if isinstance(specimen, Mapping) else None
    if isinstance(name, str) and len(name) > MOST_NAME:
        raise ProblemError(422, f"a specimen's id of {len(name)} characters", f"at most {MOST_NAME}")
    cases = document.get("cases")
    listed = cases if isinstance(cases, list) else []
    if len(listed) > MOST_CASES:
        raise ProblemError(422, f"{len(listed)} load cases", f"at most {MOST_CASES}", "Make two sessions of it")
    for case in listed:
        require_case_id(case.get("id") if isinstance(case, Mapping) else None)
    plain = [case for case in listed if isinstance(case, Mapping)]
    for what, keys in (("settings of postures", ("posture", "setting")), ("mountings", ("location", "mounting"))):
        count = len({tuple(str(case.get(key)) for key in keys) for case in plain})
        if count > MOST_SETTINGS:
            raise ProblemError(422, f"{count} {what}", f"at most {MOST_SETTINGS}", "Make several sessions of it")
    for where, value in _leaves(document, ""):
        if isinstance(value, str) and len(value) > MOST_TEXT:
            raise ProblemError(422, f"{shortened(where)}: a text of {len(value)} characters", f"at most {MOST_TEXT}")
        if isinstance(value, int | float) and not abs(value) <= MOST:
            raise ProblemError(422, f"{shortened(where)} is {value:g}", f"a number within ±{MOST:g}")


def require_case_id(name: object) -> None:
    """Refuse the id of a load case that no address could name.

    Raises:
        ProblemError: 422 it is one.
    """
    sound = isinstance(name, str) and 0 < len(name) <= MOST_NAME and name.isprintable() and "/" not in name
    if not sound or name in (".", ".."):
        raise ProblemError(
            422,
            f"a case with the id {shortened(name)!r}",
            f"a short name such as c097: at most {MOST_NAME} characters that can be printed, no stroke",
        )


def _leaves(value: Any, where: str) -> Iterator[tuple[str, Any]]:
    """Yield every key and every plain value, with its place."""
    if isinstance(value, Mapping):
        for key, item in value.items():
            inner = f"{where}.{key}" if where else str(key)
            yield "a key", key
            yield from _leaves(item, inner)
    elif isinstance(value, list | tuple):
        for k, item in enumerate(value):
            yield from _leaves(item, f"{where}[{k}]")
    else:
        yield where, value
