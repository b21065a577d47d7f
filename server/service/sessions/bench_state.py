"""State of a bench, folded from its events: steps done, the next step, the tare in force, and present faults.

A warning stands as long as its cause does; what is done again, or put right, takes it away.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from daq.bench.record import RESUMED, STARTED, BenchSetup
from daq.bench.standing import Standing
from daq.bench.status import next_of
from daq.bench.steps import Step
from daq.journal.rows import Event
from daq.recordings.windows import Span
from daq.sessions.protocols import PlannedCase

# What ends a tare's life, and what ends the search for a plateau.
_ENDS_TARE = frozenset({"set_posture", "move_cell", "retie", "slip", RESUMED})
_ENDS_PHASE = _ENDS_TARE | {"tare", "case_taken", "known_weight", "step", "closed"}
_CHANGES_LOAD = _ENDS_TARE | {"unloaded", "loaded", "tare", "step", "closed"}
# Title, what to do, and what ends it, by the code of a warning.
_WARNINGS: Mapping[str, tuple[str, str, frozenset[str]]] = {
    "doubtful_force": (
        "The force can hardly be right",
        "Leave it on and look: right tendon, right weight, nothing touching?",
        _CHANGES_LOAD | {"plateau_found", "plateau_lost", "excluded"},
    ),
    "not_steady": (
        "It has not come to rest",
        "Leave it alone and wait. If something slipped, mark it slipped, and tare.",
        _CHANGES_LOAD | {"plateau_found", "case_taken"},
    ),
    "overload": (
        "A channel is at its limit",
        "Take weight off: the cell can be damaged. Then tare, and look at the known weight again.",
        _CHANGES_LOAD | {"plateau_found", "case_taken"},
    ),
    "still": (
        "A channel stands still",
        "Look at its cable and its amplifier before you confirm.",
        _CHANGES_LOAD | {"plateau_found", "plateau_lost", "excluded"},
    ),
    "zero_moved": (
        "The zero has moved",
        "Take everything off and tare again; if it moves again, look at clamp and cable.",
        _ENDS_TARE | {"tare", "closed"},
    ),
    "known_weight": (
        "The known weight reads wrong",
        "Check its mass, direction and mount, and weigh it again.",
        frozenset({"step", "known_weight_set", "known_weight", "closed"}),
    ),
    "no_prediction": (
        "There is no prediction",
        "Go on: the force is measured all the same.",
        _CHANGES_LOAD,
    ),
    "displaced": (
        "The log's file was taken away",
        "All goes into another one: leave its folder alone.",
        frozenset({"ended"}),
    ),
    "disk": ("The bench's disk is nearly full", "Make room on it, or logging stops.", frozenset({"ended"})),
}
_UNKNOWN: tuple[str, str, frozenset[str]] = ("The bench warns", "Look before the weight comes off.", _CHANGES_LOAD)


@dataclass
class StreamHealth:
    """History of the load cell's stream: gaps, losses, overloads."""

    # Waiting for readings, streaming, silent, lost (the cable), or ended; why: of a lost one.
    state: Literal["waiting", "streaming", "silent", "lost", "ended"] = "waiting"
    why: str = ""
    since_s: float | None = None  # when that began, in the stream's time [s]
    gaps: int = 0
    lost_samples: int = 0
    overloads: int = 0
    damaged: int = 0
    overloaded: bool = False  # whether the load is beyond the cell's range now
    last_gap_s: float | None = None

    def apply(self, event: Event) -> None:
        """Take one more event; those that are not of the stream are passed over."""
        value = event.value
        if event.kind in ("gap", "overrun"):
            self.gaps += 1
            self.lost_samples += int(value.get("lost_samples", 0))
            self.last_gap_s = event.at_s
        elif event.kind == "overload":
            self.overloads, self.overloaded = self.overloads + 1, True
        elif event.kind == "overload_ended":
            self.overloaded = False
        elif event.kind in ("damaged", "undecoded"):
            self.damaged += int(value.get("rejected", 0)) or 1
        elif event.kind in ("started", "reconnected", "stale", "disconnected", "ended"):
            self._turn(event)

    def _turn(self, event: Event) -> None:
        if event.kind == "stale":
            self.state = "streaming" if event.value.get("ended") else "silent"
        elif event.kind == "disconnected":
            self.state = "lost"
        else:
            self.state = "ended" if event.kind == "ended" else "streaming"
        self.why = str(event.value.get("why", "")) if event.kind == "disconnected" else ""
        self.since_s = event.at_s


@dataclass(frozen=True)
class Tare:
    """A tare: its window [s], and the posture, the cell's place and their settings that it was taken in."""

    window_s: Span
    place: Mapping[str, Any]


@dataclass(frozen=True)
class Warned:
    """A warning that stands."""

    code: str
    text: str
    at_s: float

    def as_dict(self) -> dict[str, Any]:
        """Return plain data, with what to do."""
        title, advice, _ = _WARNINGS.get(self.code, _UNKNOWN)
        return {**vars(self), "title": title, "to_do": advice}


@dataclass
class BenchState:
    """The fold of a bench's events."""

    setup: BenchSetup  # of the bench
    stream: str | None  # of its readings
    standing: Standing  # where it is in its protocol
    health: StreamHealth  # of its stream
    # What is looked for: nothing, an unloaded or a loaded plateau; offered: whether one was found.
    phase: Literal["idle", "unloaded", "loaded"] = "idle"
    offered: bool = False
    tare: Tare | None = None  # in force; before: the one before it, whether in force or not
    before: Tare | None = None
    closed: bool = False
    warnings: list[Warned] = field(default_factory=list)  # that stand, the oldest first
    _last: Tare | None = None
    _hanging: PlannedCase | None = None

    @classmethod
    def of(cls, events: Iterable[Event]) -> BenchState | None:
        """Fold a bench's events; None where no bench was begun.

        Raises:
            InputError, KeyError, TypeError, ValueError: they are no events of a bench.
        """
        out, health = None, StreamHealth()
        for event in events:
            health.apply(event)
            if event.kind == STARTED:
                setup = BenchSetup.of_value(event.value)
                out = cls(setup, event.stream, Standing.of(setup), health)
            elif out is not None:
                out.apply(event)
        return out

    @property
    def now(self) -> Step | None:
        """The present step, None after the last."""
        return self.standing.steps.now

    def apply(self, event: Event) -> None:
        """Take one more event."""
        kind = event.kind
        self.warnings = [w for w in self.warnings if kind not in _WARNINGS.get(w.code, _UNKNOWN)[2]]
        self._follow(event)
        # A weight that hung on the cell itself says nothing about the cell at the finger.
        if kind in _ENDS_TARE or (kind == "step" and self.now is not None and self.now.case is None):
            self.tare = None
        if kind in ("unloaded", "loaded"):
            self.phase, self.offered = ("unloaded" if kind == "unloaded" else "loaded"), False
        elif kind in ("plateau_found", "plateau_lost"):
            self.offered = kind == "plateau_found"
        elif kind in _ENDS_PHASE:
            self.phase, self.offered = "idle", False
        if kind == "tare":
            start, end = event.value["window_s"]
            place = {k: v for k, v in event.value.items() if k not in ("window_s", "brackets")}
            self.before, self._last = self._last, Tare((float(start), float(end)), place)
            self.tare = self._last
        elif kind == "warning":
            self.warnings.append(Warned(str(event.value.get("code")), str(event.value.get("text")), event.at_s))
        elif kind == "closed":
            self.closed = True
        self.standing.apply(event)

    def todo(self) -> str:
        """Say what to do now."""
        if self.closed:
            return "closed"
        if self.offered:
            return f"confirm the {self.phase} plateau, or change something"
        if self.phase != "idle":
            return f"wait for the {self.phase} plateau"
        return next_of(self.standing, self.tare is not None, self._hanging).text

    def _follow(self, event: Event) -> None:
        """Know which case's weights still hang as they were read."""
        if event.kind == "case_taken":
            self._hanging = None if self.now is None else self.now.case
        elif event.kind == "known_weight" or event.kind in _ENDS_TARE | {"unloaded"}:
            self._hanging = None
