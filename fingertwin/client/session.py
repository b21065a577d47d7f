"""A session in the service: its load cases and edits, and what the model says of it."""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from daq.errors import InputError
from fingertwin.client.comparison import Comparison
from fingertwin.client.exchange import Body, Exchange, listed, path_of, reading
from fingertwin.client.files import Check, Readings, fetched, format_of
from fingertwin.client.findings import Finding, Fit, Plan
from fingertwin.client.jobs import Job, finding_of, fit_of, plan_of, revision_of
from fingertwin.client.live import Message, messages
from fingertwin.client.records import Edit, LoadCase, SessionInfo
from fingertwin.client.revisions import Revision, model_name

if TYPE_CHECKING:
    import plotly.graph_objects as go

# The revision that stands for the specimen; the session's own finger where there is none.
IN_FORCE = "in_force"
Model = str | Revision | None
Span = tuple[float, float]


class Session:
    """A session in the service.

    `model`, wherever it is asked for, is a revision or its id, a finger's name, `in_force` for the revision that stands
    for the specimen (the session's own finger where there is none yet), or None for the session's own finger.

    Attributes:
        id: of the session.
    """

    def __init__(self, exchange: Exchange, name: str) -> None:
        self._exchange, self.id = exchange, name

    def __repr__(self) -> str:
        return f"<Session {self.id} at {self._exchange.url}>"

    def info(self) -> SessionInfo:
        """Return how it stands."""
        return SessionInfo.of(self._exchange.get(self._path()))

    def document(self) -> Body:
        """Return it as bench-session/1, edits included."""
        return self._exchange.get(self._path("document"))

    def cases(self) -> list[LoadCase]:
        """Return the load cases, and how far each is."""
        with reading("load cases"):
            return [LoadCase.of(case) for case in self._exchange.get(self._path("cases"))["cases"]]

    def case(self, name: str) -> LoadCase:
        """Return one load case."""
        return LoadCase.of(self._exchange.get(self._path("cases", name)))

    def compare(self, model: Model = IN_FORCE) -> Comparison:
        """Hold predicted against measured forces."""
        asked = model_name(model)
        query = {} if asked is None else {"model": asked}
        return Comparison.of(self._exchange, self._exchange.get(self._path("comparison"), query), asked)

    def invert(self, closure: str = "chao", model: Model = None) -> Body:
        """Find the muscle and joint forces behind the tip forces, beside the weights that really hung.

        Args:
            closure: what settles which tendon pulls: minimal, chao or least_squares.
            model: whose finger; by default the session's own.

        Raises:
            ServiceError: 409, its bench is still running.
        """
        query = {"closure": closure, "model": model_name(model)}
        return self._exchange.get(self._path("inversion"), {k: v for k, v in query.items() if v is not None})

    def refit(
        self,
        method: Literal["map", "slsqp"] = "map",
        model: Model = IN_FORCE,
        plane: Literal["sagittal", "space"] | None = None,
        timeout_s: float | None = None,
    ) -> Job[Fit]:
        """Refit a model to the identification cases; the revision then stands for the specimen.

        Args:
            method: `map`, all parameters with priors, or `slsqp`, the published problems.
            model: to begin with.
            plane: of the forces to fit; by default what the finger's axes can predict.
            timeout_s: after which the service gives the job up.
        """
        asked = {"method": method, "model": model_name(model), "plane": plane, "timeout_s": timeout_s}
        return Job(self._exchange, self._exchange.post(self._path("fits"), asked), fit_of)

    def add(
        self,
        *effects: str,
        without: Sequence[str] = (),
        model: Model = IN_FORCE,
        timeout_s: float | None = None,
    ) -> Job[Revision]:
        """Add effects to a model, take others out, and refit; the revision then stands for the specimen.

        Args:
            effects: names of `Client.effects`, their candidates, or the user's own.
            without: effects to take out.
            model: to begin with.
            timeout_s: after which the service gives the job up.
        """
        asked = {
            "add": list(effects), "without": listed(without, "without"), "model": model_name(model),
            "timeout_s": timeout_s,
        }  # fmt: skip
        return Job(self._exchange, self._exchange.post(self._path("revisions"), asked), revision_of)

    def diagnose(
        self,
        model: Model = IN_FORCE,
        thorough: bool = False,
        effects: Sequence[str] = (),
        timeout_s: float | None = None,
    ) -> Job[Finding]:
        """Find where a model fails and which physical effect it lacks.

        Args:
            model: to diagnose.
            thorough: more starts and pairs, and every single to its end; may take a minute.
            effects: users' own effects that take part.
            timeout_s: after which the service gives the job up.
        """
        asked = {
            "model": model_name(model), "thorough": thorough, "effects": listed(effects, "effects"),
            "timeout_s": timeout_s,
        }  # fmt: skip
        return Job(self._exchange, self._exchange.post(self._path("diagnoses"), asked), finding_of)

    def next_cases(
        self,
        freeze: bool = False,
        model: Model = IN_FORCE,
        effects: Sequence[str] = (),
        timeout_s: float | None = None,
    ) -> Job[Plan]:
        """Find the load cases that would best tell the remaining explanations apart.

        Args:
            freeze: keep what the explanations say of them; a later diagnosis is held against it.
            model: to begin with.
            effects: users' own effects that take part.
            timeout_s: after which the service gives the job up.
        """
        asked = {
            "freeze": freeze, "model": model_name(model), "effects": listed(effects, "effects"),
            "timeout_s": timeout_s,
        }  # fmt: skip
        return Job(self._exchange, self._exchange.post(self._path("next"), asked), plan_of)

    def history(self) -> list[Revision]:
        """Return the revisions that were fitted to it, oldest first."""
        rows = self._exchange.pages(self._path("revisions"), "revisions")
        return [Revision.of(self._exchange, row) for row in rows]

    def plot_fall(self) -> go.Figure:
        """Return a figure of how the error fell, from the finger as it was read to the revision that stands.

        Raises:
            InputError: there is no revision yet.
        """
        revisions = self.history()
        if not revisions:
            raise InputError(f"session {self.id} has no revision yet", "at least one", "Refit it, or add an effect")
        return next((r for r in revisions if r.in_force), revisions[-1]).plot()

    def move_windows(self, case: str, **windows: Span | None) -> Edit:
        """Move windows of a load case, in s of the readings: unloaded_s, loaded_s, unloaded_after_s.

        Args:
            case: its id.
            windows: (start, end); None takes one away.
        """
        known = ("unloaded_s", "loaded_s", "unloaded_after_s")
        unknown = [name for name in windows if name not in known]
        if unknown or not windows:
            raise InputError(f"the window {unknown[0]!r}" if unknown else "no window", f"of {', '.join(known)}")
        given = {name: None if span is None else list(span) for name, span in windows.items()}
        answer = self._exchange.ask(
            "PUT", self._path("cases", case, "windows"), json=given, again=False
        )  # fmt: skip
        return Edit.of(self._exchange.body(answer))

    def add_case(self, case: Mapping[str, Any]) -> Edit:
        """Add a load case, as bench-session/1 has them; a repeat is added too, none is replaced."""
        return self._edit({"case": dict(case)}, "cases")

    def exclude(self, case: str, reason: str) -> Edit:
        """Leave a load case out, for a reason."""
        return self._edit({"reason": reason}, "cases", case, "exclude")

    def include(self, case: str) -> Edit:
        """Take a load case in again."""
        return self._edit({}, "cases", case, "include")

    def amend(
        self,
        cases: str,
        why: str,
        *,
        tendons: Mapping[str, str] | None = None,
        masses_g: Mapping[str, float] | None = None,
        weights_g: Mapping[float, float] | None = None,
        posture: str | None = None,
        location: str | None = None,
    ) -> Edit:
        """Say what load cases that were entered wrongly really were; the entries are kept, and it can be undone.

        Args:
            cases: a case's id, a posture, `tip`, `bone`, `all`, `c017..` (from it on), or several joined by commas.
            why: how it is known.
            tendons: the tendon that bore the weight, by the one that was entered.
            masses_g: what really hung on a tendon [g], 0 for nothing; other tendons keep what was entered.
            weights_g: what a weight really weighs [g], by what was entered wherever it hung.
            posture: that was really set.
            location: where the cell really was, `tip` or `bone`.
        """
        really: dict[str, Any] = {"cases": cases, "posture": posture, "location": location}
        really |= {"tendons": dict(tendons or {}), "masses_g": dict(masses_g or {})}
        really |= {"weights_g": {f"{entered:.12g}": true for entered, true in (weights_g or {}).items()}}
        return self._edit({"amend": [really], "why": why}, "amend")

    def undo(self, edit: Edit | int) -> Edit:
        """Take an edit back; an undo can be taken back too."""
        number = edit.number if isinstance(edit, Edit) else edit
        return self._edit({}, "edits", str(number), "undo")

    def edits(self) -> list[Edit]:
        """Return every change that was made after the bench, oldest first."""
        with reading("edits"):
            return [Edit.of_list(row) for row in self._exchange.get(self._path("edits"))["edits"]]

    def check(self) -> Check:
        """Look for everything that is wrong with it: recording, windows, tares, known weights."""
        return Check.of(self._exchange.get(self._path("check")))

    def readings(self, from_s: float | None = None, to_s: float | None = None, points: int = 2000) -> Readings:
        """Return stored readings; where there are more than `points`, the least and greatest of stretches of them.

        Args:
            from_s: first time of the stream; by default its first.
            to_s: last time; by default its last.
            points: 2 to 10,000.
        """
        asked = {"from_s": from_s, "to_s": to_s, "points": points}
        return Readings.of(
            self._exchange.get(self._path("readings"), {k: v for k, v in asked.items() if v is not None})
        )

    def export(self, path: str | Path, file_format: str | None = None, model: Model = None) -> Path:
        """Write it for other software, and return the file.

        Args:
            path: of the file.
            file_format: csv, columns, parquet, xlsx, hdf5, c3d, mat, supplement or folder; by default by the
                file's name.
            model: whose predictions go along, where the format has any.
        """
        asked = {"format": format_of(Path(path), file_format), "model": model_name(model)}
        return fetched(self._exchange, self._path("export"), Path(path), asked)

    def report(self, path: str | Path, finding: Job[Finding] | None = None, model: Model = None) -> Path:
        """Write its report, one page that works offline, and return the file.

        Args:
            path: of the page.
            finding: a diagnosis that is done, to go along.
            model: to compare with.
        """
        asked = {"job": None if finding is None else finding.id, "model": model_name(model)}
        return fetched(self._exchange, self._path("report"), Path(path), asked)

    def press(self, command: str, text: str = "") -> None:
        """Let the bench that logs it carry out a command, as if its key were pressed there.

        Args:
            command: such as tare, loaded, confirm, next, note; the bench's `bench` messages list them (`live`).
            text: that belongs to it.

        Raises:
            ServiceError: 409, no bench is connected, or it refuses, with its reason.
        """
        self._exchange.post(self._path("bench", "commands"), {"command": command, "text": text})

    def close(self) -> SessionInfo:
        """Close it: predictions of its validation cases may be seen from here on."""
        return SessionInfo.of(self._exchange.post(self._path("close"), {}, again=True))

    def delete(self) -> None:
        """Hide it. What it holds is kept until a purge; the same session, uploaded again, brings it back."""
        self._exchange.ask("DELETE", self._path(), again=False)

    def live(self, after: int | None = None) -> Generator[Message, None, None]:
        """Yield what happens to it, as `Client.live`."""
        return messages(self._exchange, [self.id], after)

    def _edit(self, body: Body, *parts: str) -> Edit:
        return Edit.of(self._exchange.post(self._path(*parts), body))

    def _path(self, *parts: str) -> str:
        return path_of("sessions", self.id, *parts)
