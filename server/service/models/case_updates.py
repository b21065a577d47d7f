"""Automatic computation of load cases: a force is published once the readings of its windows are there."""

from __future__ import annotations

import logging
import threading
from collections.abc import Hashable
from typing import Any

from sqlalchemy import select
from sqlalchemy.exc import SQLAlchemyError

from daq.errors import InputError
from fingermodel.comparing import compare
from server.service.answers import dumps
from server.service.models.session_models import SessionModels
from server.service.sessions.measuring import CaseState, Measured, Measuring
from server.service.sessions.records import WINDOWS
from server.service.storage.checksums import digest_of
from server.service.storage.database import Database
from server.service.storage.messages import Message, Messages
from server.service.storage.schema import messages as kept
from server.service.web.problems import ProblemError

_LOG = logging.getLogger(__name__)
# After so long what failed for want of space or files is looked at again [s].
_AGAIN_S = 5.0


class CaseUpdates:
    """Looks at sessions that changed, in a thread of its own.

    Args:
        database: holds what was told before.
        messages: are told of each case.
        measuring: gives measured forces.
        models: gives predictions.
    """

    def __init__(self, database: Database, messages: Messages, measuring: Measuring, models: SessionModels) -> None:
        self._database, self._messages, self._measuring, self._models = database, messages, measuring, models
        self._dirty: dict[str, None] = {}
        self._waiting: set[str] = set()
        self._told: dict[str, dict[str, str]] = {}
        self._seen: dict[str, Hashable] = {}
        self._some = threading.Condition()
        self._busy = self._halt = False
        self._thread = threading.Thread(target=self._run, name="cases", daemon=True)

    def start(self) -> None:
        """Look from now on."""
        self._messages.listen(self._heard)
        self._thread.start()

    def touch(self, session: str) -> None:
        """Look at a session soon."""
        with self._some:
            self._dirty[session] = None
            self._some.notify_all()

    def on_readings(self, session: str) -> None:
        """Look at a session whose windows may have waited for readings that are there now."""
        if session in self._waiting:
            self.touch(session)

    def settle(self, timeout_s: float) -> bool:
        """Wait until nothing is left to look at; return whether that came in time."""
        with self._some:
            return self._some.wait_for(lambda: not self._dirty and not self._busy, timeout_s)

    def close(self) -> None:
        """Stop; what was not looked at is looked at after the next start."""
        with self._some:
            self._halt = True
            self._some.notify_all()
        if self._thread.is_alive():
            self._thread.join()

    def _heard(self, message: Message) -> None:
        if message.session is not None and message.kind in ("event", "session"):
            self.touch(message.session)

    def _run(self) -> None:
        while True:
            with self._some:
                self._busy = False
                self._some.notify_all()
                self._some.wait_for(lambda: self._halt or bool(self._dirty))
                if self._halt:
                    return
                session = next(iter(self._dirty))
                del self._dirty[session]
                self._busy = True
            try:
                self._look(session)
            except ProblemError:
                self._waiting.discard(session)  # deleted meanwhile
            except (SQLAlchemyError, OSError):
                # A full disk, too many open files: looked at again, and nobody has to ask for it.
                _LOG.exception("the cases of session %s are not computed yet", session)
                with self._some:
                    self._some.wait_for(lambda: self._halt, _AGAIN_S)
                self.touch(session)
            except Exception:
                _LOG.exception("the cases of session %s were not computed", session)

    def _look(self, session: str) -> None:
        measured = self._measuring.of(session)
        if measured.waits:
            self._waiting.add(session)
            # A chunk may have come between the two.
            measured = self._measuring.of(session)
        if not measured.waits:
            self._waiting.discard(session)
        # Most of what arrives while a bench runs is not what a case waits for.
        if self._seen.get(session) == measured.key:
            return
        before = self._before(session)
        news = {}
        for case in case_bodies(measured, self._models):
            digest = _digest(case)
            # That a case waits is no news before anything else was told of it.
            if before.get(case["id"]) != digest and (case["id"] in before or case["state"] != "waiting"):
                news[case["id"]] = (digest, case)
        if news:
            with self._messages.writing() as telling:
                telling.tell_all("case", session, [case for _, case in news.values()])
            before |= {name: digest for name, (digest, _) in news.items()}
        self._seen[session] = measured.key

    def _before(self, session: str) -> dict[str, str]:
        """Return digests of what was told of each case."""
        if session not in self._told:
            query = select(kept.c.body).where((kept.c.session == session) & (kept.c.kind == "case"))
            rows = self._database.rows(query.order_by(kept.c.id))
            self._told[session] = {row.body["id"]: _digest(row.body) for row in rows}
        return self._told[session]


def _digest(case: dict[str, Any]) -> str:
    """Return a digest that changes with the case, but not with the progress of its readings."""
    said = {k: v for k, v in case.items() if k != "why" or case["state"] in ("failed", "excluded")}
    return digest_of(dumps(said))


def case_bodies(measured: Measured, models: SessionModels) -> list[dict[str, Any]]:
    """Return each case of a session: what hangs, its state and force, and the prediction where that may be seen."""
    compared, problem = {}, None
    if measured.measured is not None:
        try:
            bench = models.bench(measured)
            compared = {c.id: c for c in compare(bench).cases}
        except (InputError, ProblemError) as error:
            problem = str(error)
    unknown = CaseState("waiting") if measured.problem is None else CaseState("failed", str(measured.problem))
    out = []
    amended = measured.record.amendments
    for entry, case in zip(measured.record.cases, measured.record.amended_cases, strict=True):
        name = case["id"]
        state = measured.states.get(name, unknown)
        body: dict[str, Any] = {k: case.get(k) for k in ("id", "role", "posture", "location", "masses_g")}
        body |= vars(state)
        body |= {k: case[k] for k in ("repeat_of", "direction", "note") if case.get(k) is not None}
        body |= {"amended": amended[name], "entered": entry["masses_g"]} if name in amended else {}
        body |= {"windows": {k: case[k] for k in WINDOWS if case.get(k)}}
        force = measured.force(name) if body["state"] == "measured" else None
        body |= force or {"measured_N": None, "measured_sd_N": None, "measured_Nmm": None, "steady": None}
        blinded = case.get("role") == "validation" and not measured.record.closed
        found = {} if blinded or name not in compared else compared[name].as_dict()
        body |= {key: found.get(key) for key in ("predicted_N", "residual_N", "predicted_Nmm", "z")}
        out.append(body | {"blinded": blinded, "no_prediction": problem})
    return out
