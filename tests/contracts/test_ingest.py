"""What every receiver of a bench's chunks and events keeps: once, whole, and never another in its place."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from tests.contracts.ingest import CURSOR, DESCRIPTION, EPOCH_1, EPOCH_2, Put, Receiver, SmallReceiver, made
from tests.server.service.running import ServiceReceiver

# A service joins by its name and a function from a folder to a receiver that keeps its data there.
RECEIVERS: dict[str, Callable[[Path], Receiver]] = {
    "small": lambda folder: SmallReceiver(folder / "service.db"),
    "service": ServiceReceiver,
}


@pytest.fixture(params=RECEIVERS)
def put(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Put]:
    receiver = RECEIVERS[request.param](tmp_path)
    out = Put(receiver)
    yield out
    out.client.close()
    receiver.close()


def is_problem(answer: httpx.Response, status: int) -> bool:
    kind = answer.headers["Content-Type"].partition(";")[0]
    return (answer.status_code, kind) == (status, "application/problem+json") and answer.json()["status"] == status


def test_a_chunk_is_stored_as_it_came_and_the_answer_says_how_far(put: Put) -> None:
    assert put.cursor() == {"schema": CURSOR, "next_seq": 0, "missing": [], "ended": False, "epoch": None}
    answer = put.chunk(made(0, 50))
    assert answer.json() == {"schema": CURSOR, "next_seq": 50, "missing": [], "ended": False, "epoch": EPOCH_1}
    assert put.chunk(made(50, 30)).json()["next_seq"] == 80
    assert put.stored() == [made(0, 50).to_bytes(), made(50, 30).to_bytes()]


def test_the_same_again_is_a_success_and_changes_nothing(put: Put) -> None:
    first = put.chunk(made(0, 50))
    assert put.chunk(made(50, 50)).is_success
    again = put.chunk(made(0, 50))
    assert again.status_code == first.status_code == 200
    assert again.json()["next_seq"] == 100
    assert len(put.stored()) == 2


def test_another_chunk_under_the_same_number_is_a_conflict_that_names_what_is_stored(put: Put) -> None:
    kept = made(0, 50)
    put.chunk(kept)
    answer = put.chunk(made(0, 50, salt=1))
    assert is_problem(answer, 409)
    digest = hashlib.sha256(kept.to_bytes()).hexdigest()
    assert answer.json()["stored"] == [{"first_seq": 0, "count": 50, "sha256": digest}]
    assert put.stored() == [kept.to_bytes()]


@pytest.mark.parametrize(("first_seq", "count"), [(0, 100), (49, 1), (25, 50), (50, 51), (99, 1)])
def test_a_chunk_over_others_is_a_conflict_that_names_them_in_order(put: Put, first_seq: int, count: int) -> None:
    for at in (0, 50):
        put.chunk(made(at, 50))
    answer = put.chunk(made(first_seq, count))
    assert is_problem(answer, 409)
    over = [at for at in (0, 50) if at < first_seq + count and at + 50 > first_seq]
    assert [s["first_seq"] for s in answer.json()["stored"]] == over
    assert len(put.stored()) == 2


@pytest.mark.parametrize(
    "instead",
    [
        {"sha256": hashlib.sha256(b"another").hexdigest()},
        {"sha256": ""},
        {"count": "49"},
        {"count": ""},
        {"count": "-50"},
        {"first_seq": "1"},
        {"first_seq": "-1"},
        {"first_seq": "x"},
        {"body": b""},
        {"body": made(0, 50).to_bytes()[:-1]},
        {"body": made(0, 50).to_bytes()[:-5] + b"\x00" + made(0, 50).to_bytes()[-4:]},
        {"body": made(0, 50).to_bytes() + b"\x00"},
    ],
)
def test_what_is_not_as_its_headers_say_or_damaged_is_refused(put: Put, instead: dict[str, Any]) -> None:
    answer = put.chunk(made(0, 50), **instead)
    assert is_problem(answer, answer.status_code)
    assert 400 <= answer.status_code < 500
    # None of those that would be tried again.
    assert answer.status_code not in (408, 409, 413, 425, 429)
    assert put.stored() == []
    assert put.cursor()["next_seq"] == 0


def test_a_chunk_without_an_epoch_is_refused(put: Put) -> None:
    assert is_problem(put.chunk(made(0, 50), epoch=""), 422)
    assert put.stored() == []


def test_any_order_is_taken_and_gaps_are_listed(put: Put) -> None:
    answers = [put.chunk(made(at, 50)).json() for at in (150, 50, 0, 100)]
    assert [a["next_seq"] for a in answers] == [200, 200, 200, 200]
    gaps = [[[0, 150]], [[0, 50], [100, 150]], [[100, 150]], []]
    assert [a["missing"] for a in answers] == gaps
    assert put.stored() == [made(at, 50).to_bytes() for at in (0, 50, 100, 150)]


def test_an_empty_chunk_ends_a_stream_once(put: Put) -> None:
    put.chunk(made(0, 50))
    for _ in range(2):
        assert put.chunk(made(50, 0)).json() == {
            "schema": CURSOR,
            "next_seq": 50,
            "missing": [],
            "ended": True,
            "epoch": EPOCH_1,
        }
    assert is_problem(put.chunk(made(50, 10)), 409)
    assert put.stored() == [made(0, 50).to_bytes(), made(50, 0).to_bytes()]


def test_all_that_was_answered_is_there_after_a_kill(put: Put) -> None:
    put.chunk(made(0, 50))
    put.chunk(made(100, 50))
    put.event(0, b'{"kind":"mark"}')
    before = put.cursor()
    put.receiver.restart()
    assert (
        put.cursor()
        == before
        == {"schema": CURSOR, "next_seq": 150, "missing": [[50, 100]], "ended": False, "epoch": EPOCH_1}
    )
    assert put.event_cursor()["next_seq"] == 1
    assert put.chunk(made(0, 50)).is_success
    assert is_problem(put.chunk(made(0, 50, salt=1)), 409)


def test_another_epoch_is_seen_and_may_neither_change_nor_double_anything(put: Put) -> None:
    put.chunk(made(0, 50))
    assert put.chunk(made(0, 50), EPOCH_2).is_success
    assert put.cursor()["epoch"] == EPOCH_2
    assert is_problem(put.chunk(made(0, 50, salt=1), EPOCH_2), 409)
    assert put.stored() == [made(0, 50).to_bytes()]


def test_streams_and_sessions_are_apart_and_unknown_ones_are_not_found(put: Put) -> None:
    put.chunk(made(0, 50))
    one, session = put.stream, put.session
    put.stream = "b" * 32
    assert is_problem(put.chunk(made(0, 50)), 404)
    assert is_problem(put.client.get(f"{put.path}/cursor"), 404)
    put.describe(DESCRIPTION)
    assert put.cursor()["next_seq"] == 0
    put.stream, put.session = one, put.receiver.new_session()
    assert is_problem(put.chunk(made(0, 50)), 404)
    put.session = session
    assert put.cursor()["next_seq"] == 50


def test_a_stream_is_described_once(put: Put) -> None:
    put.chunk(made(0, 50))
    assert put.describe(DESCRIPTION).is_success
    assert is_problem(put.describe(b'{"driver": "another"}'), 409)
    assert put.cursor()["next_seq"] == 50


def test_events_are_kept_by_epoch_and_number(put: Put) -> None:
    assert put.event_cursor() == {"schema": CURSOR, "next_seq": 0, "missing": []}
    bodies = {n: json.dumps({"kind": "mark", "value": {"n": n}}).encode() for n in range(3)}
    assert put.event(2, bodies[2]).json() == {"schema": CURSOR, "next_seq": 3, "missing": [[0, 2]]}
    assert put.event(0, bodies[0]).json()["missing"] == [[1, 2]]
    assert put.event(0, bodies[0]).json()["missing"] == [[1, 2]]
    assert is_problem(put.event(0, bodies[1]), 409)
    assert is_problem(put.event(1, bodies[1], digest="0" * 64), 422)
    put.event(1, bodies[1])
    put.event(0, bodies[2], EPOCH_2)
    assert [e["value"]["n"] for e in put.receiver.events(put.session)] == [0, 1, 2, 2]
