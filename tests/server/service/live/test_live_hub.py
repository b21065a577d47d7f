"""The hub: kept messages once and in order whatever happens, and no client that another one waits for."""

from __future__ import annotations

import asyncio
import math
import threading
from pathlib import Path

import numpy as np
import pytest

from daq.acquisition.blocks import Chunk
from daq.uplink.live_tail import WINDOW_S
from server.service.live import clients, hub
from server.service.live.clients import FRAMES_WAITING, TRY_AGAIN
from server.service.live.connection import MOST_CLIENTS
from server.service.storage.checksums import sealed
from server.service.storage.messages import Message, Messages
from tests.server.service.live_sockets import FakeSocket, Served, hub_of, keep, messages_in, played, posted


def told(number: int) -> Message:
    return Message("event", "S", {}, number)


# ----- order


def test_a_message_whose_predecessor_was_never_kept_is_told_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Nothing else happens that would make the hub look again.
    monkeypatch.setattr(hub, "HEARTBEAT_S", 1e6)

    async def play(served: Served, messages: Messages) -> None:
        socket = await served.connect("S")
        keep(messages, "case")
        await socket.until(socket.ids)
        # As on a database that gives the number of a transaction that is rolled back to no other.
        with messages.writing() as telling:
            row = (7, "S", "event", "", sealed("{}"))
            telling.connection.exec_driver_sql("INSERT INTO messages VALUES (?, ?, ?, ?, ?)", row)
            telling.told.append(told(7))
        for k in (1, 2):
            served.hub.trace("S", posted(float(k)))
            await socket.until(lambda k=k: len(socket.told("trace")) == k)  # type: ignore[misc]
        await socket.until(lambda: len(socket.ids()) == 2)
        keep(messages, "job")
        await socket.until(lambda: len(socket.ids()) == 3)
        assert socket.ids() == [1, 7, 8]

    played(tmp_path, play)


def test_threads_are_told_of_in_the_order_in_which_they_keep(tmp_path: Path) -> None:
    async def play(served: Served, messages: Messages) -> None:
        socket = await served.connect("S")
        # A thread is held up between keeping its message and telling it; the next one has to wait for it.
        kept, go_on = threading.Event(), threading.Event()

        def hold_up(message: Message) -> None:
            if message.body["n"] == 1:
                kept.set()
                assert go_on.wait(10.0)

        messages._listeners.insert(0, hold_up)
        first, second = (threading.Thread(target=keep, args=(messages, "event"), kwargs={"n": n}) for n in (1, 2))
        first.start()
        assert await asyncio.to_thread(kept.wait, 10.0)
        second.start()
        await asyncio.to_thread(second.join, 0.2)
        assert second.is_alive()
        go_on.set()
        for thread in (first, second):
            await asyncio.to_thread(thread.join)
        keep(messages, "event", n=3)
        await socket.until(lambda: len(socket.ids()) == 3)
        assert [m["body"]["n"] for m in socket.told("event")] == [1, 2, 3]

    played(tmp_path, play)


# ----- connecting again


def test_kept_messages_come_once_and_in_order_also_when_they_are_told_during_the_connect(tmp_path: Path) -> None:
    async def play(served: Served, messages: Messages) -> None:
        for _ in range(50):
            keep(messages, "event")
        stop = threading.Event()

        def tell(session: str) -> None:
            while not stop.is_set():
                keep(messages, "event", session)

        threads = [threading.Thread(target=tell, args=(s,)) for s in ("S", "S", "T")]
        for thread in threads:
            thread.start()
        try:
            sockets = []
            for after in (0, 10, 49, 3, 0, None):
                sockets.append((after, served.begin("S", after=after), served.begin(after=after)))
                await sockets[-1][1].until(lambda: len(sockets[-1][1].ids()) > 20)
        finally:
            stop.set()
            for thread in threads:
                await asyncio.to_thread(thread.join)
        last = messages.latest()
        keep(messages, "event", "S")
        for after, mine, everybody in sockets:
            await asyncio.gather(*(s.until(lambda s=s: s.ids()[-1:] == [last + 1]) for s in (mine, everybody)))  # type: ignore[misc]
            for socket, session in ((mine, "S"), (everybody, None)):
                begin = socket.told("hello")[0]["after"] if after is None else after
                assert socket.ids() == [m.id for m in messages.after(begin, session, 1 << 20)]

    played(tmp_path, play)


def test_a_client_goes_on_where_it_was_when_the_service_has_restarted(tmp_path: Path) -> None:
    messages = messages_in(tmp_path)
    seen: list[int] = []

    async def first() -> None:
        async with hub_of(messages) as served:
            socket = await served.connect(after=0)
            for _ in range(5):
                keep(messages, "job", None)
            await socket.until(lambda: len(socket.ids()) == 5)
            seen.extend(socket.ids())
        assert socket.closed is not None
        assert socket.closed[0] == 1012

    async def second() -> None:
        async with hub_of(messages) as served:
            socket = await served.connect(after=seen[-1])
            keep(messages, "revision", "T")
            await socket.until(lambda: len(socket.ids()) == 3)
            seen.extend(socket.ids())
            assert [m["kind"] for m in socket.told()] == ["hello", "case", "case", "revision"]

    asyncio.run(first())
    keep(messages, "case")
    keep(messages, "case")
    asyncio.run(second())
    assert seen == list(range(1, 9))


def test_a_number_that_was_never_given_is_another_databases(tmp_path: Path) -> None:
    async def play(served: Served, messages: Messages) -> None:
        keep(messages, "case")
        keep(messages, "case")
        socket = await served.connect(after=1000)
        keep(messages, "job")
        await socket.until(socket.ids)
        hello = socket.told("hello")[0]
        assert (hello["another_database"], hello["latest"], hello["after"], hello["asked_after"]) == (True, 2, 2, 1000)
        assert socket.ids() == [3]
        for after in (None, 0, 1, 3):
            again = await served.connect(after=after)
            assert again.told("hello")[0]["another_database"] is False

    played(tmp_path, play)


# ----- traces


def test_who_connects_sees_the_last_minutes_at_once_and_then_what_comes(tmp_path: Path) -> None:
    async def play(served: Served, messages: Messages) -> None:
        for k in range(300):
            served.hub.trace("S", posted(0.02 * k, value=9.0 if k == 17 else 1.0, dropped=4))
        served.hub.trace("T", posted(0.0))
        await served.shown(301)
        early = await served.connect("S")
        await early.until(lambda: early.told("trace"))
        past = early.told("trace")[0]["body"]
        assert (past["recent"], past["stream"], sum(past["count"])) == (True, "a", 300 * 140)
        assert max(m[0] for m in past["most"]) == 9.0
        served.hub.trace("S", posted(6.0, 3.0, dropped=4))
        await early.until(lambda: len(early.told("trace")) == 2)
        now = early.told("trace")[1]
        assert (now["session"], now["body"]["recent"], now["body"]["latest"]) == ("S", False, [[3, 6, 9, 12, 15, 18]])
        assert now["body"]["from_s"] == [6.0]
        later = await served.connect("S")
        hello = later.told("hello")[0]
        assert [(s["session"], s["stream"], s["dropped"]) for s in hello["live"]] == [("S", "a", 4)]

    played(tmp_path, play)


def test_all_that_is_due_is_one_frame_and_a_frame_is_made_once_for_all_who_want_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def play(served: Served, messages: Messages) -> None:
        same = [await served.connect("S", rate_hz=1.0) for _ in range(4)]
        # The first frame goes at once; what comes within the second after it waits for its end.
        served.hub.trace("S", posted(0.0))
        await asyncio.gather(*(s.until(lambda s=s: s.told("trace")) for s in same))  # type: ignore[misc]
        made, wakes = served.hub.counters.encoded, served.hub.counters.wakes
        for k in range(1, 40):
            served.hub.trace("S", posted(0.02 * k, value=-7.0 if k == 20 else 0.0))
            keep(messages, "event", n=k)
        assert served.hub.counters.wakes <= wakes
        await asyncio.gather(*(s.until(lambda s=s: len(s.told("event")) == 39) for s in same))  # type: ignore[misc]
        assert served.hub.counters.encoded == made + 1
        for socket in same:
            assert [m["kind"] for m in socket.frames[-1]] == ["event"] * 39 + ["trace"]
            body = socket.frames[-1][-1]["body"]
            assert (len(body["count"]), sum(body["count"])) == (1, 39 * 140)
            assert body["least"][0][0] == -7.0
        assert served.hub.counters.frames == sum(len(s.frames) for s in same)

    played(tmp_path, play)


def test_the_loop_is_woken_once_however_much_is_told(tmp_path: Path) -> None:
    async def play(served: Served, messages: Messages) -> None:
        def tell() -> None:
            for k in range(1000):
                served.hub.trace("S", posted(0.001 * k, span_s=0.001))

        before = served.hub.counters.wakes
        threads = [threading.Thread(target=tell) for _ in range(3)]
        for thread in threads:
            thread.start()
        # The loop does not run meanwhile.
        for thread in threads:
            thread.join()
        socket = await served.connect("S")
        await socket.until(lambda: socket.told("trace"))
        # One for all of them, one for the client that connected.
        assert served.hub.counters.wakes <= before + 2

    played(tmp_path, play)


def test_stored_chunks_are_shown_where_there_is_no_live_path(tmp_path: Path) -> None:
    async def play(served: Served, messages: Messages) -> None:
        socket = await served.connect("S")
        t_s = np.arange(700) / 7000.0
        chunk = Chunk(0, t_s, np.ones((700, 6)), np.zeros(700, np.int64), np.zeros(700, bool), b"", (), 0.0)
        await asyncio.to_thread(served.hub.offer_chunk, "S", "a", chunk)
        await socket.until(lambda: socket.told("trace"))
        body = socket.told("trace")[0]["body"]
        assert (len(body["count"]), sum(body["count"])) == (math.ceil(0.1 / WINDOW_S), 700)
        shown = served.hub.counters.envelopes
        served.hub.offer_chunk("S", "a", chunk)
        served.hub.trace("S", posted(0.5))
        await socket.until(lambda: len(socket.told("trace")) == 2)
        assert served.hub.counters.envelopes == shown + 1

    played(tmp_path, play)


# ----- slow clients


def test_a_slow_client_holds_nobody_up_and_is_told_what_it_missed(tmp_path: Path) -> None:
    async def play(served: Served, messages: Messages) -> None:
        slow, fast = await served.connect("S"), await served.connect("S")
        slow.gate.clear()
        for k in range(3 * FRAMES_WAITING):
            served.hub.trace("S", posted(0.02 * k, value=float(k)))
            if k % 5 == 0:
                keep(messages, "event", n=k)
            await fast.until(lambda k=k: len(fast.told("trace")) == k + 1)  # type: ignore[misc]
        await fast.until(lambda: len(fast.told("event")) == 9)
        assert slow.told() == slow.told("hello")
        assert fast.told("dropped") == []
        slow.gate.set()
        served.hub.trace("S", posted(9.0, value=1e3))
        await slow.until(lambda: slow.told("trace") and slow.told("trace")[-1]["body"]["latest"][0][0] == 1e3)
        assert slow.ids() == fast.ids()
        dropped, shown = slow.told("dropped"), slow.told("trace")
        assert sum(d["count"] for d in dropped) == dropped[-1]["total"] == served.hub.counters.dropped > 0
        assert len(shown) + dropped[-1]["total"] == len(fast.told("trace"))
        # The oldest were dropped, but for the one that was on its way.
        assert [t["body"]["from_s"] for t in shown[1:]] == [t["body"]["from_s"] for t in fast.told("trace")][
            -len(shown) + 1 :
        ]

    played(tmp_path, play)


def test_a_client_too_slow_for_kept_messages_is_told_from_where_to_resume(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(clients, "MOST_KEPT", 10)

    async def play(served: Served, messages: Messages) -> None:
        slow, fast = await served.connect("S"), await served.connect("S")
        keep(messages, "event")
        await slow.until(slow.ids)
        slow.gate.clear()
        while served.hub.counters.resumes == 0:
            keep(messages, "event")
            last = messages.latest()
            await fast.until(lambda last=last: fast.ids()[-1] == last)  # type: ignore[misc]
        slow.gate.set()
        await slow.until(lambda: slow.closed)
        resume = slow.told("resume")[0]
        assert slow.closed == (TRY_AGAIN, f"too slow: connect again with after={resume['after']}")
        assert resume["after"] == slow.ids()[-1] < last
        again = await served.connect("S", after=resume["after"])
        await again.until(lambda: again.ids()[-1:] == [last])
        assert slow.ids() + again.ids() == fast.ids() == list(range(1, last + 1))

    played(tmp_path, play)


# ----- the connection


def test_a_silent_bench_is_told_from_a_dead_connection(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hub, "HEARTBEAT_S", 0.01)

    async def play(served: Served, messages: Messages) -> None:
        served.hub.trace("S", posted(0.0))
        await served.shown(1)
        keep(messages, "case")
        socket = await served.connect("S")
        await socket.until(lambda: len(socket.told("heartbeat")) >= 2)
        first, second = socket.told("heartbeat")[:2]
        assert first["latest"] == 1
        assert second["live"][0]["silent_s"] > first["live"][0]["silent_s"] > 0.0

    played(tmp_path, play)


def test_a_client_that_talks_is_hung_up_on_and_one_that_goes_is_forgotten(tmp_path: Path) -> None:
    async def play(served: Served, messages: Messages) -> None:
        talking, going = await served.connect("S"), await served.connect("S")
        talking.say("x" * 1000)
        await talking.until(lambda: talking.closed)
        assert talking.closed is not None
        assert talking.closed[0] == 1008
        going.gate.clear()
        served.hub.trace("S", posted(0.0))
        await going.blocked.wait()
        going.go()
        await served.gone()
        assert served.hub.clients == 0
        assert served.hub._groups.clients == 0

    played(tmp_path, play)


def test_more_clients_than_there_is_room_for_are_sent_away(tmp_path: Path) -> None:
    async def play(served: Served, messages: Messages) -> None:
        for _ in range(MOST_CLIENTS):
            served.begin()
        await asyncio.sleep(0)
        socket = served.begin()
        await socket.until(lambda: socket.closed)
        assert socket.closed is not None
        assert socket.closed[0] == TRY_AGAIN
        assert served.hub.counters.refused == 1

    played(tmp_path, play)


def test_a_database_that_does_not_answer_hangs_up_with_a_reason(tmp_path: Path) -> None:
    async def play(served: Served, messages: Messages) -> None:
        def broken(*_: object) -> list[Message]:
            raise OSError("disk")

        keep(messages, "case")
        messages.after = broken  # type: ignore[assignment,method-assign]
        # Who asks for what was kept before.
        socket = served.begin(after=0)
        await socket.until(lambda: socket.closed)
        assert socket.closed is not None
        assert socket.closed[0] == 1011

    played(tmp_path, play)


def test_after_the_close_nothing_is_taken_and_nothing_fails(tmp_path: Path) -> None:
    messages = messages_in(tmp_path)

    async def run() -> FakeSocket:
        async with hub_of(messages) as served:
            socket = await served.connect(after=0)
            keep(messages, "case")
        keep(messages, "case")
        served.hub.trace("S", posted(0.0))
        return socket

    # What was kept before the close is told.
    assert asyncio.run(run()).ids() == [1]
    keep(messages, "case")
