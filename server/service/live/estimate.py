"""Live estimate of a hanging weight's force against its prediction, from a bench's events and live traces.

It is what the bench itself shows (`daq.bench`), made again where everybody looks: the same search for a plateau, on
envelopes instead of readings, the same reduction, and the same silence about validation cases until the end.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from concurrent.futures import Executor, Future
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from daq.bench.forces import Forces, Predict
from daq.bench.plateau_finder import PlateauFinder, PlateauRules
from daq.bench.record import STARTED, BenchSetup
from daq.cells import FULL_SCALE_SHARE, cell_spec
from daq.journal.rows import Event
from daq.recordings.plateaus import LEAST_READINGS, Plateau, reduce_window
from daq.recordings.windows import Span
from daq.sessions.models import LoadCase
from fingermodel.fingers.files import finger_names
from server.service.live.traces import Rows
from server.service.sessions.turns import Made

MakePredict = Callable[[BenchSetup], Predict]
Tares = Callable[[str, str | None, Span], Plateau | None]

# What ends the search for a plateau; of these, what ends a tare's life too.
_ENDS_TARE = frozenset({"set_posture", "move_cell", "retie", "slip", "closed"})
_ENDS_PHASE = _ENDS_TARE | {"unloaded", "tare", "case_taken", "known_weight", "known_weight_set", "step"}
# Until there is a plateau, the mean of the last second is shown.
LATEST_S = 1.0
# A tare whose envelopes begin so much later, or end so much earlier, is not whole.
_EDGE_S = 0.1
_MOST_PREDICTIONS = 16


class Predictions:
    """Predicts the identification cases of benches, beside everything else, once for each setup.

    Args:
        make: returns what predicts; None where nothing is predicted.
        beside: where that is computed.
    """

    def __init__(self, make: MakePredict | None, beside: Executor) -> None:
        self._make, self._beside = make, beside
        self._known: Made[Future[Predict]] = Made(_MOST_PREDICTIONS)

    def of(self, setup: BenchSetup) -> Future[Predict] | None:
        """Begin to compute what predicts the identification cases: of validation cases the model is not even told."""
        blocks = [b for b in setup.protocol.blocks if b.role == "identification"]
        make = self._make
        if make is None or not blocks:
            return None
        shown = replace(setup, protocol=setup.protocol.model_copy(update={"blocks": blocks}))
        key = json.dumps(shown.as_value(), sort_keys=True, default=str)
        return self._known.of(key, lambda: self._beside.submit(make, shown))


class SessionEstimate:
    """Follows the bench of a session, whatever begins there.

    Args:
        session: its id.
        predictions: of cases.
        tares: returns a window of stored readings, reduced, where it is all there.
    """

    def __init__(self, session: str, predictions: Predictions, tares: Tares | None = None) -> None:
        self._session, self._predictions, self._tares = session, predictions, tares
        self._bench: BenchEstimate | None = None

    def event(self, event: Event) -> None:
        """Take what happened, in order.

        Raises:
            InputError, KeyError, TypeError, ValueError: it is no event of a bench.
        """
        if event.kind == STARTED:
            self._bench = None
            setup = BenchSetup.of_value(event.value)
            known = setup.finger in finger_names()
            # Of another it is a file of the bench's: it is not looked for here, and its plan needs no finger.
            told = self._predictions.of(setup) if known else None
            setup = setup if known else replace(setup, finger=finger_names()[0])
            self._bench = BenchEstimate(self._session, setup, event.stream, told, self._tares)
        elif self._bench is not None:
            self._bench.event(event)

    def trace(self, stream: str, rows: Rows) -> None:
        """Take envelopes of a stream, in order."""
        if self._bench is not None:
            self._bench.trace(stream, rows)

    @property
    def hanging(self) -> bool:
        """True if a case hangs."""
        return self._bench is not None and self._bench.hanging

    def estimate(self) -> dict[str, Any] | None:
        """Return what hangs now, None where no case does or nothing is new."""
        return None if self._bench is None else self._bench.estimate()


class BenchEstimate:
    """Follows one bench from its start.

    Args:
        session: its id.
        setup: of the bench.
        stream: of its readings; None where all are.
        told: what predicts its cases, as soon as it is there; None where nothing does.
        tares: returns a window of stored readings, reduced, where it is all there.

    Raises:
        SessionError: the setup would make an unusable session.
    """

    def __init__(
        self,
        session: str,
        setup: BenchSetup,
        stream: str | None,
        told: Future[Predict] | None,
        tares: Tares | None,
    ) -> None:
        planned, cell = setup.require_sound(), setup.load_cell
        spec = cell_spec(cell.get("model")) or cell_spec(f"{cell.get('model')} {cell.get('calibration')}")
        full_scale = None if spec is None else np.array(spec.range)
        self._session, self._stream, self._told, self._tares = session, stream, told, tares
        self._limit = np.full(6, np.inf) if full_scale is None else FULL_SCALE_SHARE * full_scale
        self._finder = PlateauFinder(PlateauRules.of(setup.protocol.timing), full_scale)
        self._forces = Forces(planned, self._predict)
        self._cases = {c.id: c for c in planned.cases}
        self._repeats: dict[str, str] = {}
        self._case: LoadCase | None = None
        self._tare_s: Span | None = None
        self._tare: Plateau | None = None
        self._now_s, self._since_s, self._news = -np.inf, 0.0, False

    def event(self, event: Event) -> None:
        """Take what happened after the start, in order."""
        value = event.value
        if event.kind in _ENDS_TARE:
            self._tare_s = self._tare = None
        if event.kind in _ENDS_PHASE:
            self._case = None
            self._finder.rest()
        if event.kind == "tare":
            start, end = value["window_s"]
            self._tare_s, self._tare = (float(start), float(end)), None
            self._find_tare()
        elif event.kind == "step" and value.get("repeat_of") is not None:
            self._repeats[str(value["id"])] = str(value["repeat_of"])
        elif event.kind == "loaded":
            name = str(value.get("step"))
            planned = self._cases.get(self._repeats.get(name, name))
            self._case = None if planned is None else planned.model_copy(update={"id": name})
            self._since_s = event.at_s
            self._finder.restart(event.at_s)

    def trace(self, stream: str, rows: Rows) -> None:
        """Take envelopes of a stream, in order; those that hold no reading of some component are passed over."""
        if self._stream not in (None, stream) or not len(rows):
            return
        t = 0.5 * (rows["from_s"] + rows["to_s"])
        if t[-1] < self._now_s - LATEST_S:
            self._now_s = -np.inf  # another time has begun
        later = t > np.maximum.accumulate(np.append(self._now_s, t))[:-1]
        wanted = later & np.isfinite(rows["mean"]).all(axis=1)
        t, rows = t[wanted], rows[wanted]
        if not len(t):
            return
        beyond = np.fmax(np.abs(rows["least"]), np.abs(rows["most"])) >= self._limit
        self._finder.take(t, rows["mean"], rows["overload"] | beyond.any(axis=1))
        self._now_s, self._news = float(t[-1]), True

    @property
    def hanging(self) -> bool:
        """True if a case hangs."""
        return self._case is not None

    def estimate(self) -> dict[str, Any] | None:
        """Return what hangs now, where a case hangs, a tare is in force, and there is anything new."""
        if self._case is None or self._tare_s is None or not self._news:
            return None
        self._news = False
        case, offer = self._case, self._finder.offer
        window_s = (max(self._since_s, self._now_s - LATEST_S), self._now_s) if offer is None else offer.window_s
        if self._tare is None:
            self._find_tare()
        out: dict[str, Any] = {
            "case": case.id, "role": case.role, "stream": self._stream, "at_s": self._now_s,
            "window_s": list(window_s), "steady": offer is not None, "why": "" if offer else self._finder.reason,
            "force_N": None, "sd_N": None, "predicted_N": None, "band_N": None, "outside": None,
            "prediction": self._state(case), "doubts": [],
        }  # fmt: skip
        loaded = self._latest(window_s) if offer is None else offer.plateau
        if self._tare is None or loaded is None:
            return out | {"why": "the tare's readings are not here yet" if self._tare is None else "too few readings"}
        result = self._forces.live(case, loaded, self._tare, blind=True)
        doubts = [] if offer is None else self._forces.doubts(case, result)
        failure = [self._forces.failure] if self._forces.failure else []
        return out | result.as_value() | {"prediction": self._state(case), "doubts": [*doubts, *failure]}

    def _predict(self, case: LoadCase) -> Any:
        return None if self._told is None or not self._told.done() else self._told.result()(case)

    def _state(self, case: LoadCase) -> Literal["hidden", "none", "pending", "failed", "given"]:
        """Return the agreement with the prediction; hidden for a validation case until the session is closed."""
        if case.role == "validation":
            return "hidden"
        if self._told is None:
            return "none"
        if not self._told.done():
            return "pending"
        return "failed" if self._forces.failure else "given"

    def _find_tare(self) -> None:
        """Reduce the tare: of envelopes where they are held, or of what is stored."""
        if self._tare_s is None:
            return
        t, wrench = self._finder.readings(self._tare_s)
        edge_s = max(_EDGE_S, self._finder.interval_s)
        if len(t) >= LEAST_READINGS and t[0] <= self._tare_s[0] + edge_s and t[-1] >= self._tare_s[1] - edge_s:
            self._tare = reduce_window(t, wrench)
        elif self._tares is not None:
            self._tare = self._tares(self._session, self._stream, self._tare_s)

    def _latest(self, window_s: Span) -> Plateau | None:
        t, wrench = self._finder.readings((window_s[0], window_s[1] + 1e-9))
        return reduce_window(t, wrench) if len(t) >= LEAST_READINGS else None
