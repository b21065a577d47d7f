"""`fingertwin amend`: say what a load case really was; what was entered stays, and everything heeds the amendment."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from daq.errors import InputError
from daq.quoting import quoted
from daq.sessions import read_session
from daq.sessions.amendments import amended_lines, amendments_of, block_of, exchanged, listed, words
from daq.sessions.models import Amendment, Session
from server.application.amending import amendable, keep_amendments, take_back
from server.commands.console import answer, say
from server.commands.entries import once, pair

# What `--tendon`, `--mass` and `--weight` give.
_TENDON, _MASS = "TRUE=ENTERED, such as FDS=FDP", "TENDON=GRAMS, such as FDP=950"
_WEIGHT = "TRUE=ENTERED in grams, such as 550=484"


def amend_case(
    session: str,
    case: str | None,
    *,
    tendon: Sequence[str],
    mass: Sequence[str],
    weight: Sequence[str],
    posture: str | None,
    location: str | None,
    exchange: str | None,
    exclude: bool,
    undo: bool,
    why: str | None,
    by: str | None,
    json: str | None,
) -> None:
    """Amend a case, take its last amendment back, or list what was amended; see `fingertwin amend --help`."""
    changes = bool(tendon or mass or weight or posture or location or exchange or exclude)
    read = read_session(session)
    if case is None:
        if changes or undo:
            raise InputError("no load case given", "fingertwin amend SESSION CASE …", "Name the case that was wrong")
        _tell(session, read, [], json)
        return
    folder, cases = amendable(session), block_of(read, case)
    if undo:
        if changes:
            raise InputError("--undo beside a change", "one of them", "Undo first, then amend")
        taken = take_back(folder, [c.id for c in cases])
        _tell(session, read_session(session), [], json, taken)
        return
    if not changes:
        raise InputError(
            f"nothing to amend in case {case}",
            "--tendon, --mass, --weight, --posture, --mount, --exchange or --exclude",
            "Say what it was",
        )
    if why is None:
        raise InputError("an amendment without a reason", '--why "…"', "Say how it is known")
    if exchange is not None:
        if tendon or mass or weight or posture or location or exclude:
            raise InputError("--exchange beside another change", "one of them", "Amend in two steps")
        if len(cases) > 1:
            raise InputError(f"--exchange with {len(cases)} cases", "two cases", "Name one, and the other one after it")
        new = list(exchanged(read, case, exchange, why, by))
    else:
        hung, weighed = (pair(t, "--tendon", _TENDON) for t in tendon), (pair(m, "--mass", _MASS) for m in mass)
        weights = ([_grams(value, _WEIGHT) for value in pair(w, "--weight", _WEIGHT)] for w in weight)
        new = amendments_of(
            read,
            cases,
            why,
            tendons=once(((entered, true) for true, entered in hung), "--tendon for"),
            masses_g=once(((name, _grams(value, _MASS)) for name, value in weighed), "--mass"),
            weights_g=once(((entered, true) for true, entered in weights), "--weight for"),
            posture=posture,
            location=location,
            exclude=exclude,
            by=by,
        )
    _tell(session, keep_amendments(session, folder, new), new, json)


def _tell(
    session: str, read: Session, new: Sequence[Amendment], json: str | None, taken: Sequence[Amendment] = ()
) -> None:
    """Show what was taken back, then what is amended now; nothing where the answer takes standard output."""
    rows = listed(read)
    body: dict[str, Any] = {"session": read.id, "amendments": rows, "made": [a.case for a in new]}
    if answer("amend", body, json):
        return
    for one in taken:
        say(f"Taken back: {one.case}: {words(one)}.")
    if not rows:
        # Named as it was asked for: a copied folder keeps the id of what it was copied from.
        say(f"{session}: nothing is amended{' any more' if taken else ''}.")
    for row in rows:
        say(*amended_lines([row]))
    if new:
        again = f"fingertwin diagnose {quoted(session)}"
        say(f"The entries stay in session.yaml. Look again: {again}; take it back with --undo.")


def _grams(text: str, expected: str) -> float:
    try:
        value = float(text.removesuffix("g"))
    except ValueError as error:
        raise InputError(f"{text!r} is no mass", expected) from error
    if not 0.0 <= value < 1e6:
        raise InputError(
            f"{text} g", "a mass of 0 g or more", "Leave the case out with --exclude where it is not known"
        )
    return value
