"""A bench that is watched and asked from elsewhere: the pages of the service show its keys beside those of its own."""

from __future__ import annotations

import queue
from collections.abc import Callable, Sequence
from typing import Any

from daq.bench.run import BenchRun
from daq.bench.status import BenchStatus
from daq.journal.rows import Event
from daq.uplink.live_tail import LiveTail
from daq.uplink.live_wire import Command
from server.bench.keys import KEYS, QUESTIONS, QUIT, Pressed
from server.bench.loop import View

Asked = Callable[[], list[Pressed]]

_MOST_TEXT = 500
# Elsewhere the two ways to end are two keys.
_ENDS = (("close", "close the session and see its predictions"), (QUIT, "stop, and leave the session open"))

_SHOWN_KEYS: list[dict[str, str | None]] = [
    *(
        {"command": command, "key": key, "title": title, "asks": QUESTIONS.get(command)}
        for key, command, title in KEYS
        if command != QUIT
    ),
    *({"command": command, "key": "", "title": title, "asks": None} for command, title in _ENDS),
]


class Remote:
    """Shows a bench through its live path, and takes commands from there.

    Args:
        tail: of the bench; not started yet.
        run: that is shown.
    """

    def __init__(self, tail: LiveTail, run: BenchRun) -> None:
        self._tail, self._run = tail, run
        self._asked: queue.SimpleQueue[Command] = queue.SimpleQueue()
        tail.asked = self._asked.put

    def pressed(self) -> list[Pressed]:
        """Return what was asked for elsewhere since it was last called."""
        out: list[Pressed] = []
        while True:
            try:
                asked = self._asked.get_nowait()
            except queue.Empty:
                return out
            out.append(Pressed(asked.command, asked.text, self._answering(asked.number)))

    def show(self) -> None:
        """Show how things stand."""
        self._tail.show(shown(self._run.status()))

    def _answering(self, number: int) -> Callable[[str | None], None]:
        def answer(refused: str | None) -> None:
            # What has changed is told with the answer, not after it.
            self.show()
            self._tail.answer(number, refused)

        return answer


class Watched:
    """A view that is shown elsewhere too.

    Args:
        view: here.
        remote: elsewhere.
    """

    def __init__(self, view: View, remote: Remote) -> None:
        self._view, self._remote = view, remote

    def tell(self, events: Sequence[Event]) -> None:
        """Take what the run did."""
        self._view.tell(events)

    def refuse(self, error: Exception) -> None:
        """Take why something was not done."""
        self._view.refuse(error)

    def draw(self, space_left: int | None = None) -> None:
        """Show how things stand."""
        self._view.draw(space_left)
        self._remote.show()


def joined(remote: Remote | None, view: View, pressed: Asked) -> tuple[View, Asked]:
    """Return a view and what gives commands, with those elsewhere where there are any."""
    if remote is None:
        return view, pressed
    return Watched(view, remote), lambda: pressed() + remote.pressed()


def shown(status: BenchStatus) -> dict[str, Any]:
    """Return the state of a bench for other viewers, without forces and values that change with every reading."""
    texts = {"step": status.step, "todo": status.todo, "reason": status.reason}
    return {k: v[:_MOST_TEXT] for k, v in texts.items()} | {
        "phase": status.phase,
        "suggested": status.suggests,
        "closed": status.closed,
        # Nothing is taken in again before anything is left out.
        "keys": [
            key | {"begins": status.answers_begin.get(str(key["command"]), "")}
            for key in _SHOWN_KEYS
            if key["command"] != "include" or "include" in status.answers_begin
        ],
    }
