"""View of a bench for a page: steps with their weights, the next action, tare, stream, cell."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from daq.bench.steps import Step
from daq.cells import cell_spec
from daq.errors import InputError
from daq.recordings.plateaus import Plateau
from server.service.ingest.stored import stored_events
from server.service.ingest.windows import Windows
from server.service.sessions.bench_state import BenchState, Tare
from server.service.sessions.records import Record, steps_of
from server.service.storage.database import Database

# A posture is worth a tare of its own, and a long wait too: a cell of this kind drifts by hundredths of a newton in it.
STALE_TARE_S = 900.0


def bench_view(database: Database, record: Record, windows: Windows) -> dict[str, Any]:
    """Return how a session's bench stands.

    Args:
        database: that holds its events.
        record: of the session.
        windows: reduces those of its tares.
    """
    state, problem = _state(database, record)
    cell = (record.document or {}).get("load_cell") or {}
    out: dict[str, Any] = {
        "session": record.id,
        "version": record.version,
        "begun": state is not None,
        "closed": record.closed,
        "problem": problem,
        "has_readings": record.stream is not None,
        "finger": (record.document or {}).get("finger"),
        "cell": _cell(cell),
        "steps": _steps(record, state),
    }
    if state is None:
        unknown = dict.fromkeys(("now", "todo", "place", "tare", "drift", "stream"))
        return out | unknown | {"phase": "idle", "offered": False, "warnings": []}
    return out | {
        "now": None if state.now is None or state.closed else state.now.id,
        "phase": state.phase,
        "offered": state.offered,
        "todo": state.todo(),
        "place": {k: state.standing.place[k] for k in ("posture", "location")},
        "tare": None if state.tare is None else _tare(state.tare, _mean(record, state, state.tare, windows)),
        "drift": _drift(record, state, windows),
        "stream": {"id": state.stream, **vars(state.health)},
        "warnings": [w.as_dict() for w in state.warnings],
    }


def _state(database: Database, record: Record) -> tuple[BenchState | None, str | None]:
    if record.bench is None:
        return None, None if record.problem is None else str(record.problem)
    with database.reading() as connection:
        happened = stored_events(connection, record.id)
    try:
        return BenchState.of(happened), None
    except (InputError, KeyError, TypeError, ValueError, AttributeError) as error:
        # Events of another software, or of a newer one.
        return None, f"the bench's events cannot be read ({error!r:.200})"


def _cell(cell: Mapping[str, Any]) -> dict[str, Any]:
    spec = cell_spec(cell.get("model")) or cell_spec(f"{cell.get('model')} {cell.get('calibration')}")
    kept = {k: None if cell.get(k) is None else str(cell[k]) for k in ("model", "serial", "calibration")}
    # Fx Fy Fz in N, Tx Ty Tz in N mm.
    return {**kept, "range": None if spec is None else list(spec.range)}


def _steps(record: Record, state: BenchState | None) -> list[dict[str, Any]]:
    """Return the steps in order with what hangs in each; those of no protocol stand at the end."""
    listed = {s["id"]: s for s in steps_of(record)}
    taken = {c["id"]: c for c in record.amended_cases}
    planned = [] if state is None else state.standing.steps.all
    skipped: set[str] = set() if state is None else state.standing.steps.skipped
    out = []
    for step in planned:
        told = listed.pop(step.id, {"id": step.id, "text": step.text, "state": "open"})
        if told["state"] == "open" and step.id in skipped:
            told = told | {"state": "skipped"}
        if state is not None and step is state.now:
            told = told | {"text": state.standing.told(step)}
        out.append({**told, **_load(_planned(step)), "when": step.when or None})
    return out + [{**s, **_load(taken.get(name, {})), "when": None} for name, s in listed.items()]


def _planned(step: Step) -> dict[str, Any]:
    if step.case is None:
        return {}
    same = {k: getattr(step.case, k) for k in ("role", "posture", "location", "masses_g")}
    return same | {"repeat_of": step.repeat_of, "note": step.case.told().get("note")}


def _load(case: Mapping[str, Any]) -> dict[str, Any]:
    return {k: case.get(k) for k in ("role", "posture", "location", "masses_g", "repeat_of", "note")}


def _mean(record: Record, state: BenchState, tare: Tare, windows: Windows) -> Plateau | None:
    return windows.one(record.id, state.stream or record.stream, tare.window_s)


def _tare(tare: Tare, plateau: Plateau | None) -> dict[str, Any]:
    sd = None if plateau is None else np.sqrt(np.diag(plateau.covariance)).tolist()
    return {
        "window_s": list(tare.window_s),
        "mean": None if plateau is None else plateau.mean.tolist(),
        "sd": sd,
        "stale_after_s": STALE_TARE_S,
    }


def _drift(record: Record, state: BenchState, windows: Windows) -> dict[str, Any] | None:
    """Return the change between the last two tares, where both were taken in the same setting."""
    after, before = state.tare, state.before
    if after is None or before is None or dict(after.place) != dict(before.place):
        return None
    means = [_mean(record, state, tare, windows) for tare in (before, after)]
    if means[0] is None or means[1] is None:
        return None
    change = means[1].mean - means[0].mean
    return {
        "over_s": after.window_s[1] - before.window_s[1],
        "change": change.tolist(),
        "force_N": float(np.linalg.norm(change[:3])),
        "moment_Nmm": float(np.linalg.norm(change[3:])),
    }
