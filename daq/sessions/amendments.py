"""Amendments: what a load case really was, kept beside the session; what was entered stays as it is.

They lie in `amendments.yaml` in the session's folder, or under `amendments` in a copy of its description.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from datetime import UTC, datetime
from math import isclose
from pathlib import Path
from typing import Any

import yaml

from daq.errors import InputError, SessionError
from daq.files import replacing
from daq.sessions import AMENDMENTS_FILE, AMENDMENTS_FORMAT
from daq.sessions.models import Amendment, LoadCase, Session
from daq.vocabulary import LOCATIONS, TENDONS, did_you_mean

# Relative difference within which two masses are one: each is written in decimals.
_SAME_MASS = 1e-6
# Cases named one by one in a line.
_MOST_NAMED = 4


def amendment(session: Session, case: str, why: str, **really: Any) -> Amendment:
    """Say what a case really was, by its id; the rest as of `amendments_of`."""
    return amendments_of(session, [case_of(session, case)], why, **really)[0]


def amendments_of(
    session: Session,
    cases: Sequence[LoadCase],
    why: str,
    *,
    tendons: Mapping[str, str] | None = None,
    masses_g: Mapping[str, float] | None = None,
    weights_g: Mapping[float, float] | None = None,
    posture: str | None = None,
    location: str | None = None,
    exclude: bool = False,
    by: str | None = None,
) -> list[Amendment]:
    """Say what some cases really were; of many, those in which it is a change.

    Args:
        session: as read; earlier amendments of a case are heeded.
        cases: of it.
        why: how it is known.
        tendons: the tendon that bore the weight, by the one that was entered; two that both bore one are exchanged.
        masses_g: what really hung [g], by tendon; 0 for nothing. Other tendons keep what was entered.
        weights_g: what a weight really weighs [g], by what was entered wherever it hung; two may be exchanged.
        posture: that was really set.
        location: where the cell really was.
        exclude: whether to leave the cases out.
        by: who says so.

    Raises:
        SessionError: no such tendon, weight or posture, or nothing that changes.
    """
    if not why.strip():
        raise SessionError("an amendment without a reason", "why, in some words")
    _expect_known([*(tendons or {}).values(), *(masses_g or {})], TENDONS, "tendon")
    _expect_known([posture] if posture is not None else [], session.postures_deg, "posture")
    _expect_known([location] if location is not None else [], LOCATIONS, "mount")
    entries = [case_of(session.amended, case.id) for case in cases]
    _expect_hung(weights_g or {}, entries)
    at, out = datetime.now(UTC).isoformat(timespec="seconds"), []
    for case, entry in zip(cases, entries, strict=True):
        moved = dict(tendons or {})
        if len(cases) > 1:
            moved = {entered: true for entered, true in moved.items() if entered in entry.masses_g}
        masses = _moved(entry.masses_g, moved, case.id)
        masses = {t: _weighed(g, weights_g or {}) for t, g in masses.items()}
        masses |= {t: float(g) for t, g in (masses_g or {}).items()}
        masses = {tendon: grams for tendon, grams in masses.items() if grams > 0.0}
        changes: dict[str, Any] = {}
        if masses != entry.masses_g:
            changes["masses_g"] = masses
        if posture is not None and posture != entry.posture:
            changes["posture"] = posture
        if location is not None and location != entry.location:
            changes["location"] = location
        if exclude and entry.excluded is None:
            changes["excluded"] = why
        if changes:
            out.append(Amendment(case=case.id, why=why, at=at, by=by, **changes))
    if not out:
        which = f"case {cases[0].id} is" if len(cases) == 1 else f"these {len(cases)} cases are"
        raise SessionError(f"{which} so already", "something that differs from what is entered")
    return out


def exchanged(session: Session, case: str, other: str, why: str, by: str | None = None) -> tuple[Amendment, Amendment]:
    """Say that two cases were entered in each other's place: their weights and postures."""
    a, b = case_of(session.amended, case), case_of(session.amended, other)
    if (a.masses_g, a.posture) == (b.masses_g, b.posture):
        raise SessionError(f"cases {case} and {other} have the same entry", "two that differ")
    at = datetime.now(UTC).isoformat(timespec="seconds")
    pair = ((case, b, other), (other, a, case))
    first, second = (
        Amendment(
            case=one, masses_g=dict(to.masses_g), posture=to.posture, why=f"{_exchanged_with(of)}{why}", at=at, by=by
        )
        for one, to, of in pair
    )
    return first, second


def other_half(amendments: Sequence[Amendment], k: int) -> int | None:
    """Return the place of the amendment that is one exchange with the k-th, None where that is no exchange."""
    one = amendments[k]
    for j in (k - 1, k + 1):
        if 0 <= j < len(amendments):
            other = amendments[j]
            naming = one.why.startswith(_exchanged_with(other.case)), other.why.startswith(_exchanged_with(one.case))
            if all(naming) and one.at == other.at:
                return j
    return None


def block_of(session: Session, named: str) -> list[LoadCase]:
    """Return load cases as they were entered: one by its id, or those that all parts of a name hold for.

    Args:
        session: as read.
        named: parts joined by commas: `all`, a posture, `tip` or `bone`, `c017..` (from it on) or `c017..c032`.

    Raises:
        SessionError: a part that names nothing, or no case for which all hold.
    """
    cases, ids = list(session.entered.cases), [c.id for c in session.entered.cases]
    if named in ids:
        return [cases[ids.index(named)]]
    for part in named.split(","):
        first, dots, last = part.partition("..")
        if dots:
            for end in (first, last):
                if end and end not in ids:
                    raise SessionError(
                        f"no case {end} in {session.id}", "the id of a load case", did_you_mean(end, ids)
                    )
            span = ids[ids.index(first) if first else 0 : ids.index(last) + 1 if last else None]
            cases = [c for c in cases if c.id in span]
        elif part in session.postures_deg or part in ("tip", "bone"):
            cases = [c for c in cases if part in (c.posture, c.location)]
        elif part != "all":
            known = [*ids, *session.postures_deg, "tip", "bone", "all"]
            expected = "the id of a load case, a posture, tip, bone, all, or a range such as c017.."
            raise SessionError(f"no case {part} in {session.id}", expected, did_you_mean(part, known))
    if not cases:
        raise SessionError(f"no case is {named.replace(',', ' and ')} in {session.id}", "parts that hold together")
    return cases


def case_of(session: Session, name: str) -> LoadCase:
    """Return a load case by its id.

    Raises:
        SessionError: there is none.
    """
    for case in session.cases:
        if case.id == name:
            return case
    hint = did_you_mean(name, [c.id for c in session.cases])
    raise SessionError(f"no case {name} in {session.id}", "the id of a load case", hint)


def write_amendments(folder: Path, amendments: tuple[Amendment, ...]) -> Path:
    """Write the amendments of the session in a folder; without any, the file goes.

    Raises:
        InputError: the folder cannot be written to.
    """
    file = folder / AMENDMENTS_FILE
    try:
        if not amendments:
            file.unlink(missing_ok=True)
            return file
        listed = [a.model_dump(mode="json", exclude_none=True) for a in amendments]
        with replacing(file) as temporary:
            temporary.write_text(
                yaml.safe_dump(
                    {"format": AMENDMENTS_FORMAT, "amendments": listed}, sort_keys=False, allow_unicode=True
                ),
                encoding="utf-8",
            )
    except OSError as error:
        raise InputError(f"{file} cannot be written ({error.strerror})", "a folder that may be written to") from error
    return file


def listed(session: Session) -> list[dict[str, Any]]:
    """Return the amendments with the original entries, for answers, exports and pages."""
    entries = {c.id: c for c in session.entered.cases}
    return [
        {
            "case": a.case,
            "words": words(a),
            "why": a.why,
            "at": a.at,
            "by": a.by,
            "entered": {name: getattr(entries[a.case], name) for name in a.changes},
            "now": a.changes,
        }
        for a in session.amendments
    ]


def words(amended: Amendment) -> str:
    """Describe the load that a case is taken for."""
    parts = []
    if amended.masses_g is not None:
        hung = " and ".join(f"{tendon} {grams:g} g" for tendon, grams in amended.masses_g.items())
        parts.append(f"{hung or 'no weight'} hung")
    if amended.posture is not None:
        parts.append(f"the posture was {amended.posture}")
    if amended.location is not None:
        parts.append(f"the cell was at the {amended.location}")
    if amended.excluded is not None:
        parts.append("left out")
    return ", ".join(parts)


def amended_lines(rows: Iterable[Mapping[str, Any]]) -> list[str]:
    """Return the amendments `listed`, cases that were amended alike on one line."""
    alike: dict[str, list[str]] = {}
    for row in rows:
        alike.setdefault(_amended(row), []).append(str(row["case"]))
    return [f"Amended {_some(cases)}: {what}" for what, cases in alike.items()]


def _some(cases: Sequence[str]) -> str:
    """Some cases, the first of them by name where they are many."""
    *first, last = cases
    if len(cases) > _MOST_NAMED:
        first, last = first[: _MOST_NAMED - 1], f"{len(cases) - _MOST_NAMED + 1} more"
    return f"{', '.join(first)} and {last}" if first else last


def _amended(row: Mapping[str, Any]) -> str:
    """Return what an amendment changes, and why."""
    entered = []
    for name, value in row["entered"].items():
        if isinstance(value, dict):
            entered.append(" and ".join(f"{m} {g:g} g" for m, g in value.items()) or "no weight")
        elif name != "excluded":
            entered.append(str(value))
    instead = f" (entered: {', '.join(entered)})" if entered else ""
    return f"{row['words']}{instead}; {row['why']} [{row['at']}]"


def _exchanged_with(case: str) -> str:
    return f"exchanged with {case}: "


def _expect_known(names: Iterable[str], known: Collection[str], what: str) -> None:
    """Refuse a name that is not known."""
    for name in names:
        if name not in known:
            raise SessionError(f"{what} {name!r}", f"one of {' '.join(known)}", did_you_mean(name, known))


def _expect_hung(weights_g: Iterable[float], entries: Sequence[LoadCase]) -> None:
    """Refuse a weight that hangs in none of the cases."""
    hung = sorted({grams for entry in entries for grams in entry.masses_g.values()})
    for weight in weights_g:
        if not any(isclose(weight, grams, rel_tol=_SAME_MASS) for grams in hung):
            used = ", ".join(f"{grams:g}" for grams in hung) or "none"
            raise SessionError(f"no weight of {weight:g} g in these cases", f"one that was entered [g]: {used}")


def _weighed(entered_g: float, weights_g: Mapping[float, float]) -> float:
    """Return what a mass really was, by what one of the weights weighs."""
    known = (true for entered, true in weights_g.items() if isclose(entered, entered_g, rel_tol=_SAME_MASS))
    return float(next(known, entered_g))


def _moved(masses: Mapping[str, float], tendons: Mapping[str, str], case: str) -> dict[str, float]:
    """Return masses with tendons' weights on others, all at once; where both bore one, exchanged."""
    exchange: dict[str, str] = {}
    for entered, true in tendons.items():
        if entered not in masses:
            found = " and ".join(masses) or "no tendon"
            raise SessionError(f"case {case} loads {found}, not {entered}", "the tendon that was entered")
        if true in masses:
            exchange.setdefault(true, entered)
        exchange[entered] = true
    return {exchange.get(tendon, tendon): grams for tendon, grams in masses.items()}
