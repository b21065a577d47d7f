"""Which of the connections of one session is its bench."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from server.service.live.benches import Bench, Benches
from server.service.live.bodies import Answer, BenchKey, BenchShown
from server.service.storage.messages import Message
from server.service.web.problems import ProblemError

NEXT = BenchKey(command="next", key="n", title="Next")


@pytest.fixture
def told() -> list[Any]:
    return []


@pytest.fixture
def benches(told: list[Any]) -> Benches:
    def publish(message: Message) -> None:
        told.append(message.body.get("todo", message.body["connected"]))

    return Benches(publish)


def shown(todo: str) -> BenchShown:
    return BenchShown(step="c001", todo=todo, phase="idle", reason="", suggested="", closed=False, keys=(NEXT,))


async def answering(benches: Benches, bench: Bench) -> None:
    """Ask the session's bench for its key; this one carries it out."""
    asked = asyncio.create_task(benches.ask("A", "next", ""))
    async with asyncio.timeout(5.0):
        command = await bench.outgoing.get()
        benches.answered(bench, Answer(number=command["number"]))
        await asked


def test_a_log_without_a_protocol_takes_nothing_from_a_bench(benches: Benches, told: list[Any]) -> None:
    bench = benches.connect("A")
    benches.show(bench, shown("hang FDP"))
    log = benches.connect("A")
    benches.show(bench, shown("take it off"))
    asyncio.run(answering(benches, bench))
    benches.leave(log)
    assert [b["body"]["todo"] for b in benches.shown(None)] == ["take it off"]
    assert told == ["hang FDP", "take it off"]
    benches.leave(bench)
    assert told[2:] == [False]
    assert benches.shown(None) == []


def test_a_bench_that_connects_again_takes_over_from_its_old_connection(benches: Benches, told: list[Any]) -> None:
    old = benches.connect("A")
    benches.show(old, shown("hang FDP"))
    new = benches.connect("A")
    benches.show(new, shown("hang FDS"))
    benches.show(old, shown("of long ago"))
    asyncio.run(answering(benches, new))
    benches.leave(old)
    assert [b["body"]["todo"] for b in benches.shown(frozenset({"A"}))] == ["hang FDS"]
    assert told == ["hang FDP", "hang FDS"]


def test_where_a_bench_goes_before_the_other_the_other_is_shown(benches: Benches, told: list[Any]) -> None:
    first, second = benches.connect("A"), benches.connect("A")
    benches.show(first, shown("hang FDP"))
    benches.show(second, shown("hang FDS"))
    benches.leave(second)
    assert told[-1] == "hang FDP"
    asyncio.run(answering(benches, first))


def test_a_session_is_free_once_nothing_is_logged_into_it(benches: Benches) -> None:
    log = benches.connect("A")
    with pytest.raises(ProblemError) as caught:
        benches.require_free("A")
    assert caught.value.status == 409
    with pytest.raises(ProblemError, match="no bench of session A is connected"):
        asyncio.run(benches.ask("A", "next", ""))
    benches.leave(log)
    benches.require_free("A")
    benches.require_free("B")
