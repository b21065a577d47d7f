"""The live path: envelopes of what was just read, sent without keeping anything waiting."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import numpy as np

from daq.uplink.live_tail import WINDOW_S, LiveTail
from tests.contracts.ingest import serving


def offer(tail: LiveTail, *values: float, overload: bool = False, stream: str = "s") -> None:
    wrench = np.tile(np.array(values)[:, None], (1, 6))
    tail.offer(stream, np.array(values), wrench, np.full(len(values), overload))


def tail_of(answer: Callable[[httpx.Request], httpx.Response], **options: Any) -> LiveTail:
    client = httpx.Client(base_url="http://service", transport=httpx.MockTransport(answer))
    return LiveTail("http://service", "S 1", client=client, **options)


def test_an_envelope_hides_no_peak_and_ends_in_the_latest() -> None:
    now = [0.0]
    bodies: list[Any] = []

    def taken(request: httpx.Request) -> httpx.Response:
        bodies.append((request.url.raw_path, request.read()))
        return httpx.Response(202)

    tail = tail_of(taken, clock=lambda: now[0])
    offer(tail, 1.0, 9.0, 2.0)
    offer(tail, 3.0, np.nan, overload=True)
    offer(tail, -4.0, 3.5)
    assert tail.take() == []
    now[0] = WINDOW_S
    windows = tail.take()
    assert tail.take() == []
    assert [w.message() for w in windows] == [
        {
            "stream": "s", "from_s": 1.0, "to_s": 3.5, "count": 7, "latest": [3.5] * 6, "least": [-4.0] * 6,
            "most": [9.0] * 6, "mean": [14.5 / 6.0] * 6, "overload": True,
        }
    ]  # fmt: skip
    assert tail.post(windows)
    assert bodies[0][0] == b"/api/v1/sessions/S%201/live"
    offer(tail, np.nan)
    now[0] = 3.0 * WINDOW_S
    nothing = tail.take()[0].message()
    assert nothing["latest"] == nothing["mean"] == [None] * 6
    tail.stop()


def test_old_envelopes_make_room_for_new_ones_and_are_counted() -> None:
    now = [0.0]
    tail = tail_of(lambda _: httpx.Response(202), clock=lambda: now[0], waiting=3)
    for i in range(10):
        now[0] = 1.05 * WINDOW_S * i
        offer(tail, float(i))
    now[0] = 1.0
    windows = tail.take()
    assert [w.latest[0] for w in windows] == [7.0, 8.0, 9.0]
    assert tail.dropped == 7
    assert tail.post(windows)
    assert (tail.sent, tail.dropped) == (3, 7)
    tail.stop()


def test_what_was_not_taken_is_not_sent_again() -> None:
    posted: list[bytes] = []

    def refusing(request: httpx.Request) -> httpx.Response:
        posted.append(request.read())
        if len(posted) == 1:
            raise httpx.ConnectError("none there")
        return httpx.Response(500 if len(posted) == 2 else 202)

    now = [0.0]
    tail = tail_of(refusing, clock=lambda: now[0])
    for value in (1.0, 2.0, 3.0):
        offer(tail, value)
        now[0] += 1.05 * WINDOW_S
        tail.post(tail.take())
    assert (tail.sent, tail.dropped) == (1, 2)
    assert b'"latest": [3.0' in posted[2]
    assert b'"dropped": 2' in posted[2]
    tail.stop()


def test_what_is_offered_is_seen_within_60_ms(tmp_path: Path) -> None:
    seen: dict[float, float] = {}

    def watching(request: httpx.Request) -> httpx.Response:
        for envelope in json.loads(request.read())["envelopes"]:
            seen[envelope["latest"][0]] = time.monotonic()
        return httpx.Response(202)

    offered: dict[float, float] = {}
    with serving(watching) as url:
        tail = LiveTail(url, "S")
        tail.start()
        for i in range(60):
            offered[float(i)] = time.monotonic()
            offer(tail, float(i))
            time.sleep(0.01)
        time.sleep(0.1)
        tail.stop()
    late_s = sorted(seen[value] - offered[value] for value in seen)
    assert len(late_s) > 10
    # Of a busy machine some are late; that the path itself is not, most tell.
    assert late_s[len(late_s) // 2] < 0.06
    assert max(seen) >= 58.0


def test_what_was_answered_last_is_said_before_it_hangs_up() -> None:
    posting, go_on = threading.Event(), threading.Event()
    answers: list[Any] = []

    def slow(request: httpx.Request) -> httpx.Response:
        posting.set()
        go_on.wait(20.0)
        answers.extend(json.loads(request.content).get("answers", []))
        return httpx.Response(202)

    tail = tail_of(slow, window_s=0.001)
    tail.start()
    offer(tail, 1.0)
    assert posting.wait(20.0)
    # The answer to what ends the bench: it ends while the thread still sends what was before.
    tail.answer(7, None)
    threading.Timer(0.1, go_on.set).start()
    tail.stop()
    assert answers == [{"number": 7, "refused": None}]


def test_a_service_that_hangs_keeps_no_one_waiting() -> None:
    go_on = threading.Event()

    def hanging(request: httpx.Request) -> httpx.Response:
        go_on.wait(20.0)
        return httpx.Response(202)

    tail = tail_of(hanging, waiting=5, window_s=0.001)
    tail.start()
    began = time.monotonic()
    for i in range(200):
        offer(tail, float(i))
        time.sleep(0.0005)
    assert time.monotonic() - began < 5.0
    assert tail.dropped > 0
    go_on.set()
    tail.stop()
