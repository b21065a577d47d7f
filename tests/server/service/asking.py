"""The whole OpenAPI document asked by schemathesis: a session that exists, its ids in the addresses, what went wrong.

Ids of what exists come as dictionaries, or all answers would be 404. Jobs that are asked for are cancelled soon, and
sessions that other cases need are not deleted.
"""

from __future__ import annotations

import hashlib
import threading
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import httpx
import numpy as np

from daq.acquisition.blocks import Chunk
from daq.uplink.wire import EPOCH, SHA256
from server.service.schemas.sessions import DOCUMENT
from tests.server.service.recorded import EPOCH_1, STREAM, describe, put, upload

SESSION, READ, EMPTY, DOOMED = "synek2019_H01", "READ", "EMPTY", "DOOMED"
RATE_HZ, LASTS_S = 100.0, 30.0
# Statuses that refuse a request that is not as documented.
_REFUSED = ["4xx"]
_OPEN_JOBS = ("queued", "running")
# Of two addresses that fit, the one with the fixed last word has another method; `cursor` is no number of an event.
_CURSOR = "GET /api/v1/sessions/{session}/events/{epoch}/cursor"
Ids = Mapping[str, list[str]]


@dataclass
class Tally:
    """What was asked, and what came of it.

    Attributes:
        cases: by operation.
        statuses: by status.
        phases: cases by phase of schemathesis.
        failures: by operation and check, with the request that shows it.
        errors: of schemathesis itself.
    """

    cases: Counter[str] = field(default_factory=Counter)
    statuses: Counter[int] = field(default_factory=Counter)
    phases: Counter[str] = field(default_factory=Counter)
    failures: dict[tuple[str, str], str] = field(default_factory=dict)
    errors: list[str] = field(default_factory=list)

    def add(self, other: Tally) -> None:
        """Take another's counts in."""
        for mine, more in ((self.cases, other.cases), (self.phases, other.phases)):
            mine.update(more)
        self.statuses.update(other.statuses)
        self.failures = other.failures | self.failures
        self.errors += other.errors


def prepared(client: httpx.Client, *, refit: bool = True) -> Ids:
    """Put in what addresses can name: sessions with forces, readings, no record, to be deleted; a revision, a job.

    Args:
        client: of the service.
        refit: whether to wait for a refit, without which there is no revision.
    """
    upload(client, SESSION)
    upload_read(client)
    for name in (EMPTY, *(f"{DOOMED}-{k}" for k in range(20))):
        client.post("/api/v1/sessions", json={"id": name}).raise_for_status()
    place = f"/api/v1/sessions/{SESSION}"
    cases = [c["id"] for c in client.get(f"{place}/cases").raise_for_status().json()["cases"]]
    edit = client.post(f"{place}/cases/{cases[0]}/exclude", json={"reason": "the suture slipped"}).raise_for_status()
    asked = client.post(f"{place}/fits", json={}).raise_for_status().json()
    revision = {"id": "none-yet", "specimen": "H01"}
    if refit:
        job = finished(client, asked["id"])
        assert job["state"] == "done", job
        revision = client.get("/api/v1/revisions").raise_for_status().json()["revisions"][0]
    return {
        "session": [SESSION, READ, EMPTY],
        "case": cases[:5],
        "stream": [STREAM],
        "epoch": [EPOCH_1],
        "edit": [edit.json()["edit"]],
        "job": [asked["id"]],
        "revision": [revision["id"]],
        "specimen": [revision["specimen"]],
        "model": ["an1979_middle", "in_force", revision["id"]],
        "effect": ["worn_pulley.FDP", "hanger_mass"],
        "study": ["synek2019", "wu2008"],
        "finger": ["an1979_middle", "wu2008_index"],
        "name": ["worn_pulley", "an1979_middle", "friction", "scatter", "map", "evidence"],
    }


def upload_read(client: httpx.Client) -> None:
    """Put in a short session with readings."""
    first: dict[str, Any] = DOCUMENT["cases"][0]
    windows = {"unloaded_s": [1.0, 8.0], "loaded_s": [12.0, 24.0]}
    case = {k: v for k, v in first.items() if k != "force_N"} | windows
    document = DOCUMENT | {"id": READ, "cases": [case], "readings": "readings.parquet"}
    client.post("/api/v1/sessions", json={"id": READ, "document": document}).raise_for_status()
    describe(client, READ)
    t_s = np.arange(0.0, LASTS_S, 1.0 / RATE_HZ)
    wrench = np.random.default_rng(0).normal(0.0, 0.01, (len(t_s), 6))
    wrench[t_s > 10.0] += [-3.1, -2.4, 0.2, 0.0, 0.0, 0.0]
    none = np.zeros(len(t_s), dtype=np.int64)
    put(client, READ, Chunk(0, t_s, wrench, none, none > 0, b"", [], 1e9)).raise_for_status()


def finished(client: httpx.Client, job: str) -> dict[str, Any]:
    """Wait for a job's end."""
    pause = threading.Event()
    while True:
        found: dict[str, Any] = client.get(f"/api/v1/jobs/{job}").raise_for_status().json()
        if found["state"] not in _OPEN_JOBS:
            return found
        pause.wait(0.05)


def asked(url: str, ids: Ids, *, examples: int, seed: int = 0, phases: tuple[str, ...] = ("fuzzing",)) -> Tally:
    """Ask a service, and check every answer.

    Args:
        url: of the service.
        ids: that exist, by parameter.
        examples: of each operation and phase.
        seed: of what is drawn.
        phases: of schemathesis: examples, coverage, fuzzing, stateful.
    """
    import schemathesis
    from schemathesis.engine import events, from_schema
    from schemathesis.hooks import unregister

    config = schemathesis.Config.from_dict(settings(ids, examples, seed, phases))
    schema = schemathesis.openapi.from_url(f"{url}/api/v1/openapi.json", config=config)
    doomed = iter(range(1 << 30))

    @schemathesis.hook
    def before_call(context: Any, case: Any, kwargs: Any) -> None:
        """Delete none of the sessions that others need; say truly what the body's SHA-256 is."""
        place = case.path_parameters
        if case.method == "PUT" and case.meta is not None and case.meta.generation.mode.is_positive:
            kwargs["auth"] = partial(signed, epoch=(place or {}).get("epoch"))
        if case.method == "DELETE" and place and place.get("session") in ids["session"]:
            place["session"] = f"{DOOMED}-{next(doomed)}"

    tally = Tally()
    try:
        with cancelling(url):
            for event in from_schema(schema).execute():
                if isinstance(event, events.ScenarioFinished):
                    _count(tally, event)
                elif isinstance(event, events.NonFatalError):
                    tally.errors.append(f"{event.label}: {event.info.message}")
                elif isinstance(event, events.FatalError):
                    tally.errors.append(repr(event.exception))
    finally:
        unregister(before_call)
    return tally


def settings(ids: Ids, examples: int, seed: int, phases: tuple[str, ...]) -> dict[str, Any]:
    """Configuration of schemathesis."""
    bound = {key: {"dictionary": name, "probability": share} for key, name, share in _bound(ids)}
    return {
        "seed": seed,
        "dictionaries": {k: {"values": v} for k, v in ids.items()},
        "parameters": bound,
        "generation": {"max-examples": examples, "no-shrink": True, "deterministic": False},
        "phases": {k: {"enabled": k in phases} for k in ("examples", "coverage", "fuzzing", "stateful")},
        "checks": {
            "negative_data_rejection": {"expected-statuses": _REFUSED},
            # What is well formed may still name nothing that exists, or make no sense.
            "positive_data_acceptance": {"enabled": False},
        },
        "continue-on-failure": True,
        "request-timeout": 60.0,
        "warnings": False,
    }


def _count(tally: Tally, event: Any) -> None:
    recorder = event.recorder
    for number, node in recorder.cases.items():
        label = node.value.operation.label
        tally.cases[label] += 1
        tally.phases[event.phase.value] += 1
        found = recorder.interactions.get(number)
        if found is not None and found.response is not None:
            tally.statuses[found.response.status_code] += 1
        for check in recorder.checks.get(number, ()):
            if check.failure_info is not None and not _accepted(label, check.name, found):
                said = f"{check.failure_info.failure.title}: {check.failure_info.failure.message}"
                tally.failures.setdefault((label, check.name), f"{said}\n{check.failure_info.code_sample}")


def signed(request: Any, epoch: Any) -> Any:
    """A request with the SHA-256 of its body, and the epoch that its address says, where it carries them."""
    if SHA256 in request.headers:
        body = request.body or b""
        request.headers[SHA256] = hashlib.sha256(body.encode() if isinstance(body, str) else body).hexdigest()
    if isinstance(epoch, str) and epoch.isascii() and epoch.isprintable() and EPOCH in request.headers:
        request.headers[EPOCH] = epoch
    return request


def _accepted(label: str, check: str, found: Any) -> bool:
    """Whether what a check says against an answer is no fault."""
    if check == "unsupported_method":
        return label == _CURSOR
    if check == "ensure_resource_availability" and found is not None and found.response is not None:
        # What is not there is something that the body names.
        return b"no session" not in (found.response.content or b"")
    return False


def _bound(ids: Ids) -> Iterator[tuple[str, str, float]]:
    """Where which ids are drawn, and how often."""
    for name in ids.keys() - {"model", "effect"}:
        yield f"path.{name}", name, 0.8
    for name in ("session", "specimen", "model", "case", "job", "revision"):
        yield f"query.{name}", name, 0.5
    yield "body.model", "model", 0.5
    yield "body.sessions[*]", "session", 0.8
    for name in ("add", "effects"):
        yield f"body.{name}[*]", "effect", 0.5


@contextmanager
def cancelling(url: str) -> Iterator[None]:
    """Cancel jobs that have run for a second, or they would be hours of work."""
    over = threading.Event()

    def cancel() -> None:
        with httpx.Client(base_url=url, timeout=60, trust_env=False) as client:
            while not over.wait(1.0):
                for state in _OPEN_JOBS:
                    with suppress(httpx.HTTPError):
                        for job in client.get("/api/v1/jobs", params={"state": state}).json()["jobs"]:
                            client.post(f"/api/v1/jobs/{job['id']}/cancel")

    thread = threading.Thread(target=cancel)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
