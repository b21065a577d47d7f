"""Amendments: the load case that was really measured, beside the one that was entered."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from daq.audit import changing
from daq.errors import SessionError
from daq.locations import data_dir
from daq.sessions import find_session, parse_session, read_amendments, read_session, session_data
from daq.sessions.amendments import other_half, write_amendments
from daq.sessions.models import Amendment, Session


def amendable(session: str) -> Path:
    """Return the folder of a session whose cases can be amended.

    Raises:
        SessionError: the session comes with the software.
    """
    folder = find_session(session).parent
    if folder.resolve().is_relative_to((data_dir() / "sessions").resolve()):
        raise SessionError(
            f"{folder.name} comes with the software and stays as it is", "a session of yours", "Copy its folder first"
        )
    return folder


def keep_amendments(session: str, folder: Path, new: Sequence[Amendment]) -> Session:
    """Write amendments beside a session and return it as it is with them; others that are made meanwhile are kept.

    Raises:
        InputError: they would make the session unusable; nothing is written.
    """
    with changing(folder) as note:
        _require_sound(session, new)
        write_amendments(folder, (*_beside(folder), *new))
        read = read_session(session)
        note("amend", read.id, {"made": [a.model_dump(mode="json", exclude_none=True) for a in new]})
    return read


def take_back(folder: Path, cases: Sequence[str]) -> list[Amendment]:
    """Remove the last amendment of each of some cases that has one, of an exchange both halves; return them.

    Raises:
        SessionError: none has one, or the other case of an exchange was amended again.
    """
    with changing(folder) as note:
        beside = _beside(folder)
        last = {one.case: k for k, one in enumerate(beside)}
        gone_at = {last[case] for case in cases if case in last}
        if not gone_at:
            named = f"case {cases[0]} has" if len(cases) == 1 else "these cases have"
            raise SessionError(f"{named} no amendment here", "one that was made with fingertwin amend")
        # Half an exchange would hang one weight twice and another never.
        for k in tuple(gone_at):
            half = other_half(beside, k)
            if half is None:
                continue
            other = beside[half].case
            if last[other] != half:
                found = f"{other} was amended again after it was exchanged with {beside[k].case}"
                raise SessionError(found, "the later amendment taken back first", f"Undo {other} first")
            gone_at.add(half)
        write_amendments(folder, tuple(one for k, one in enumerate(beside) if k not in gone_at))
        taken = [beside[k] for k in sorted(gone_at)]
        gone = [one.model_dump(mode="json", exclude_none=True) for one in taken]
        note("amend undone", folder.name, {"taken_back": gone[0] if len(gone) == 1 else gone})
    return taken


def _beside(folder: Path) -> list[Amendment]:
    return [Amendment.model_validate(a) for a in read_amendments(folder)]


def _require_sound(session: str, new: Sequence[Amendment]) -> None:
    """Refuse what would make the session unusable, before anything is written."""
    file = find_session(session)
    data = session_data(file)
    listed_too = [a.model_dump(mode="json", exclude_none=True) for a in new]
    _, faults = parse_session({**data, "amendments": [*data.get("amendments", []), *listed_too]}, file.parent)
    if faults:
        raise faults[0]
