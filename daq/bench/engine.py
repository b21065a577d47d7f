"""Foundation of a bench run: readings come in, plateaus are found, windows are taken, decisions are events."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from daq.acquisition.blocks import Chunk
from daq.bench.forces import Forces, Predict, Result, stands_still, still_share, zero_moved
from daq.bench.plateau_finder import Offer, PlateauFinder, PlateauRules
from daq.bench.record import STARTED, BenchRecord, BenchSetup
from daq.bench.standing import Standing
from daq.bench.steps import Step
from daq.cells import cell_spec
from daq.errors import SessionError
from daq.journal.rows import Event
from daq.recordings.plateaus import LEAST_READINGS, Plateau, reduce_window
from daq.recordings.windows import Span
from daq.sessions.models import LoadCase
from daq.sessions.protocols import PlannedCase

Events = tuple[Event, ...]
Phase = Literal["idle", "unloaded", "loaded"]
_WARNINGS = 5
_TOO_MUCH = "take off what presses on the cell, or it may be damaged"


@dataclass(eq=False)
class TareInForce:
    """A tare, its readings as they varied, and the cases that were measured against it."""

    window_s: Span
    plateau: Plateau
    still: NDArray[np.float64]
    cases: list[str] = field(default_factory=list)


class BenchEngine:
    """State of a bench session.

    Args:
        setup: what is known beforehand.
        predict: force and half width of a wide physical band of a case; asked about validation cases only at the end.
        stream: that the readings belong to, in the journal.
        rules: of plateaus; by default those of the protocol's timing.

    Attributes:
        record: folded from the events so far.
        full_scale: (6,) of the cell [N, N mm], None where it is not known.

    Raises:
        SessionError: the setup would make an unusable session.
    """

    def __init__(
        self,
        setup: BenchSetup,
        predict: Predict | None = None,
        stream: str | None = None,
        rules: PlateauRules | None = None,
    ) -> None:
        session = setup.require_sound()
        cell = setup.load_cell
        spec = cell_spec(cell.get("model")) or cell_spec(f"{cell.get('model')} {cell.get('calibration')}")
        self.record = BenchRecord(setup)
        self.full_scale = None if spec is None else np.array(spec.range)
        self._stream = stream
        self._forces = Forces(session, predict)
        self._finder = PlateauFinder(rules or PlateauRules.of(setup.protocol.timing), self.full_scale)
        self._at = Standing.of(setup)
        self._phase: Phase = "idle"
        self._tare: TareInForce | None = None
        # The case whose weights still hang as they were read.
        self._hanging: PlannedCase | None = None
        self._tare_asked = False
        self._now_s = 0.0
        self._live: Result | None = None
        self._last: Result | None = None
        self._broke_off_s: float | None = None
        self._warnings: deque[str] = deque(maxlen=_WARNINGS)
        # What interrupted the present phase, of which was warned.
        self._told: set[str] = set()
        self._out: list[Event] = []

    def resume(self, past: Iterable[Event], plateaus: Mapping[Span, Plateau], broke_off_s: float, at_s: float) -> None:
        """Stand where a bench broke off; before `start`, which then says that it goes on. There is no tare.

        Args:
            past: its events.
            plateaus: of the windows that it took.
            broke_off_s: time of its last reading.
            at_s: time at which readings go on.
        """
        for event in past:
            if event.kind != STARTED:
                self.record.apply(event)
                self._at.apply(event)
        for window_s, plateau in plateaus.items():
            self._forces.keep(window_s, plateau)
        for weight in self.record.checks:
            self._forces.weigh(weight)
        self._broke_off_s, self._now_s = broke_off_s, at_s
        kept = [n for n in self.record.cases if n not in self.record.excluded]
        for result in self._forces.measured(self.record.session(), kept, blind=True) if kept else []:
            if result.case == self._at.last_taken:
                self._last = result

    def take(self, chunk: Chunk) -> Events:
        """Take readings, which the journal has already."""
        if not len(chunk):
            return ()
        self._now_s = float(chunk.t_s[-1])
        before = self._finder.offer
        lost = self._finder.take(chunk.t_s, chunk.wrench, (chunk.status != 0) | chunk.overload)
        offer = self._finder.offer
        if lost is not None and self._phase != "idle" and not self.record.closed:
            self._lost(lost, before)
        if offer is not None and before is None:
            self._offer(offer)
        return self._flush()

    def _mark(self, phase: Phase) -> None:
        self._require_open()
        step = self._at.steps.now
        self._phase, self._tare_asked, self._live = phase, False, None
        self._told.clear()
        self._finder.restart(self._now_s)
        if phase == "unloaded":
            self._hanging = None
        value = {"step": None if step is None else step.id}
        done = "" if step is None or step.case is None else step.case.told().get("note", "")
        self._emit(phase, **value, **({"done": done} if done and phase == "loaded" else {}))

    def _rest(self) -> None:
        self._phase, self._tare_asked, self._live = "idle", False, None
        self._finder.rest()

    def _offer(self, offer: Offer) -> None:
        step = self._at.steps.now
        self._emit("plateau_found", state=self._phase, window_s=list(offer.window_s))
        if self._phase == "loaded" and self._tare is not None:
            _, wrench = self._finder.readings(offer.window_s)
            self._warn("still", [stands_still(self._tare.still, still_share(wrench), len(wrench))])
        if self._phase == "unloaded" and self._tare_asked:
            self._confirm(offer)
        elif self._phase == "loaded" and step is not None and step.case is not None and self._tare is not None:
            case = LoadCase.model_validate(self._case_value(step, step.case, self._tare, offer.window_s))
            self._live = self._forces.live(case, offer.plateau, self._tare.plateau, blind=True)
            self._warn("doubtful_force", self._forces.doubts(case, self._live))
            self._warn("no_prediction", [self._forces.failure])

    def _confirm(self, offer: Offer) -> None:
        t, wrench = self._finder.readings(offer.window_s)
        plateau = reduce_window(t, wrench) if len(t) >= LEAST_READINGS else offer.plateau
        self._forces.keep(offer.window_s, plateau)
        step = self._at.steps.now
        if self._phase == "unloaded":
            self._take_tare(offer.window_s, plateau, still_share(wrench))
        elif step is not None and self._tare is not None:
            if step.case is None:
                self._take_weight(step, self._tare, offer.window_s)
            else:
                self._take_case(step, step.case, self._tare, offer.window_s)
            self._hanging = step.case
        self._rest()

    def _lost(self, why: str, before: Offer | None) -> None:
        if before is not None:
            self._live = None
            self._emit("plateau_lost", state=self._phase, window_s=list(before.window_s), why=why)
        over = why == self._finder.overloaded
        code, ask = ("overload", _TOO_MUCH) if over else ("not_steady", "has something slipped?")
        # Of what goes on, once; which channels are at their limit may change with every reading.
        if (what := code if over else why) not in self._told:
            self._told.add(what)
            self._warn(code, [f"{why} at {self._now_s:.1f} s while {self._phase}: {ask}"])

    def _take_tare(self, window_s: Span, plateau: Plateau, still: NDArray[np.float64]) -> None:
        before = self._tare
        brackets = [] if before is None else list(before.cases)
        self._emit("tare", window_s=list(window_s), brackets=brackets, **self._at.place)
        self._tare = TareInForce(window_s, plateau, still)
        if before is not None:
            self._warn("zero_moved", [zero_moved(before.plateau, plateau)])
        self._say_measured(brackets)

    def _take_case(self, step: Step, case: PlannedCase, tare: TareInForce, window_s: Span) -> None:
        self._emit("case_taken", **self._case_value(step, case, tare, window_s))
        tare.cases.append(step.id)
        self._say_measured([step.id])

    def _take_weight(self, step: Step, tare: TareInForce, window_s: Span) -> None:
        weight = dict(self._at.weight or {}) | {"unloaded_s": list(tare.window_s), "loaded_s": list(window_s)}
        weight = {"when": step.when, "mount": self._at.place["location"]} | weight
        self._emit("known_weight", **weight)
        numbers, doubts = self._forces.weigh(weight)
        self._emit("weighed", step=step.id, **numbers)
        self._warn("known_weight", doubts)

    def _case_value(self, step: Step, case: PlannedCase, tare: TareInForce, window_s: Span) -> dict[str, Any]:
        value = {
            "id": step.id,
            "role": case.role,
            "posture": case.posture,
            "location": case.location,
            "masses_g": dict(case.masses_g),
            "unloaded_s": list(tare.window_s),
            "loaded_s": list(window_s),
            "setting": self._at.place["setting"],
            "mounting": self._at.place["mounting"],
            "repeat_of": step.repeat_of if step.repeat_of in self.record.cases else None,
            "unloaded_state": self.record.setup.unloaded_state,
        }
        value |= {k: v for k, v in case.told().items() if k != "repeat_of"}
        return {k: v for k, v in value.items() if v is not None}

    def _say_measured(self, names: list[str]) -> None:
        kept = [n for n in names if n not in self.record.excluded]
        for result in self._forces.measured(self.record.session(), kept, blind=True) if kept else []:
            self._emit("measured", **result.as_value())
            if result.case == self._at.last_taken:
                self._last = result

    def _require_open(self) -> None:
        if self.record.closed:
            found = "the session is closed, and its predictions were seen"
            raise SessionError(found, "a new session", "Begin another")

    def _warn(self, code: str, texts: list[str]) -> None:
        for text in filter(None, texts):
            self._warnings.append(text)
            self._emit("warning", code=code, text=text)

    def _emit(self, kind: str, **value: Any) -> None:
        event = Event(kind, self._now_s, value, self._stream)
        self.record.apply(event)
        self._at.apply(event)
        self._out.append(event)

    def _flush(self) -> Events:
        out, self._out = tuple(self._out), []
        return out
