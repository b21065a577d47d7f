"""Benches that are connected: what each waits for, and the way to ask something of it.

All of it on the event loop's thread. A command goes to the bench that is connected now, once, and is never kept: one
that is carried out late does more harm than one that has to be given twice.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from server.service.live.bodies import Answer, BenchShown
from server.service.storage.messages import Message
from server.service.web.problems import ProblemError, shortened

# A bench answers in its next turn; closing a session takes it longest.
ANSWER_S = 10.0
# Commands of one bench that wait for their answers.
_MOST_ASKED = 16


@dataclass(eq=False)
class Bench:
    """A bench's connection."""

    session: str  # that it logs
    outgoing: asyncio.Queue[dict[str, Any]] = field(default_factory=asyncio.Queue)  # commands on their way to it
    shown: BenchShown | None = None  # what it waits for; None until it has said so
    asked: dict[int, asyncio.Future[str | None]] = field(default_factory=dict)
    number: int = 0


class Benches:
    """All that are connected.

    Commands of a session go to the latest that has said what it waits for. A log without a protocol says nothing of the
    kind, and takes nothing from a bench; a bench that connects again takes over from its old connection.

    Args:
        publish: hands a message to whoever listens.
    """

    def __init__(self, publish: Callable[[Message], None]) -> None:
        self._publish = publish
        self._connected: dict[str, list[Bench]] = {}

    def connect(self, session: str) -> Bench:
        """Take a connection of what logs into a session."""
        bench = Bench(session)
        self._connected.setdefault(session, []).append(bench)
        return bench

    def _holder(self, session: str) -> Bench | None:
        """Return the bench that commands of a session go to; None where none has said what it waits for."""
        return next((b for b in reversed(self._connected.get(session, [])) if b.shown is not None), None)

    def require_free(self, session: str) -> None:
        """Make sure that nothing is logged into a session now.

        Raises:
            ProblemError: 409 a bench is connected.
        """
        if session in self._connected:
            raise ProblemError(
                409, f"session {session} is held by a bench", "a bench that has ended", "End it there (fingertwin log)"
            )

    def leave(self, bench: Bench) -> None:
        """Forget a bench that has gone, and tell those who watch it."""
        for future in bench.asked.values():
            if not future.done():
                future.cancel()
        held, here = self._holder(bench.session) is bench, self._connected[bench.session]
        here.remove(bench)
        if not here:
            del self._connected[bench.session]
        if held:
            left = self._holder(bench.session)
            self._publish(Message("bench", bench.session, _body(None if left is None else left.shown)))

    def show(self, bench: Bench, shown: BenchShown) -> None:
        """Take what a bench waits for."""
        changed, bench.shown = shown != bench.shown, shown
        if changed and self._holder(bench.session) is bench:
            self._publish(Message("bench", bench.session, _body(shown)))

    def answered(self, bench: Bench, answer: Answer) -> None:
        """Take a bench's answer to a command."""
        future = bench.asked.get(answer.number)
        if future is not None and not future.done():
            future.set_result(answer.refused)

    def shown(self, sessions: frozenset[str] | None) -> list[dict[str, Any]]:
        """Return the present requests of some sessions' benches, or of all."""
        return [
            {"kind": "bench", "session": session, "body": _body(bench.shown)}
            for session in self._connected
            if (sessions is None or session in sessions) and (bench := self._holder(session)) is not None
        ]

    async def ask(self, session: str, command: str, text: str) -> None:
        """Let a bench carry out a command.

        Raises:
            ProblemError: 409 it is not connected or refuses, 503 it does not answer.
        """
        bench = self._holder(session)
        if bench is None or bench.shown is None:
            raise ProblemError(
                409,
                f"no bench of session {shortened(session)} is connected",
                "one that runs with --protocol, --setup and --to",
                "Start it, or use the keys at the bench",
            )
        names = [key.command for key in bench.shown.keys]
        if command not in names:
            raise ProblemError(409, f"the bench takes no command {shortened(command)!r}", f"one of {' '.join(names)}")
        if len(bench.asked) >= _MOST_ASKED:
            raise ProblemError(503, "the bench does not answer", "an answer to what it was asked before", "Look there")
        bench.number += 1
        number = bench.number
        future = bench.asked[number] = asyncio.get_running_loop().create_future()
        bench.outgoing.put_nowait({"number": number, "command": command, "text": text})
        try:
            async with asyncio.timeout(ANSWER_S):
                refused = await future
        except TimeoutError:
            raise ProblemError(
                503, "the bench does not answer", f"an answer within {ANSWER_S:g} s", "Look there whether it was done"
            ) from None
        except asyncio.CancelledError:
            if future.cancelled():
                raise ProblemError(
                    503, "the bench hung up", "an answer", "Look there whether it was done; it connects again by itself"
                ) from None
            raise
        finally:
            bench.asked.pop(number, None)
        if refused is not None:
            raise ProblemError(409, refused, "", "")


def _body(shown: BenchShown | None) -> dict[str, Any]:
    return {"connected": False} if shown is None else {"connected": True} | shown.model_dump(mode="json")
