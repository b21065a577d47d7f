"""The client: one model service, its sessions and what it can be asked."""

from __future__ import annotations

import os
from collections.abc import Generator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import httpx

from daq.errors import require_list
from fingertwin.client.exchange import Body, Exchange, listed, path_of, reading
from fingertwin.client.figures import figure, figure_names
from fingertwin.client.files import fetched
from fingertwin.client.jobs import Job, Progress, job_of, plain
from fingertwin.client.live import Message, messages
from fingertwin.client.predictions import Columns, Prediction, predict
from fingertwin.client.records import Effect, Friction, Health
from fingertwin.client.revisions import Revision, model_name
from fingertwin.client.session import IN_FORCE, Model, Session
from fingertwin.client.upload import upload

if TYPE_CHECKING:
    import plotly.graph_objects as go

# What `fingertwin log --to` takes too.
FROM_ENVIRONMENT = "FINGERTWIN_TOKEN"


class Client:
    """A model service, asked over REST.

    Requests that do no harm when they come twice are repeated where the service is away for a moment or asks for
    patience: reading, uploads, predictions. Everything else is sent once.

    Args:
        url: of the service.
        token: as `fingertwin token` gave it; by default that of FINGERTWIN_TOKEN, where there is one.
        timeout_s: of each pause in an exchange.
        retries: of requests that may be repeated.
        transport: instead of the network, as httpx has it.

    Raises:
        InputError: it is no address, or no token.
    """

    def __init__(
        self,
        url: str = "http://127.0.0.1:8765",
        token: str | None = None,
        *,
        timeout_s: float = 30.0,
        retries: int = 3,
        transport: httpx.BaseTransport | None = None,
    ) -> None:
        given = os.environ.get(FROM_ENVIRONMENT) or None if token is None else token
        self._exchange = Exchange(url, given, timeout_s, retries, transport)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<Client of {self._exchange.url}>"

    def close(self) -> None:
        """Hang up."""
        self._exchange.close()

    def health(self) -> Health:
        """Return how the service is."""
        return Health.of(self._exchange.get(path_of("health")))

    def upload(self, path: str | Path, name: str | None = None, progress: Progress | None = None) -> Session:
        """Send a recorded session: its document, and its readings as chunks.

        It may be called again after an interruption, and with a session that is there already: what the service has is
        not sent twice, and what would differ is refused.

        Args:
            path: folder, `session.yaml`, or the name of a shipped session.
            name: its id in the service; by default its own.
            progress: called with the share that is done (0 to 1) and what is being sent.

        Raises:
            InputError: the session or its readings cannot be used.
            ServiceError: 409, another session has that id.
        """
        return Session(self._exchange, upload(self._exchange, path, name, progress))

    def session(self, name: str) -> Session:
        """Return a session that is there.

        Raises:
            ServiceError: 404, there is none.
        """
        session = Session(self._exchange, name)
        session.info()
        return session

    def sessions(self, specimen: str | None = None) -> list[Session]:
        """Return the sessions, or those of one specimen, in the order of their ids."""
        with reading("sessions"):
            rows = self._exchange.pages(path_of("sessions"), "sessions", {"specimen": specimen})
            return [Session(self._exchange, row["id"]) for row in rows]

    def revisions(self, specimen: str | None = None) -> list[Revision]:
        """Return the revisions, or those of one specimen, oldest first."""
        rows = self._exchange.pages(path_of("revisions"), "revisions", {"specimen": specimen})
        return [Revision.of(self._exchange, row) for row in rows]

    def revision(self, name: str) -> Revision:
        """Return a revision by its id."""
        return Revision.read(self._exchange, name)

    def predict(
        self,
        postures_deg: Columns,
        masses_g: Columns | None = None,
        tensions_N: Columns | None = None,
        *,
        model: str | Revision = "an1979_middle",
        tension_factor: float = 1.0,
        gravity_m_s2: float = 9.81,
    ) -> Prediction:
        """Predict forces of any postures and loads; large numbers of load cases go in several requests.

        Args:
            postures_deg: angle of each joint [deg], flexion positive: a number, or one for each load case. An
                abduction that is left out is 0.
            masses_g: weight hung on each tendon; or
            tensions_N: the tension in each.
            model: a finger's name, or a revision.
            tension_factor: friction correction c, tension = c m g, above 0 and up to 1.5; of masses alone. It is 1 for
                a revision too: give that of the session to predict what its weights would do.
            gravity_m_s2: of the place.

        Raises:
            InputError: columns of different lengths, or numbers that are none.
            ServiceError: an unknown joint, tendon or model, or a joint without an angle.
        """
        more = {"model": model_name(model), "tension_factor": tension_factor, "gravity_m_s2": gravity_m_s2}
        return predict(self._exchange, postures_deg, masses_g, tensions_N, more)

    def friction(self, sessions: Sequence[str | Session]) -> Friction:
        """Find the friction factor of sessions by force balance."""
        return Friction.of(self._exchange.get(path_of("friction"), {"session": _ids(sessions)}))

    def diagnose(
        self,
        sessions: Sequence[str | Session],
        model: Model = IN_FORCE,
        thorough: bool = False,
        effects: Sequence[str] = (),
        timeout_s: float | None = None,
    ) -> Job[Body]:
        """Diagnose several sessions: each by itself, and what they share."""
        asked = {
            "sessions": _ids(sessions), "model": model_name(model), "thorough": thorough,
            "effects": listed(effects, "effects"), "timeout_s": timeout_s,
        }  # fmt: skip
        return Job(self._exchange, self._exchange.post(path_of("diagnoses"), asked), plain)

    def population(
        self,
        sessions: Sequence[str | Session],
        effects: Sequence[Sequence[str]] = ((),),
        bootstrap: int = 20,
        seed: int = 0,
        model: Model = IN_FORCE,
        timeout_s: float | None = None,
    ) -> Job[Body]:
        """Refit (specimens × bootstrap × effects): how sure values and errors are.

        Args:
            sessions: one or more.
            effects: sets to add; an empty one is a refit without.
            bootstrap: replicates of each session.
            seed: of the replicates.
            model: to begin with.
            timeout_s: after which the service gives the job up.
        """
        asked = {
            "sessions": _ids(sessions), "effects": [listed(names, "a set of effects") for names in effects],
            "bootstrap": bootstrap, "seed": seed, "model": model_name(model), "timeout_s": timeout_s,
        }  # fmt: skip
        return Job(self._exchange, self._exchange.post(path_of("populations"), asked), plain)

    def effects(self) -> list[Effect]:
        """Return the effects that a model may lack: the catalogue, then users' own."""
        with reading("effects"):
            return [Effect.of(row) for row in self._exchange.get(path_of("effects"))["effects"]]

    def add_effect(self, effect: str | Mapping[str, Any]) -> Effect:
        """Keep an effect of one's own: a formula with one coefficient k, or a whole fingertwin-effect/1.

        The same again is a success. Formulas are parsed by whitelist, and never run as code.

        Raises:
            ServiceError: the formula cannot be used; 409, another effect has the name.
        """
        return Effect.of(self._exchange.post(path_of("effects"), _effect(effect), again=True))

    def check_effect(self, effect: str | Mapping[str, Any]) -> Effect:
        """Return what an effect of one's own would be, without keeping it."""
        return Effect.of(self._exchange.post(path_of("effects", "check"), _effect(effect), again=True))

    def figures(self) -> dict[str, str]:
        """Return the figures that the service draws: names with titles."""
        return figure_names(self._exchange)

    def figure(self, name: str, **about: str) -> go.Figure:
        """Return a figure, drawn by the service.

        Args:
            name: of `figures`, such as `comparison/scatter`.
            about: what it shows, by name, such as session, model, case, job, revision; theme is light or dark.

        Raises:
            ServiceError: there is no such figure, or what it is about is not there.
            InputError: there is nothing to draw.
        """
        return figure(self._exchange, name, **about)

    def fingers(self) -> list[Body]:
        """Return the fingers that come with the software: name, title, bones, joints, tendons."""
        with reading("fingers"):
            return list(self._exchange.get(path_of("fingers"))["fingers"])

    def export_finger(self, name: str, path: str | Path, file_format: str = "osim") -> Path:
        """Write a finger for OpenSim (osim), MuJoCo (mjcf) or as it is here (finger), and return the file."""
        return fetched(self._exchange, path_of("fingers", name, "export"), Path(path), {"format": file_format})

    def import_finger(self, path: str | Path) -> Body:
        """Read a finger out of an OpenSim or MJCF file; `file` of the answer is its finger/1 YAML.

        Raises:
            OSError: the file cannot be read.
            ServiceError: it holds no finger chain.
        """
        given = {"name": Path(path).name, "text": Path(path).read_text(encoding="utf-8")}
        return self._exchange.post(path_of("fingers", "imports"), given, again=True)

    def scale_finger(
        self, name: str, bones_mm: Mapping[str, float], moment_arms_mm: Mapping[str, float] | None = None
    ) -> Body:
        """Scale a finger to a specimen's bone lengths [mm]; `file` of the answer is its finger/1 YAML."""
        asked = {"bones_mm": dict(bones_mm), "moment_arms_mm": dict(moment_arms_mm or {})}
        return self._exchange.post(path_of("fingers", name, "scalings"), asked, again=True)

    def compare_fingers(self, one: str, other: str) -> Body:
        """Set two fingers side by side: bone lengths, moment arms, force ratios."""
        return self._exchange.get(path_of("fingers", one, "comparison"), {"other": other})

    def move(
        self,
        motion: str | Mapping[str, Any] = "wu2008_tap",
        finger: str = "wu2008_index",
        muscles: str = "wu2008",
        steps: int = 200,
    ) -> Body:
        """Work out a movement: joint torques and muscle forces over time.

        Args:
            motion: a shipped one, or a motion/1 document.
            finger: with the inertia of its bones.
            muscles: a shipped set.
            steps: instants over the movement.
        """
        named = {"motion": motion} if isinstance(motion, str) else {"document": dict(motion)}
        asked = named | {"finger": finger, "muscles": muscles, "steps": steps}
        return self._exchange.post(path_of("movements"), asked, again=True)

    def activate(self, finger: str, lost: Mapping[str, float] | None = None, **asked: Any) -> Body:
        """Hold a finger with its muscles active: the tip force of each, and what deficits change.

        Args:
            finger: with a muscle set of its name.
            lost: share of its activation (0 to 1) that each muscle loses.
            asked: muscles, posture_deg, activation or force_N.
        """
        body = {"finger": finger, "lost": dict(lost or {}), **asked}
        return self._exchange.post(path_of("activations"), body, again=True)

    def studies(self) -> list[Body]:
        """Return the published studies that can be computed again."""
        with reading("studies"):
            return list(self._exchange.get(path_of("studies"))["studies"])

    def reproduce(self, study: str) -> Job[Body]:
        """Compute a study again: every published figure beside ours."""
        asked = self._exchange.post(path_of("studies", study, "reproductions"), {})
        return Job(self._exchange, asked, plain)

    def jobs(self, session: str | Session | None = None, state: str | None = None) -> list[Job[Any]]:
        """Return jobs, newest first.

        Args:
            session: that they are about.
            state: queued, running, done, failed or cancelled.
        """
        query = {"session": None if session is None else _ids([session])[0], "state": state}
        return [job_of(self._exchange, row) for row in self._exchange.pages(path_of("jobs"), "jobs", query)]

    def job(self, name: str) -> Job[Any]:
        """Return a job by its id."""
        return job_of(self._exchange, self._exchange.get(path_of("jobs", name)))

    def live(self, *sessions: str | Session, after: int | None = None) -> Generator[Message, None, None]:
        """Yield what happens as it happens, and go on by itself after an interruption.

        Args:
            sessions: that it is about, with their traces; none of them means all, without traces.
            after: id of the last message that was seen; by default only what comes.

        Raises:
            ServiceError: the service refuses.
            ServiceUnreachableError: nobody has answered for a minute.
        """
        return messages(self._exchange, _ids(sessions), after)


def _ids(sessions: Sequence[str | Session]) -> list[str]:
    require_list(sessions.id if isinstance(sessions, Session) else sessions, "sessions", "a list of sessions")
    return [s.id if isinstance(s, Session) else s for s in sessions]


def _effect(effect: str | Mapping[str, Any]) -> Body:
    return {"formula": effect} if isinstance(effect, str) else {"document": dict(effect)}
