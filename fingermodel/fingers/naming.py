"""Names within a finger file: each is known where it is used, and given once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from daq.errors import ModelError


def require_known(where: str, what: str, name: str, known: Mapping[str, object] | Sequence[str]) -> None:
    """Require that a name is among those that are known.

    Raises:
        ModelError: it is not; `where` names the file, and `what` says what the name is used for.
    """
    if name not in known:
        raise ModelError(f"{where}: {what} {name!r}", f"one of {', '.join(known) or 'none, as there are none'}")


def require_once(where: str, what: str, names: Sequence[str]) -> None:
    """Require that each name is given once.

    Raises:
        ModelError: one is not; `where` names the file, and `what` says what the names are.
    """
    for name in names:
        if names.count(name) > 1:
            raise ModelError(f"{where}: {what} {name!r}, {names.count(name)} times", "once")
