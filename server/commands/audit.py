"""`fingertwin audit`: who changed what, and whether the trail is as it was written."""

from __future__ import annotations

import json as json_module
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from daq.audit import FILE, Entry, faults, read
from daq.errors import InputError
from server.commands.console import answer, say, table
from server.commands.service import entries_of


def show_audit(folder: Path | None, given: Mapping[str, Any], json: str | None) -> None:
    """Print a folder's trail, or the service's.

    Raises:
        InputError: it is not as it was written; the answer has been given.
    """
    entries = entries_of(given) if folder is None else _of_folder(folder)
    wrong = faults(entries)
    body = {"ok": not wrong, "faults": wrong, "entries": [asdict(e) for e in entries]}
    if not answer("audit", body, json):
        _say_trail(entries, wrong)
    if wrong:
        raise InputError(f"the trail is not as it was written: {wrong[0]}", "", "A backup shows what it was")


def _say_trail(entries: list[Entry], wrong: list[str]) -> None:
    for fault in wrong:
        say(f"error    {fault}")
    last = f"; the last has the SHA-256 {entries[-1].sha256}" if entries else ""
    say(f"{len(entries)} entries{last}" + ("" if wrong else "; all are as they were written"))
    table(
        "Changes, oldest first",
        ["n", "at (UTC)", "who", "from", "what", "about", "details"],
        [
            [e.number, e.at_utc[:19], e.who, e.origin, e.what, e.about, json_module.dumps(e.details)[:120]]
            for e in entries
        ],
    )


def _of_folder(folder: Path) -> list[Entry]:
    where = folder.parent if folder.name == FILE else folder
    if not (where / FILE).is_file():
        raise InputError(f"there is no {FILE} in {where}", "a folder in which fingertwin has changed something")
    return read(where)
