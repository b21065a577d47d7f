"""Folders that are sent as they are: taken in whole with their readings, or refused in one line with nothing kept."""

from __future__ import annotations

import asyncio
import base64
import gzip
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from fastapi import APIRouter, FastAPI
from sqlalchemy import func, select
from starlette.types import Message

from daq.recordings.columns import HEADERS
from daq.sessions import find_session, read_yaml
from fingermodel.comparing import compare
from fingermodel.session import Session
from server.service.ingest.ingest import Ingest
from server.service.storage.schema import chunks, sessions
from server.service.uploads import importing
from server.service.uploads.importing import import_folder
from server.service.web.edge import Edge
from server.service.web.metrics import Metrics
from server.service.web.problems import ProblemError
from server.service.web.strict_requests import StrictRoute
from server.service.web.workers import GoneError, require_client
from tests.server.service.asks import scope_of
from tests.server.service.running import ServiceReceiver

RECORDED, PUBLISHED = "DEV-02", "synek2019_H01"
AT = "/api/v1/imports"
Files = dict[str, bytes]


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServiceReceiver]:
    out = ServiceReceiver(tmp_path_factory.mktemp("service"))
    yield out
    out.close()


def folder_of(name: str) -> Files:
    """The files of a shipped session."""
    return {p.name: p.read_bytes() for p in find_session(name).parent.iterdir() if p.is_file()}


def send(service: ServiceReceiver, files: Files, **more: Any) -> Any:
    rows = [{"name": n, "base64": base64.b64encode(content).decode()} for n, content in files.items()]
    return service.client().post(AT, json={"files": rows} | more)


def readings(files: Files) -> list[str]:
    return gzip.decompress(files["readings.csv.gz"]).decode().splitlines()


def with_readings(lines: list[str]) -> Files:
    return folder_of(RECORDED) | {"readings.csv.gz": gzip.compress("\n".join(lines).encode() + b"\n", 1)}


def test_a_folder_is_compared_as_by_the_command_line(service: ServiceReceiver) -> None:
    made = send(service, folder_of(RECORDED))
    assert made.status_code == 201, made.text
    assert made.json()["cases"] == {"measured": 96}
    ours = service.client().get(f"/api/v1/sessions/{RECORDED}/comparison").json()["cases"]
    theirs = compare(Session.open(RECORDED, catalogue=False)).as_dict()["cases"]
    assert [c["residual_N"] for c in ours] == [pytest.approx(c["residual_N"]) for c in theirs]
    again = send(service, folder_of(RECORDED))
    assert (again.status_code, again.json()["version"]) == (200, made.json()["version"])
    assert (made.json()["already_there"], again.json()["already_there"]) == (False, True)


def test_a_folder_with_a_window_outside_its_recording_leaves_nothing(service: ServiceReceiver) -> None:
    files = folder_of(RECORDED)
    text = files["session.yaml"].decode()
    first = text.index("loaded_s: [", text.index("\ncases:"))
    moved = text[:first] + "loaded_s: [9000.0, 9003.0]" + text[text.index("]", first) + 1 :]
    refused = send(service, files | {"session.yaml": moved.encode()}, id="unsound")
    assert refused.status_code == 422
    assert "lies outside the recording" in refused.json()["detail"]
    assert service.client().get("/api/v1/sessions/unsound").status_code == 404


def test_a_folder_without_readings_and_one_under_another_name(service: ServiceReceiver) -> None:
    assert send(service, folder_of(PUBLISHED), id="H01-again").json()["id"] == "H01-again"
    assert send(service, folder_of(RECORDED), id="other").json()["cases"] == {"measured": 96}


def test_a_shipped_example_is_taken_in_by_its_name_alone(service: ServiceReceiver) -> None:
    first, again = (service.client().post(f"{AT}/examples/synek2019_H02") for _ in range(2))
    assert (first.status_code, again.status_code) == (201, 200)
    cases = service.client().get("/api/v1/sessions/synek2019_H02/comparison").json()["cases"]
    assert len(cases) == len(compare(Session.open("synek2019_H02", catalogue=False)).cases)
    refused = service.client().post(f"{AT}/examples/nothing")
    assert (refused.status_code, "DEV-02" in refused.json()["detail"]) == (404, True)


def test_readings_need_not_be_packed_nor_named_so(service: ServiceReceiver) -> None:
    files = folder_of(RECORDED)
    plain = files | {"readings.csv.gz": gzip.decompress(files["readings.csv.gz"])}
    assert send(service, plain, id="plain").json()["cases"] == {"measured": 96}


def changed(find: str, instead: str) -> Files:
    files = folder_of(RECORDED)
    text = files["session.yaml"].decode()
    assert find in text
    return files | {"session.yaml": text.replace(find, instead, 1).encode()}


def bad() -> dict[str, tuple[Files, str]]:
    files = folder_of(RECORDED)
    lines = readings(files)
    head, first = lines[0], lines[1].split(",")
    description = files["session.yaml"]
    return {
        "no session": ({"notes.txt": b"x"}, "none of them session.yaml"),
        "no readings": ({"session.yaml": description}, "which is not among the files"),
        "a column lacks": (with_readings([",".join(row.split(",")[:-1]) for row in lines]), "Tz_Nmm"),
        "not a number": (with_readings([head, ",".join([*first[:3], "nan", *first[4:]]), *lines[2:]]), "is 'nan'"),
        "wrong units": (with_readings([head.replace("Fx_N", "Fx_furlong"), *lines[1:]]), "Fx_furlong"),
        "no rows": (with_readings([head]), "a header and no readings"),
        "torn": (files | {"readings.csv.gz": files["readings.csv.gz"][:5000]}, "torn or damaged"),
        "not YAML": (files | {"session.yaml": b"format: [bench-session/1"}, "not YAML"),
        "not a session": (files | {"session.yaml": b"- one\n- two\n"}, "keys with values"),
        "another format": (changed("bench-session/1", "bench-session/7"), "bench-session/1"),
        "a file elsewhere": (changed("readings.csv.gz", "../../../etc/passwd"), "which is not among the files"),
        "a finger elsewhere": (changed("an1979_middle", "/etc/passwd"), "finger names '/etc/passwd'"),
        "a path": (files | {"../x.csv": b"1"}, "a file called '../x.csv'"),
        "a bomb": (
            files | {"session.yaml": b"a0: &a0 [1,1,1,1,1,1,1,1,1]\n" + b"".join(
                b"a%d: &a%d [%s]\n" % (k, k, b",".join([b"*a%d" % (k - 1)] * 9)) for k in range(1, 12))},
            "more than",
        ),
        "time stands still": (
            with_readings([head, *(",".join(["0", *row.split(",")[1:]]) for row in lines[1:])]),
            "time goes from 0 s to 0 s",
        ),
        "itself": (files | {"session.yaml": b"a: &a {b: *a}\n"}, "levels"),
    }  # fmt: skip


@pytest.mark.parametrize("what", list(bad()))
def test_a_folder_that_cannot_be_used_is_refused_in_one_line(service: ServiceReceiver, what: str) -> None:
    files, said = bad()[what]
    name = "bad-" + what.replace(" ", "-")
    answer = send(service, files, id=name)
    assert answer.status_code == 422, answer.text
    assert said in answer.json()["detail"]
    assert "\n" not in answer.json()["detail"]
    assert service.client().get(f"/api/v1/sessions/{name}").status_code == 404


def test_what_is_no_base64_or_too_large_is_refused(service: ServiceReceiver, tmp_path: Path) -> None:
    body = {"files": [{"name": "session.yaml", "base64": "*"}]}
    assert "base64" in service.client().post(AT, json=body).json()["detail"]
    small = ServiceReceiver(tmp_path, most_body_bytes=1 << 16)
    assert send(small, folder_of(RECORDED)).status_code == 413
    small.close()


def test_other_readings_under_the_same_name_are_a_conflict(service: ServiceReceiver) -> None:
    assert send(service, folder_of(RECORDED), id="twice").status_code == 201
    lines = readings(folder_of(RECORDED))
    other = send(service, with_readings(lines[:-1]), id="twice")
    assert other.status_code == 409
    assert "described otherwise" in other.json()["detail"]
    service.client().delete("/api/v1/sessions/twice").raise_for_status()
    assert send(service, with_readings(lines[:-1]), id="twice").status_code == 409
    assert service.client().get("/api/v1/sessions/twice").status_code == 404
    back = send(service, folder_of(RECORDED), id="twice")
    assert (back.status_code, back.json()["already_there"], back.json()["cases"]) == (200, True, {"measured": 96})


def packed_rows(rows: int, kind: str) -> bytes:
    """Readings that say the same in every row, which pack to next to nothing."""
    if kind == "parquet":
        columns = {"t_s": np.arange(rows) / 1e3} | {h: np.zeros(rows) for h in HEADERS[1:]}
        sink = pa.BufferOutputStream()
        pq.write_table(pa.table(columns), sink, compression="zstd")
        content: bytes = sink.getvalue().to_pybytes()
        return content
    text = "".join(f"{k},0,0,0,0,0,0\n" for k in range(rows))
    return gzip.compress((",".join(HEADERS) + "\n" + text).encode(), 1)


@pytest.mark.parametrize("kind", ["parquet", "csv.gz"])
@pytest.mark.parametrize("limit", ["MOST_ROWS", "MOST_BYTES"])
def test_readings_that_unpack_to_too_many_are_refused(
    service: ServiceReceiver, monkeypatch: pytest.MonkeyPatch, kind: str, limit: str
) -> None:
    monkeypatch.setattr(importing, limit, 1000 if limit == "MOST_ROWS" else 5000)
    given = changed("readings.csv.gz", f"readings.{kind}")
    answer = send(service, given | {f"readings.{kind}": packed_rows(1001, kind)}, id=f"bomb-{kind}-{limit}")
    assert answer.status_code == 413, answer.text
    assert "fingertwin replay" in answer.json()["remedy"]
    assert left_of(service, f"bomb-{kind}-{limit}") == (0, 0)


def test_lines_without_end_are_unpacked_no_further_than_the_limit(
    service: ServiceReceiver, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Empty lines are no rows; only their bytes say that there are too many.
    monkeypatch.setattr(importing, "MOST_BYTES", 1 << 20)
    files = folder_of(RECORDED)
    bomb = gzip.compress((",".join(HEADERS) + "\n" * (1 << 21)).encode())
    assert len(bomb) < 10_000
    assert send(service, files | {"readings.csv.gz": bomb}, id="lines").status_code == 413


def left_of(service: ServiceReceiver, session: str) -> tuple[int, int]:
    """Rows of a session, and of its chunks."""
    with service.parts.database.reading() as connection:
        counts = [
            connection.execute(select(func.count()).select_from(t).where(c == session)).scalar_one()
            for t, c in ((sessions, sessions.c.id), (chunks, chunks.c.session))
        ]
    return counts[0], counts[1]


@pytest.mark.parametrize("fault", [GoneError(), OSError(28, "No space left on device")])
def test_an_import_that_ends_half_way_leaves_nothing(
    service: ServiceReceiver, monkeypatch: pytest.MonkeyPatch, fault: Exception
) -> None:
    put_chunk, name = Ingest.put_chunk, f"half-{type(fault).__name__}"
    put: list[str] = []

    def breaks(self: Ingest, session: str, *rest: Any, **more: Any) -> dict[str, Any]:
        if put:
            # Whoever looks meanwhile sees nothing of it, and nobody else may take its id.
            assert left_of(service, session) == (1, 1)
            assert service.client().get(f"/api/v1/sessions/{session}").status_code == 404
            raise fault
        put.append(session)
        return put_chunk(self, session, *rest, **more)

    monkeypatch.setattr(Ingest, "put_chunk", breaks)
    files = [(n, base64.b64encode(c).decode()) for n, c in folder_of(RECORDED).items()]
    with pytest.raises(type(fault)):
        import_folder(service.parts, files, name)
    assert left_of(service, name) == (0, 0)
    monkeypatch.undo()
    assert import_folder(service.parts, files, name) == (name, True)


def test_what_a_killed_service_left_of_an_import_is_gone_after_its_start(service: ServiceReceiver) -> None:
    document = {**read_yaml(find_session(PUBLISHED)), "id": "killed"}
    service.parts.sessions.create("killed", document, arriving=True)
    with pytest.raises(ProblemError, match="is being taken in"):
        service.parts.sessions.create("killed", document)
    assert "killed" not in {s["id"] for s in service.parts.sessions.listed(limit=1000)}
    service.parts.sessions.forget_arrivals()
    assert left_of(service, "killed") == (0, 0)


def test_a_client_that_goes_ends_the_work_it_asked_for() -> None:
    rounds, ended = threading.Event(), threading.Event()
    app = FastAPI()
    router = APIRouter(route_class=StrictRoute)

    @router.get("/long")
    def long() -> None:
        try:
            while True:
                require_client()
                rounds.set()
                time.sleep(0.001)
        except GoneError:
            ended.set()
            raise

    app.include_router(router)
    app.add_middleware(Edge, metrics=Metrics())

    async def main() -> list[Message]:
        scope = scope_of("http", "/long", {}, "127.0.0.1") | {"method": "GET", "query_string": b""}
        said: list[Message] = [{"type": "http.request", "body": b"", "more_body": False}]
        sent: list[Message] = []

        async def receive() -> Message:
            if said:
                return said.pop()
            await asyncio.to_thread(rounds.wait)
            return {"type": "http.disconnect"}

        async def send(message: Message) -> None:
            sent.append(message)

        await asyncio.wait_for(app(scope, receive, send), 10)
        return sent

    assert asyncio.run(main()) == []
    assert ended.is_set()
