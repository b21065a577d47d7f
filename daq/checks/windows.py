"""Look at where the windows lie: overlaps, gaps inside them, tares that have outlived their posture."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from itertools import pairwise

from daq.checks.description import case_name
from daq.checks.recording import RecordingScan
from daq.findings import Finding, finding
from daq.recordings.windows import Span
from daq.sessions.models import LoadCase, Session

# After any of these the unloaded reading is another one.
ENDS_A_TARE = ("set_posture", "move_cell", "retie", "slip")


def window_findings(session: Session, scan: RecordingScan) -> list[Finding]:
    """Find windows that hold a gap; a window may begin and end between two readings."""
    out, apart_s = [], scan.interval_s
    for case in session.cases:
        if case.excluded is not None:
            continue
        for name, window in case.windows():
            where = f"{case_name(case)}: {name}"
            gap = next((g for g in scan.gaps if g[0] + apart_s < window[1] and g[1] - apart_s > window[0]), None)
            if gap is not None:
                out.append(
                    finding(
                        "warning",
                        "gap_in_window",
                        where,
                        f"no readings from {gap[0]:.6g} to {gap[1]:.6g} s",
                        "a window without a gap",
                        "Move the window",
                    )
                )
    return out


def tare_life_findings(session: Session) -> Iterator[Finding]:
    """Find tares that serve another posture or mounting, and cases with an event since their tare."""
    states: dict[Span, dict[tuple[object, ...], str]] = defaultdict(dict)
    for case in session.cases:
        if case.excluded is not None or case.unloaded_s is None or case.loaded_s is None:
            continue
        state = (case.location, case.mounting, case.posture, case.setting)
        states[case.unloaded_s].setdefault(state, case.id)
        since = min(case.unloaded_s[1], case.loaded_s[1])
        until = max(case.unloaded_s[0], case.loaded_s[1])
        for event in session.events:
            if event.kind in ENDS_A_TARE and since < event.t_s < until:
                yield finding(
                    "warning",
                    "stale_tare",
                    f"{case_name(case)}: unloaded_s",
                    f"{event.kind} at {event.t_s:g} s lies between the tare and the load",
                    "a tare after it",
                    "Tare again, or correct the windows",
                )
    for window, users in states.items():
        if len(users) > 1:
            yield finding(
                "warning",
                "stale_tare",
                f"cases {', '.join(users.values())}: unloaded_s",
                f"one tare [{window[0]:g}, {window[1]:g}] s serves {len(users)} postures, settings or mountings",
                "a tare for each: gravity and clamping forces change with them",
                "Correct the windows",
            )


def overlap_findings(session: Session) -> list[Finding]:
    """Find windows of one case that overlap each other, and loaded windows that overlap those of another case."""
    out = []
    cases = [c for c in session.cases if c.excluded is None]
    for case in cases:
        windows = list(case.windows())
        for i, (name, window) in enumerate(windows):
            out += [
                finding(
                    "error",
                    "overlap",
                    f"{case_name(case)}: {name}",
                    f"[{window[0]:g}, {window[1]:g}] s overlaps {other} [{span[0]:g}, {span[1]:g}] s",
                    "windows apart from each other",
                    "Correct them: the same readings cannot be loaded and unloaded",
                )
                for other, span in windows[i + 1 :]
                if _overlap(window, span)
            ]
    # Neighbours in time overlap first, so one pass over the sorted windows is enough.
    spans = sorted((window, name, i) for i, case in enumerate(cases) for name, window in case.windows())
    for (first, name_a, a), (second, name_b, b) in pairwise(spans):
        if a == b or not _overlap(first, second) or (name_a != "loaded_s" and name_b != "loaded_s"):
            continue
        where = f"{case_name(cases[b])}: {name_b}"
        found = f"[{second[0]:g}, {second[1]:g}] s overlaps {name_a} of {case_name(cases[a])} "
        found += f"[{first[0]:g}, {first[1]:g}] s, which is "
        if name_a == name_b and _same_state(cases[a], cases[b]):
            same = found + "the same load: these readings count twice"
            out.append(
                finding("warning", "same_readings", where, same, "readings of its own", "Leave one of the cases out")
            )
        else:
            another = found + "another load"
            out.append(finding("error", "overlap", where, another, "one load at a time", "Correct the windows"))
    return out


def _overlap(a: Span, b: Span) -> bool:
    return max(a[0], b[0]) < min(a[1], b[1])


def _same_state(a: LoadCase, b: LoadCase) -> bool:
    return a.masses_g == b.masses_g and a.posture == b.posture and a.location == b.location
