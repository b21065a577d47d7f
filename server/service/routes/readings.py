"""Stored readings of a window of time, of a load case, and the events of a bench."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
import orjson
from fastapi import APIRouter, Query, Request
from numpy.typing import ArrayLike
from sqlalchemy import select

from daq.export.tables import CELL_FRAME
from daq.recordings.plateaus import Plateau
from daq.recordings.readings import HEADERS
from server.service.answers import JsonAnswer
from server.service.ingest.envelopes import Samples, Window
from server.service.ingest.stored import body_of_event
from server.service.schemas.common import CaseId, Limit, SessionId, documented
from server.service.schemas.readings import CaseReadingsShown, EventsShown, ReadingsShown
from server.service.services import of
from server.service.sessions.records import WINDOWS
from server.service.storage.schema import events
from server.service.web.problems import ProblemError, not_found
from server.service.web.strict_requests import ReadingRoute

router = APIRouter(route_class=ReadingRoute, prefix="/sessions/{session}", tags=["readings"])

CHANNELS = HEADERS[1:]
_LATEST = 1e9
From = Annotated[
    float | None, Query(ge=-_LATEST, le=_LATEST, allow_inf_nan=False, description="First time [s]; else the stream's.")
]
To = Annotated[
    float | None, Query(ge=-_LATEST, le=_LATEST, allow_inf_nan=False, description="Last time [s]; else the stream's.")
]
Points = Annotated[
    int, Query(ge=2, le=10_000, description="So many readings come as they are; of more, so many envelopes at most.")
]
Stream = Annotated[
    str | None, Query(max_length=100, description="Id of the stream; else the one that windows are told in.")
]
Margin = Annotated[float, Query(ge=0.0, le=60.0, allow_inf_nan=False, description="Before and after each window [s].")]
Kind = Annotated[str | None, Query(max_length=60, description="Events of this kind only.", examples=["tare"])]
After = Annotated[int, Query(ge=0, le=1 << 53, description="Those that came after this one.")]


@router.get("/readings", responses=documented(ReadingsShown))
def readings(
    session: SessionId,
    request: Request,
    from_s: From = None,
    to_s: To = None,
    points: Points = 1000,
    stream: Stream = None,
) -> JsonAnswer:
    """Return the stored readings of a window: each of them where they are few, else least and most of each stretch.

    Every reading lies in one stretch, so no peak is lost. Nothing is corrected: the axes are the cell's own, and the
    tare is not taken off.
    """
    parts = of(request)
    parts.sessions.version(session)
    # A stream that begins changes no session that is known already.
    named = stream or parts.measuring.of(session).record.stream or parts.sessions.read(session).stream
    if named is None:
        raise _without_readings(session)
    found = parts.envelopes.window(session, named, from_s, to_s, points)
    head = {"schema": "fingertwin/readings/1", "session": session}
    return JsonAnswer(head | _shown(found, named))


@router.get("/cases/{case}/readings", responses=documented(CaseReadingsShown))
def case_readings(
    session: SessionId, case: CaseId, request: Request, points: Points = 500, margin_s: Margin = 1.0
) -> JsonAnswer:
    """Return the windows of a load case: their readings, and what each was reduced to, in the cell's own axes."""
    parts = of(request)
    record = parts.measuring.of(session).record
    found = next((c for c in record.cases if c["id"] == case), None)
    if found is None:
        raise not_found("case", case, f"/api/v1/sessions/{session}/cases")
    windows = {name: (float(found[name][0]), float(found[name][1])) for name in WINDOWS if found.get(name)}
    if not windows:
        raise ProblemError(
            409,
            f"case {case} has a force and no windows",
            "a case with windows in readings",
            "Its force was typed in: read it from the case itself",
        )
    if record.stream is None:
        raise _without_readings(session)
    reduced = parts.windows.reduce(session, record.stream, {w: f"case {case}: {n}" for n, w in windows.items()})
    rows = []
    for name, window in windows.items():
        plateau, failed = reduced.plateaus.get(window), reduced.failed.get(window)
        around = window[0] - margin_s, window[1] + margin_s
        seen = parts.envelopes.window(session, record.stream, *around, points)
        rows.append(
            {
                "name": name,
                "window_s": window,
                "state": "measured" if plateau else "failed" if failed else "waiting",
                "why": str(failed) if failed else reduced.waiting.get(window, ""),
                "plateau": None if plateau is None else _plateau(plateau),
                "readings": _shown(seen, record.stream),
            }
        )
    head = {"schema": "fingertwin/case-readings/1", "session": session, "session_version": record.version}
    return JsonAnswer(head | {"case": case, "windows": rows})


@router.get("/events", responses=documented(EventsShown))
def event_list(
    session: SessionId, request: Request, kind: Kind = None, limit: Limit = 100, after: After = 0
) -> JsonAnswer:
    """Return what happened at the bench, as it was sent, in the order in which it came."""
    parts = of(request)
    parts.sessions.version(session)
    query = select(events).where((events.c.session == session) & (events.c.arrival > after)).order_by(events.c.arrival)
    rows: list[dict[str, Any]] = []
    with parts.database.reading() as connection, connection.execute(query.execution_options(yield_per=256)) as found:
        for row in found:
            body = orjson.loads(body_of_event(row))
            if kind is None or body.get("kind") == kind:
                rows.append(body | {"epoch": row.epoch, "number": row.number, "arrival": row.arrival})
            if len(rows) > limit:
                break
    more = len(rows) > limit
    rows = rows[:limit]
    return JsonAnswer(
        {
            "schema": "fingertwin/events/1",
            "session": session,
            "events": rows,
            "next": rows[-1]["arrival"] if more else None,
        }
    )


def _shown(window: Window, stream: str) -> dict[str, Any]:
    found = window.found
    raw = isinstance(found, Samples)
    out: dict[str, Any] = {
        "stream": stream,
        "kind": "raw" if raw else "envelope",
        "frame": CELL_FRAME,
        "window_s": window.window_s,
        "stream_s": window.stream_s,
        "missing_s": window.missing_s,
    }
    if isinstance(found, Samples):
        out |= {"samples": len(found.t_s), "flagged_samples": int(found.flagged.sum())}
        return out | {"t_s": found.t_s, "values": _channels(found.wrench), "flagged": found.flagged.astype(np.int64)}
    out |= {"samples": int(found["count"].sum()), "flagged_samples": int(found["flagged"].sum())}
    columns = {k: np.ascontiguousarray(found[k]) for k in ("from_s", "to_s", "count", "flagged")}
    # Single precision is a 10⁻⁷ of what they are.
    return out | columns | {k: _channels(found[k].astype(np.float32)) for k in ("least", "most")}


def _channels(values: Any) -> dict[str, Any]:
    return {name: np.ascontiguousarray(values[:, i]) for i, name in enumerate(CHANNELS)}


def _plateau(plateau: Plateau) -> dict[str, Any]:
    def by_channel(values: ArrayLike, unit: str = "") -> dict[str, float]:
        return {f"{name}{unit}": float(v) for name, v in zip(CHANNELS, np.asarray(values), strict=True)}

    return {
        "readings": plateau.readings,
        "start_s": plateau.start_s,
        "end_s": plateau.end_s,
        "mean": by_channel(plateau.mean),
        "sd": by_channel(plateau.sd),
        "sd_of_mean": by_channel(np.sqrt(np.diag(plateau.covariance))),
        "slope_per_s": by_channel(plateau.slope_per_s, "_per_s"),
        "slope_sd_per_s": by_channel(plateau.slope_sd_per_s, "_per_s"),
        "effective": {k.split("_")[0]: v for k, v in by_channel(plateau.effective).items()},
        "flagged": plateau.flagged,
        "steady": plateau.steady,
    }


def _without_readings(session: str) -> ProblemError:
    return ProblemError(
        409,
        f"session {session} has no readings",
        "a session with a stream",
        "Send its readings first; forces that were typed in have none",
    )
