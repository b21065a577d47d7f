"""What waits for a client, and in what order: laws that hold whatever the order of things."""

from __future__ import annotations

import json
import random
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from server.service.live import clients
from server.service.live.clients import Client, Frame, Kept, Subscription
from server.service.live.order import InOrder
from server.service.messages import Message


def told(number: int) -> Message:
    return Message("event", "S", {}, number)


@given(st.integers(1, 30), st.randoms(use_true_random=False), st.sets(st.integers(1, 30)))
def test_messages_come_out_in_order_whatever_order_they_are_told_in(
    count: int, chance: random.Random, never: set[int]
) -> None:
    kept = [n for n in range(1, count + 1) if n not in never]
    arriving = list(kept)
    chance.shuffle(arriving)
    order, out = InOrder(0), []
    for i, number in enumerate(arriving):
        order.offer(told(number))
        order.offer(told(number))
        out += [m.id for m in order.ready()]
        if chance.random() < 0.2:
            # All below one that was told are stored by then.
            out += [m.id for m in order.fill([told(n) for n in kept if n <= max(arriving[: i + 1])])]
    out += [m.id for m in order.fill([told(n) for n in kept if n > order.last])]
    for number in kept:
        order.offer(told(number))
    assert out == kept
    assert not order.gap


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
