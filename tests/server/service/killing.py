"""A service that is killed again and again while two benches send and refits run, and what must hold of it."""

from __future__ import annotations

import json
import random
import socket
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
from sqlalchemy import func, select, text
from websockets.exceptions import WebSocketException
from websockets.sync.client import connect

from daq.journal.reader import JournalReader
from daq.journal.writer import Event, Journal
from daq.uplink.events import encoded
from daq.uplink.link import open_client
from daq.uplink.thread import Uplink
from daq.uplink.wire import SHA256
from server.service.storage.database import Database
from server.service.storage.schema import chunks, events, jobs, messages, revisions, sessions, streams
from tests.contracts.ingest import made
from tests.server.service.processes import PATIENCE_S, Process, whole
from tests.server.service.recorded import upload

SESSION, BENCHES = "synek2019_H01", ("BENCH-1", "BENCH-2")
SAMPLES, EACH_S, EVENTS_EACH = 200, 0.25, 3
_OPEN = ("queued", "running")
_DEAD_S = 15.0


@dataclass
class Tally:
    """What was done, and every rule that was broken.

    Attributes:
        kills: by what the service was doing.
        acknowledged: chunks, events and jobs that the service has answered for.
        wrong: broken rules, in words.
        ready_s: how long each start took until it was ready.
    """

    kills: Counter[str] = field(default_factory=Counter)
    acknowledged: Counter[str] = field(default_factory=Counter)
    jobs: Counter[str] = field(default_factory=Counter)
    stored: Counter[str] = field(default_factory=Counter)
    heard: int = 0
    wrong: list[str] = field(default_factory=list)
    ready_s: list[float] = field(default_factory=list)


class Bench:
    """A journal that grows, and its uplink, which notes what was acknowledged."""

    def __init__(self, name: str, folder: Path, url: str) -> None:
        self.name, self.path = name, folder / f"{name}.journal"
        self.acknowledged: dict[str, str] = {}
        self.journal = Journal.create(self.path, name, 0)
        client = open_client(url, None)
        client.event_hooks["response"].append(self._note)
        self.uplink = Uplink(self.journal, url, name, client=client, begins=True)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._write)
        self._thread.start()
        self.uplink.start()

    def stop(self) -> None:
        """Read nothing more."""
        self._over.set()
        self._thread.join()

    def close(self) -> None:
        """End."""
        self.stop()
        self.uplink.stop()
        self.journal.close()

    def _write(self) -> None:
        stream = self.journal.add_stream("made", {"rate_hz": 1000.0}, {"serial": self.name})
        number = 0
        while not self._over.wait(EACH_S):
            happened = [Event("mark", EACH_S * number, {"i": number})] if number % EVENTS_EACH == 0 else []
            self.journal.append(stream, made(number * SAMPLES, SAMPLES), happened)
            number += 1

    def _note(self, response: httpx.Response) -> None:
        digest = response.request.headers.get(SHA256)
        if response.status_code == 200 and digest:
            self.acknowledged[response.request.url.path] = digest


class Listener:
    """A live client that connects again after the last message that it heard."""

    def __init__(self, url: str) -> None:
        self.heard: list[int] = []
        self.problems: list[str] = []
        self._url = f"{url.replace('http', 'ws')}/api/v1/live"
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._listen)
        self._thread.start()

    def close(self) -> None:
        """End."""
        self._over.set()
        self._thread.join()

    def _listen(self) -> None:
        while not self._over.wait(0.1):
            with suppress(OSError, WebSocketException, TimeoutError):
                after = self.heard[-1] if self.heard else 0
                with connect(f"{self._url}?after={after}", open_timeout=5, max_size=None) as connection:
                    while not self._over.is_set():
                        with suppress(TimeoutError):
                            self._take(json.loads(connection.recv(timeout=0.5)))

    def _take(self, told: list[dict[str, Any]]) -> None:
        for message in told:
            if message.get("another_database"):
                self.problems.append(f"after {message['asked_after']} it was told of another database")
            if message.get("id") is not None:
                self.heard.append(message["id"])


class Asker:
    """Asks for one refit after the other, and notes the jobs that were taken."""

    def __init__(self, url: str) -> None:
        self.taken: list[str] = []
        self._client = httpx.Client(base_url=url, timeout=10, trust_env=False)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._ask)
        self._thread.start()

    def close(self) -> None:
        """End."""
        self._over.set()
        self._thread.join()
        self._client.close()

    def _ask(self) -> None:
        while not self._over.wait(0.2):
            with suppress(httpx.HTTPError):
                rows = self._client.get("/api/v1/jobs", params={"limit": 1}).raise_for_status().json()["jobs"]
                if not rows or rows[0]["state"] not in _OPEN:
                    answer = self._client.post(f"/api/v1/sessions/{SESSION}/fits", json={}).raise_for_status()
                    self.taken.append(answer.json()["id"])


class Killed:
    """The service of a folder, on one address through all its lives.

    Args:
        folder: of its data and of the benches' journals.
        url: of another database than SQLite's.
        seed: of when it is killed.
    """

    def __init__(self, folder: Path, database: str | None = None, seed: int = 0) -> None:
        self.folder, self.draw, self.tally = folder, random.Random(seed), Tally()  # noqa: S311
        self.database = Database(database or f"sqlite:///{folder / 'data' / 'fingertwin.db'}")
        self.port = _free_port()
        self.url = f"http://127.0.0.1:{self.port}"

    def run(self, kills: int, *, longest_s: float = 3.0, refits: bool = True) -> Tally:
        """Kill it so often, let it live on once more, and look at what is there.

        Args:
            kills: how many lives end by one.
            longest_s: that it lives once it is ready, unless it shall end a refit.
            refits: whether some lives last to a refit's end, and the last one until all jobs have ended.
        """
        with ExitStack() as held:
            with self.life() as service, service.client() as client:
                self._ready(service)
                upload(client, SESSION)
            benches = [Bench(name, self.folder, self.url) for name in BENCHES]
            for bench in benches:
                held.callback(bench.close)
            asker, listener = Asker(self.url), Listener(self.url)
            held.callback(listener.close)
            held.callback(asker.close)
            for k in range(kills):
                self._one_life(k, longest_s, refits=refits)
                self._look(benches, asker)
                print(f"{k + 1} of {kills}: {len(self.tally.wrong)} wrong", flush=True)
            with self.life() as service:
                self._ready(service)
                self._settle(service, benches, asker, listener, refits=refits)
            self._look(benches, asker)
            for bench in benches:
                bench.close()
                self._compare(bench)
            self._compare_heard(listener)
        self.database.close()
        return self.tally

    @contextmanager
    def life(self) -> Iterator[Process]:
        """A service that runs, and is killed in the end."""
        service = Process(whole(self.folder / "data", "--port", str(self.port)))
        try:
            yield service
        finally:
            children = _children(service)
            service.close()
            until = time.monotonic() + _DEAD_S
            while (left := [p for p in children if _lives(p)]) and time.monotonic() < until:
                time.sleep(0.05)
            self.tally.wrong += [f"worker {number} lives on" for number, _ in left]

    def _one_life(self, number: int, longest_s: float, *, refits: bool) -> None:
        kind = "starting" if number % 9 == 4 else "refitting to the end" if refits and number % 12 == 7 else "running"
        with self.life() as service:
            if kind == "starting":
                time.sleep(self.draw.uniform(0.0, 3.0))
            else:
                self._ready(service)
                self._wait(kind, longest_s)
            self.tally.kills[kind] += 1

    def _wait(self, kind: str, longest_s: float) -> None:
        """Wait for the moment of death: any, or shortly about the end of a refit."""
        if kind == "refitting to the end":
            before, until = self._done(), time.monotonic() + 40.0
            while self._done() == before and time.monotonic() < until:
                time.sleep(0.01)
            time.sleep(self.draw.choice((0.0, 0.02)))
        else:
            time.sleep(self.draw.uniform(0.0, longest_s))

    def _done(self) -> int:
        with self.database.reading() as connection:
            return connection.execute(select(func.count()).select_from(jobs).where(jobs.c.state == "done")).scalar_one()

    def _ready(self, service: Process) -> None:
        began = time.monotonic()
        with httpx.Client(base_url=self.url, timeout=10, trust_env=False) as client:
            while time.monotonic() - began < PATIENCE_S:
                if service.process.poll() is not None:
                    raise RuntimeError(f"it did not start: {service.log}")
                with suppress(httpx.HTTPError):
                    if client.get("/api/v1/health/ready").status_code == 200:
                        self.tally.ready_s.append(time.monotonic() - began)
                        return
                time.sleep(0.02)
        raise RuntimeError(f"it was never ready: {service.log}")

    def _settle(
        self, service: Process, benches: list[Bench], asker: Asker, listener: Listener, *, refits: bool
    ) -> None:
        """Let all that was begun come to its end."""
        asker.close()
        for bench in benches:
            bench.stop()
            if not bench.uplink.flush(PATIENCE_S):
                self.tally.wrong.append(f"{bench.name} did not catch up: {bench.uplink.status()}")
        with service.client() as client:
            for job in asker.taken if refits else ():
                while client.get(f"/api/v1/jobs/{job}").raise_for_status().json()["state"] in _OPEN:
                    time.sleep(0.1)
        with self.database.reading() as connection:
            last = connection.execute(select(func.max(messages.c.id))).scalar_one()
        until = time.monotonic() + PATIENCE_S
        while (not listener.heard or listener.heard[-1] < last) and time.monotonic() < until:
            time.sleep(0.05)

    def _look(self, benches: list[Bench], asker: Asker) -> None:
        """Look at what a dead service has left: all that it answered for, and nothing by halves."""
        wrong = self.tally.wrong
        # What is acknowledged from here on need not be there yet.
        notes = {b.name: dict(b.acknowledged) for b in benches}
        taken = list(asker.taken)
        with self.database.reading() as connection:
            if self.database.dialect == "sqlite":
                said = connection.execute(text("PRAGMA quick_check")).scalar()
                wrong += [] if said == "ok" else [f"the database is damaged: {said}"]
            held = {f"/api/v1/sessions/{r.session}/streams/{r.stream}/chunks/{r.first_seq}": r.sha256
                    for r in connection.execute(select(chunks.c.session, chunks.c.stream, chunks.c.first_seq, chunks.c.sha256))}  # fmt: skip  # noqa: E501
            held |= {f"/api/v1/sessions/{r.session}/events/{r.epoch}/{r.number}": r.sha256
                     for r in connection.execute(select(events.c.session, events.c.epoch, events.c.number, events.c.sha256))}  # fmt: skip  # noqa: E501
            for note in notes.values():
                wrong += [f"lost: {path}" for path, digest in note.items() if held.get(path) != digest]
            rows = {r.id: r for r in connection.execute(select(jobs.c.id, jobs.c.kind, jobs.c.state, jobs.c.result))}
            wrong += [f"job {name} is lost" for name in taken if name not in rows]
            kept = {r.id: r.provenance.get("job") for r in connection.execute(select(revisions))}
            # The same refit again gives the very same revision, which is kept once.
            for job in rows.values():
                if job.state == "done" and (job.result or {}).get("model") not in kept:
                    wrong.append(f"job {job.id} is done, and has no revision")
                elif job.state != "done" and job.id in kept.values():
                    wrong.append(f"job {job.id} is {job.state}, and has a revision")
            wrong += self._uneven(connection)
        self.tally.jobs = Counter(r.state for r in rows.values())
        self.tally.stored = Counter(path.split("/")[-2 if "/chunks/" in path else -3] for path in held)
        count = Counter("chunks" if "/chunks/" in path else "events" for note in notes.values() for path in note)
        self.tally.acknowledged = count + Counter(jobs=len(taken))

    @staticmethod
    def _uneven(connection: Any) -> Iterator[str]:
        """What was kept in two places in one transaction, and is not the same in both."""
        for row in connection.execute(select(streams)).all():
            mine = (chunks.c.session == row.session) & (chunks.c.stream == row.id)
            query = select(
                func.coalesce(func.sum(chunks.c.n), 0), func.coalesce(func.max(chunks.c.first_seq + chunks.c.n), 0)
            )
            found = tuple(connection.execute(query.where(mine)).one())
            if found != (row.held, row.next_seq):
                yield f"stream {row.id} says {(row.held, row.next_seq)}, its chunks {found}"
        for name in BENCHES:
            version = connection.execute(select(sessions.c.version).where(sessions.c.id == name)).scalar()
            told, held, begun = (
                connection.execute(select(func.count()).select_from(t).where(t.c.session == name, *more)).scalar()
                for t, more in ((messages, (messages.c.kind == "event",)), (events, ()), (streams, ()))
            )
            # Each event and each stream that is begun raises it.
            if told != held or (version or 0) != held + begun:
                yield f"{name} is of version {version}, with {begun} streams, {held} events and {told} told"

    def _compare(self, bench: Bench) -> None:
        """Compare a journal with what arrived of it, byte by byte."""
        wrong, name = self.tally.wrong, bench.name
        with self.database.reading() as connection, closing(JournalReader.open(bench.path)) as here:
            for stream in here.streams():
                mine = (chunks.c.session == name) & (chunks.c.stream == stream.id)
                query = select(chunks.c.payload).where(mine).order_by(chunks.c.first_seq)
                there = [bytes(p) for p in connection.execute(query).scalars()]
                if there != [c.to_bytes() for c in here.read(stream.id)]:
                    wrong.append(f"{name}: the stored chunks are not those of its journal")
            query = select(events.c.body).where(events.c.session == name)
            said = Counter(encoded(event).decode() for event in here.events())
            heard = Counter(connection.execute(query).scalars())
            if said != heard:
                wrong.append(f"{name}: {(said - heard).total()} events lost, {(heard - said).total()} too many")

    def _compare_heard(self, listener: Listener) -> None:
        with self.database.reading() as connection:
            kept = list(connection.execute(select(messages.c.id).order_by(messages.c.id)).scalars())
        self.tally.heard = len(listener.heard)
        self.tally.wrong += listener.problems
        if listener.heard != kept:
            missed, twice = len(set(kept) - set(listener.heard)), len(listener.heard) - len(set(listener.heard))
            self.tally.wrong.append(
                f"live: {missed} of {len(kept)} messages missed, {twice} heard twice, or disordered"
            )


def _stat(number: int) -> list[str]:
    """What the system (Linux) says of a process after its name: state, parent, …, start; empty where it is gone."""
    with suppress(OSError):
        return Path(f"/proc/{number}/stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()
    return []


def _children(service: Process) -> list[tuple[int, str]]:
    """Number and start of each process that a service has begun, and of theirs."""
    known = {int(p.name): _stat(int(p.name)) for p in Path("/proc").iterdir() if p.name.isdecimal()}
    found = [service.process.pid]
    for parent in found:
        found += [number for number, stat in known.items() if stat and int(stat[1]) == parent]
    return [(number, known[number][19]) for number in found[1:]]


def _lives(process: tuple[int, str]) -> bool:
    stat = _stat(process[0])
    return bool(stat) and stat[19] == process[1] and stat[0] != "Z"


def _free_port() -> int:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        port: int = taken.getsockname()[1]
        return port
