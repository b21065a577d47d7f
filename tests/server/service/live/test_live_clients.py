"""What waits for a client, and in what order: laws that hold whatever the order of things."""

from __future__ import annotations

import asyncio
import json
from typing import Any

import pytest
import websockets.frames
from hypothesis import given
from hypothesis import strategies as st
from websockets.client import ClientProtocol
from websockets.protocol import State
from websockets.uri import parse_uri

from server.service.live import clients
from server.service.live.clients import Client, Frame, Kept, Subscription


@given(st.lists(st.tuples(st.integers(0, 4), st.integers(0, 3)), max_size=80))
def test_a_client_gets_every_kept_message_or_is_told_to_resume(steps: list[tuple[int, int]]) -> None:
    client, number, got = Client(Subscription(), 0), 0, list[dict[str, Any]]()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(clients, "MOST_KEPT", 12)
        for kept, takes in steps:
            numbers = range(number + 1, number + kept + 1)
            client.push(Frame(tuple(Kept(n, None, b'{"id":%d}' % n) for n in numbers), (b'{"t":1}',), 1))
            number += kept
            for _ in range(takes):
                got += json.loads(client.take() or "[]")
    while (text := client.take()) is not None:
        got += json.loads(text)
    ids, traces = [m["id"] for m in got if "id" in m], sum("t" in m for m in got)
    assert ids == list(range(1, len(ids) + 1))
    if client.closing is None:
        assert len(ids) == number
        assert traces + client.dropped == len(steps)
        assert sum(m["count"] for m in got if m.get("kind") == "dropped") == client.dropped
    else:
        assert got[-1] == {"kind": "resume", "after": len(ids)}


@given(st.lists(st.sampled_from(["push", "turn", "block", "free"]), max_size=60))
def test_what_is_written_at_once_overtakes_nothing_that_waits(steps: list[str]) -> None:
    got: list[int] = []
    free = True

    def take(text: str) -> None:
        got.extend(m["id"] for m in json.loads(text))

    def write(frame: Frame) -> bool:
        if free:
            take(frame.text)
        return free

    async def tell(client: Client) -> None:
        while True:
            while (text := client.take()) is not None:
                while not free:
                    await asyncio.sleep(0)
                take(text)
            await client.wait()

    async def play() -> None:
        nonlocal free
        client, number = Client(Subscription(), 0, write), 0
        telling = asyncio.create_task(tell(client))
        for step in steps:
            free = {"block": False, "free": True}.get(step, free)
            if step == "push":
                number += 1
                assert client.push(Frame((Kept(number, None, b'{"id":%d}' % number),)))
            if step == "turn":
                await asyncio.sleep(0)
        free = True
        while len(got) < number:
            await asyncio.sleep(0)
        assert client.after == number
        telling.cancel()

    asyncio.run(asyncio.wait_for(play(), 20.0))
    assert got == list(range(1, len(got) + 1))


def test_a_frame_goes_over_the_wire_as_a_client_reads_it() -> None:
    text = '{"a":"' + "\N{GREEK SMALL LETTER MU}" * 40_000 + '"}'
    parser = ClientProtocol(parse_uri("ws://x/"), state=State.OPEN)
    parser.receive_data(Frame(passing=(text.encode(),)).wire)
    (event,) = parser.events_received()
    assert isinstance(event, websockets.frames.Frame)
    assert bytes(event.data).decode() == f"[{text}]"
