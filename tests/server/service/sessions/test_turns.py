"""What is made of a session: once, whoever asks for it meanwhile; again where that failed or is long ago."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from server.service.sessions.turns import Made


def test_whoever_asks_for_what_is_being_made_waits_for_it() -> None:
    made, count, begun = Made[int](2), [], threading.Barrier(8)

    def make() -> int:
        count.append(1)
        threading.Event().wait(0.05)
        return 7

    def ask() -> int:
        begun.wait()
        return made.of("key", make)

    with ThreadPoolExecutor(8) as threads:
        assert [f.result() for f in [threads.submit(ask) for _ in range(8)]] == [7] * 8
    assert len(count) == 1


def test_what_fails_is_made_again() -> None:
    made = Made[int](2)

    def fail() -> int:
        raise ValueError("not now")

    with pytest.raises(ValueError, match="not now"):
        made.of("key", fail)
    assert made.of("key", lambda: 3) == 3


def test_what_was_asked_for_longest_ago_is_let_go() -> None:
    made, count = Made[str](2), list[str]()

    def ask(key: str) -> str:
        def make() -> str:
            count.append(key)
            return key

        return made.of(key, make)

    for key in ("a", "b", "a", "c", "a", "b"):
        assert ask(key) == key
    assert count == ["a", "b", "c", "b"]
