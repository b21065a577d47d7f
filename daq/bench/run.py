"""A bench session as it is done, without a terminal: fed readings and commands, it answers with events to be kept.

It goes through a protocol's cases in order, finds the plateaus, offers them to be confirmed, and gives each case's
force with its uncertainty. Whatever it decides is an event, and its record is folded from these events alone.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from pydantic import ValidationError

from daq.bench.engine import BenchEngine, Events
from daq.bench.forces import Result
from daq.bench.record import RESUMED, STARTED
from daq.bench.status import BenchStatus, Next, next_of
from daq.bench.steps import Step
from daq.errors import SessionError
from daq.sessions.models import KnownWeight
from daq.vocabulary import did_you_mean


class BenchRun(BenchEngine):
    """A bench session and its commands; every method answers with the events that it caused."""

    def start(self) -> Events:
        """Say how the bench was set up, the first event of all; or that it goes on, after `resume`."""
        if self._broke_off_s is None:
            self._emit(STARTED, **self.record.setup.as_value())
        else:
            self._emit(RESUMED, broke_off_s=self._broke_off_s)
        return self._flush()

    def unloaded(self) -> Events:
        """Look for an unloaded plateau, to be confirmed as a tare: the weights are off."""
        self._mark("unloaded")
        return self._flush()

    def tare(self) -> Events:
        """Take the first plateau as a tare without asking again: the weights are off."""
        if self._phase == "unloaded" and self._finder.offer is not None:
            return self.confirm()
        self._mark("unloaded")
        self._tare_asked = True
        return self._flush()

    def loaded(self) -> Events:
        """Look for a plateau: the weights of the present step hang."""
        step = self._open_step()
        if step.id in self._at.steps.done:
            raise SessionError(
                f"{step.name} is taken already", "next, or repeat", "A repeat is added, none is replaced"
            )
        if step.case is None and self._at.weight is None:
            raise SessionError("the known weight is not known", "its mass and direction, such as 500 palmar")
        self._require_place(step)
        if self._tare is None:
            raise SessionError(
                f"{step.name} has no tare since posture, cell or suture changed",
                "a tare, then the load",
                "Take the weights off, tare, and hang them again",
            )
        self._mark("loaded")
        return self._flush()

    def confirm(self) -> Events:
        """Take the window that is offered: as a tare, a known weight or the present case."""
        self._require_open()
        if self._finder.offer is None:
            why = self._finder.reason or "nothing was marked loaded or unloaded"
            raise SessionError(f"there is no plateau to confirm ({why})", "one that was found", "Wait")
        self._confirm(self._finder.offer)
        return self._flush()

    def next(self) -> Events:
        """Go on to the next step; one that is not completed is recorded as skipped."""
        step = self._open_step()
        self._skip(step)
        self._leave()
        following = self._at.steps.following
        self._emit("step", id=None if following is None else following.id)
        return self._flush()

    def repeat(self, case: str = "") -> Events:
        """Do a case once more, by default the last one, both are kept; or go back to one that was skipped."""
        self._require_open()
        name, steps = case or self._at.last_taken or "", self._at.steps
        _require_among(name, (*self.record.cases, *steps.skipped_cases), "was taken or skipped")
        self._leave()
        if name in steps.skipped:
            self._emit("step", id=name, back=True)
        else:
            step = steps.repeat(name)
            self._emit("step", id=step.id, repeat_of=step.repeat_of)
        return self._flush()

    def exclude(self, case: str, reason: str) -> Events:
        """Leave a case out, for a reason that is given before predictions are seen."""
        self._require_open()
        _require_among(case, self.record.cases, "was taken")
        if not reason.strip():
            raise SessionError(f"{case} excluded without a reason", "why, such as: suture slipped")
        if case in self.record.excluded:
            raise SessionError(f"{case} is excluded already ({self.record.cases[case]['excluded']})", "another case")
        self._emit("excluded", case=case, reason=reason.strip())
        if self._last is not None and self._last.case == case:
            self._last = None
        return self._flush()

    def include(self, case: str) -> Events:
        """Take a case in again that was left out; that it was left out, and why, stays in the session's notes."""
        self._require_open()
        _require_among(case, self.record.excluded, "is excluded")
        self._emit("included", case=case, reason=self.record.cases[case]["excluded"])
        self._say_measured([case])
        return self._flush()

    def known_weight(self, mass_g: float, direction: Any, mount: str | None = None) -> Events:
        """Say what hangs on the cell itself in the present step, or in one that is put in here."""
        self._require_open()
        weight = {"mass_g": mass_g, "direction": direction, "mount": mount or self._at.place["location"]}
        try:
            sound = KnownWeight.model_validate(self.record.setup.check(weight))
        except ValidationError as error:
            said = error.errors()[0]
            context: Mapping[str, Any] = said.get("ctx", {})
            found = f"known weight: {'.'.join(map(str, said['loc']))} {context.get('found', said['msg'])}"
            raise SessionError(found, context.get("expected", "")) from None
        before = self._at.steps.now
        self._emit("known_weight_set", mass_g=sound.mass_g, direction=list(sound.direction), mount=sound.mount)
        if self._at.steps.now is not before:
            self._rest()
        return self._flush()

    def posture_set(self) -> Events:
        """Record that the present step's posture was set, or set anew; the tare's life ends."""
        self._require_open()
        posture = self._at.wanted()["posture"]
        return self._end_tare("set_posture", posture=posture, setting=self._at.settings(posture))

    def cell_moved(self) -> Events:
        """Record that cell or clamp was moved to the present step's place; the tare's life ends."""
        self._require_open()
        location = self._at.wanted()["location"]
        return self._end_tare("move_cell", location=location, mounting=self._at.mountings(location))

    def retied(self, text: str = "") -> Events:
        """Record that a suture was tied anew; the tare's life ends."""
        self._require_open()
        return self._end_tare("retie", **_text(text))

    def slipped(self, text: str = "") -> Events:
        """Record that something slipped; the tare's life ends."""
        self._require_open()
        return self._end_tare("slip", **_text(text))

    def moistened(self) -> Events:
        """Record that the specimen was moistened."""
        self._require_open()
        self._emit("moisten")
        return self._flush()

    def note(self, text: str) -> Events:
        """Record a note in free words."""
        self._require_open()
        if not text.strip():
            raise SessionError("an empty note", "a text")
        self._emit("note", text=text.strip())
        return self._flush()

    def close(self) -> Events:
        """End the session: what was not done is recorded, and validation cases may be compared from here on."""
        self._require_open()
        for step in self._at.steps.undone():
            if step.case is None and step.id not in self._at.steps.skipped:
                self._skip(step)
        undone = [s.id for s in self._at.steps.undone() if s.case is not None]
        self._rest()
        results = self._results(blind=False)
        self._emit("closed", undone=undone, comparison=[r.as_value() for r in results])
        return self._flush()

    def results(self) -> list[Result]:
        """Return the forces of all cases that are not excluded; with predictions of validation cases once closed."""
        return self._results(blind=not self.record.closed)

    def status(self) -> BenchStatus:
        """Return the state for a view."""
        step, offer, then = self._at.steps.now, self._finder.offer, self._next()
        return BenchStatus(
            self._now_s,
            "all steps are done" if step is None else f"{step.id}: {self._at.told(step)}",
            then.text,
            self._phase,
            None if offer is None else offer.window_s,
            self._finder.reason,
            self._live,
            self._last,
            tuple(self._warnings),
            self._at.steps.checklist(),
            None if self._tare is None else self._now_s - self._tare.window_s[1],
            self.record.closed,
            then.command,
            self._answers_begin(),
        )

    def _next(self) -> Next:
        if self.record.closed:
            return Next("closed", "")
        if self._finder.offer is not None:
            return Next(f"confirm the {self._phase} plateau, or change something", "confirm")
        if self._phase != "idle":
            return Next(f"wait for the {self._phase} plateau ({self._finder.reason})", "")
        return next_of(self._at, self._tare is not None, self._hanging)

    def _answers_begin(self) -> dict[str, str]:
        taken, excluded = self._at.last_taken, self.record.excluded
        meant = {
            "repeat": self._at.steps.just_skipped or taken,
            "exclude": taken and f"{taken} ",
            "include": excluded[-1] if excluded else None,
        }
        return {command: case for command, case in meant.items() if case}

    def _results(self, blind: bool) -> list[Result]:
        cases = [name for name in self.record.cases if name not in self.record.excluded]
        return self._forces.measured(self.record.session(), cases, blind) if cases else []

    def _leave(self) -> None:
        # A weight that hung on the cell itself says nothing about the cell at the finger.
        if self._at.steps.now is not None and self._at.steps.now.case is None:
            self._tare = None
        self._rest()

    def _skip(self, step: Step) -> None:
        if step.id in self._at.steps.done:
            return
        if step.case is None:
            self._emit("known_weight_skipped", when=step.when, step=step.id)
        else:
            self._emit("case_skipped", id=step.id)

    def _end_tare(self, kind: str, **value: Any) -> Events:
        self._tare = self._hanging = None
        self._rest()
        self._emit(kind, **value)
        return self._flush()

    def _open_step(self) -> Step:
        self._require_open()
        if self._at.steps.now is None:
            raise SessionError("all steps are done", "close, repeat or known_weight")
        return self._at.steps.now

    def _require_place(self, step: Step) -> None:
        for key, what, remedy in (
            ("posture", "posture", "Set it, mark it, and tare"),
            ("location", "cell's place", "Move the cell, mark it, and tare"),
        ):
            wanted = self._at.wanted()[key]
            if self._at.place[key] != wanted:
                raise SessionError(f"the {what} is {self._at.place[key]}", f"{wanted} for {step.name}", remedy)


def _require_among(case: str, known: Collection[str], what: str) -> None:
    if case not in known:
        found = f"no case {case} {what}" if case else "no case is named"
        raise SessionError(found, f"one of {' '.join(known) or '(none yet)'}", did_you_mean(case, known))


def _text(text: str) -> dict[str, str]:
    return {"text": text.strip()} if text.strip() else {}
