"""Rules between the parts of a session, checked on its plain data so that every fault is reported."""

from __future__ import annotations

import posixpath
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from daq.vocabulary import did_you_mean

Place = tuple[str | int, ...]
# To look for the name that was meant takes milliseconds among thousands: so many slips are helped with, the rest told.
_MOST_HINTS, _MOST_NAMED = 20, 20


@dataclass(frozen=True)
class Fault:
    """One thing that does not fit: `at` is its place as keys and indices; `found` continues that place's name."""

    at: Place
    found: str
    expected: str = ""
    remedy: str = ""


def faults_between(session: Mapping[str, Any]) -> list[Fault]:
    """List what does not agree between the parts of a session's plain data; malformed parts are passed over."""
    cases = [(i, c) for i, c in enumerate(_list(session.get("cases"))) if isinstance(c, Mapping)]
    return [
        *_readings_name(session),
        *_duplicate_ids(cases),
        *_postures(session, cases),
        *_repeats(cases),
        *_mounts(session, cases),
        *_recordings(session, cases),
        *_light_masses(session, cases),
        *_amendments(session, cases),
    ]


def _list(value: object) -> Sequence[Any]:
    return value if isinstance(value, list | tuple) else ()


def _readings_name(session: Mapping[str, Any]) -> Iterator[Fault]:
    name = session.get("readings")
    if isinstance(name, str):
        path = posixpath.normpath(name.replace("\\", "/"))
        if path.startswith(("/", "..")) or ":" in path.split("/")[0]:
            yield Fault(("readings",), f"is {name!r}", "a file inside the session's folder", "Move it there")


def _duplicate_ids(cases: Sequence[tuple[int, Mapping[str, Any]]]) -> Iterator[Fault]:
    seen: dict[str, int] = {}
    for i, case in cases:
        name = str(case.get("id"))
        if "id" in case and name in seen:
            yield Fault(("cases", i, "id"), f"is that of cases[{seen[name]}] too", "a different id for each case")
        seen.setdefault(name, i)


def _postures(session: Mapping[str, Any], cases: Sequence[tuple[int, Mapping[str, Any]]]) -> Iterator[Fault]:
    known = session.get("postures_deg")
    if not isinstance(known, Mapping):
        return
    names, meant = [str(k) for k in known], _Meant(known)
    expected = _one_of(names) if names else "postures_deg to name it"
    for i, case in cases:
        name = case.get("posture")
        if isinstance(name, str | int | float) and str(name) not in meant.known:
            found = f"is {name!r}, which postures_deg does not have"
            yield Fault(("cases", i, "posture"), found, expected, meant(str(name)))


def _repeats(cases: Sequence[tuple[int, Mapping[str, Any]]]) -> Iterator[Fault]:
    ids = _Meant(case.get("id") for _, case in cases)
    for i, case in cases:
        name = case.get("repeat_of")
        if name is None:
            continue
        if str(name) not in ids.known or str(name) == str(case.get("id")):
            yield Fault(("cases", i, "repeat_of"), f"is {name!r}", "the id of another case", ids(str(name)))


def _mounts(session: Mapping[str, Any], cases: Sequence[tuple[int, Mapping[str, Any]]]) -> Iterator[Fault]:
    cell = session.get("load_cell")
    mounts = cell.get("mounts") if isinstance(cell, Mapping) else None
    if not isinstance(mounts, Mapping) or not mounts:
        return
    remedy = "Add the mount, or correct the name"
    named = " ".join(str(m) for m in mounts)
    for i, case in cases:
        name = case.get("location")
        if name in ("tip", "bone") and name not in mounts:
            found = f"is {name}, which load_cell.mounts does not have"
            yield Fault(("cases", i, "location"), found, f"one of {named}", remedy)
    for i, check in enumerate(_list(session.get("checks"))):
        name = check.get("mount") if isinstance(check, Mapping) else None
        if name in ("tip", "bone") and name not in mounts:
            found = f"is {name}, which load_cell.mounts does not have"
            yield Fault(("checks", i, "mount"), found, f"one of {named}", remedy)


def _recordings(session: Mapping[str, Any], cases: Sequence[tuple[int, Mapping[str, Any]]]) -> Iterator[Fault]:
    if session.get("readings") is not None:
        return
    for i, case in cases:
        if "loaded_s" in case and "force_N" not in case:
            yield Fault(
                ("cases", i),
                "has windows, but the session names no readings",
                "readings: the file that the windows lie in",
                "Name the file, or give force_N",
            )
    if _list(session.get("checks")):
        yield Fault(("checks",), "have windows, but the session names no readings", "readings: the file's name")


def _light_masses(session: Mapping[str, Any], cases: Sequence[tuple[int, Mapping[str, Any]]]) -> Iterator[Fault]:
    if session.get("light_masses") is True:
        return
    listed = [("cases", i, case) for i, case in cases]
    listed += [("amendments", i, a) for i, a in enumerate(_list(session.get("amendments"))) if isinstance(a, Mapping)]
    for key, i, entry in listed:
        masses = entry.get("masses_g")
        for tendon, mass in masses.items() if isinstance(masses, Mapping) else ():
            if isinstance(mass, int | float) and 0.0 < mass < 1.0:
                yield Fault(
                    (key, i, "masses_g", str(tendon)),
                    f"is {mass:g} g; that looks like kg",
                    "a mass in grams, 1 g or more",
                    f"Is it {1000.0 * mass:g} g? If it is meant, set light_masses: true",
                )


def _amendments(session: Mapping[str, Any], cases: Sequence[tuple[int, Mapping[str, Any]]]) -> Iterator[Fault]:
    ids, postures = _Meant(case.get("id") for _, case in cases), session.get("postures_deg")
    known = _Meant(postures if isinstance(postures, Mapping) else ())
    for i, amendment in enumerate(_list(session.get("amendments"))):
        if not isinstance(amendment, Mapping):
            continue
        name, posture = amendment.get("case"), amendment.get("posture")
        if name is not None and str(name) not in ids.known:
            yield Fault(("amendments", i, "case"), f"is {name!r}", "the id of a case", ids(str(name)))
        if posture is not None and isinstance(postures, Mapping) and str(posture) not in known.known:
            found = f"is {posture!r}, which postures_deg does not have"
            yield Fault(("amendments", i, "posture"), found, _one_of(list(known.known)))


class _Meant:
    """Known names, and which of them a slip may have meant; looked for once each, and for the first slips only."""

    def __init__(self, names: Iterable[object]) -> None:
        self.known = dict.fromkeys(map(str, names))
        self._hints: dict[str, str] = {}

    def __call__(self, slip: str) -> str:
        """Return "Did you mean …?", or nothing."""
        if slip not in self._hints and len(self._hints) < _MOST_HINTS:
            self._hints[slip] = did_you_mean(slip, self.known)
        return self._hints.get(slip, "")


def _one_of(names: Sequence[str]) -> str:
    more = len(names) - _MOST_NAMED
    return f"one of {' '.join(names[:_MOST_NAMED])}" + (f" and {more} more" if more > 0 else "")
