"""Keys and lines of text at a bench, read without ever waiting for them."""

from __future__ import annotations

import queue
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TextIO

ENTER, ESCAPE, ERASE = ("\r", "\n"), "\x1b", ("\x7f", "\b")
QUIT = "quit"
# Key, command, what the help says.
KEYS = (
    ("t", "tare", "tare"),
    ("u", "unloaded", "unloaded"),
    ("l", "loaded", "loaded"),
    ("c", "confirm", "confirm (or Enter)"),
    ("n", "next", "next"),
    ("r", "repeat", "repeat"),
    ("x", "exclude", "exclude"),
    ("i", "include", "include again"),
    ("w", "known_weight", "known weight"),
    ("p", "posture_set", "posture set"),
    ("m", "cell_moved", "cell moved"),
    ("e", "retied", "re-tied"),
    ("s", "slipped", "slipped"),
    ("h", "moistened", "moistened"),
    ("k", "note", "note"),
    ("q", QUIT, "quit"),
)
QUESTIONS = {
    "repeat": "Which case is done once more, or after all where it was skipped?",
    "exclude": "Which case is left out, and why?",
    "include": "Which case is taken in again?",
    "known_weight": "Mass in g, direction (such as palmar) and mount:",
    "note": "Note:",
    QUIT: "Close the session and see its predictions (y), or leave it open (n)?",
}
_COMMANDS = {key: command for key, command, _ in KEYS} | dict.fromkeys(ENTER, "confirm")
_MOST_TEXT = 500

Answer = Callable[[str | None], None]


@dataclass(frozen=True)
class Pressed:
    """A key pressed by the user, as a request."""

    command: str  # of a bench run, or `quit`
    argument: str = ""  # that belongs to it
    answer: Answer | None = None  # is told why it was not done, or None where it was; None where nobody waits for it


class KeyInput:
    """Turns keys into commands; some ask for a text first.

    Attributes:
        question: that is being answered, or nothing.
        typed: of the answer so far.
    """

    def __init__(self) -> None:
        self._command = ""
        self.question = self.typed = ""

    def feed(self, keys: str, closed: bool = False, answers_begin: Mapping[str, str] | None = None) -> list[Pressed]:
        """Take keys; return what they complete.

        Args:
            keys: as read.
            closed: whether the session is closed, so that quitting asks nothing.
            answers_begin: what stands already in the answer to a command's question, to be gone on with or erased.
        """
        out = []
        for key in keys:
            pressed = self._answer(key) if self._command else self._begin(key, closed, answers_begin or {})
            out += [pressed] if pressed else []
        return out

    def _begin(self, key: str, closed: bool, answers_begin: Mapping[str, str]) -> Pressed | None:
        command = _COMMANDS.get(key.lower(), "")
        if command == QUIT and closed:
            return Pressed(QUIT)
        if command in QUESTIONS:
            self._command, self.question, self.typed = command, QUESTIONS[command], answers_begin.get(command, "")
            return None
        return Pressed(command) if command else None

    def _answer(self, key: str) -> Pressed | None:
        if key in ENTER or (self._command == QUIT and key.lower() in "yn"):
            command, text = self._command, self.typed
            self._clear()
            if command != QUIT:
                return Pressed(command, text)
            return {"y": Pressed("close"), "n": Pressed(QUIT)}.get(key.lower())
        if key == ESCAPE:
            self._clear()
        elif key in ERASE:
            self.typed = self.typed[:-1]
        elif key.isprintable() and len(self.typed) < _MOST_TEXT:
            self.typed += key
        return None

    def _clear(self) -> None:
        self._command = self.question = self.typed = ""


@contextmanager
def terminal_keys() -> Iterator[Callable[[], str]]:
    """Yield what returns the keys that were pressed since it was last called; the terminal is put back at the end."""
    if sys.platform == "win32":
        import msvcrt

        def pressed() -> str:
            out = ""
            while msvcrt.kbhit():
                key = msvcrt.getwch()
                if key in ("\x00", "\xe0"):
                    # Arrows and function keys come as two.
                    msvcrt.getwch()
                    continue
                if key == "\x03":
                    raise KeyboardInterrupt
                out += key
            return out

        yield pressed
    else:
        import os
        import select
        import termios
        import tty

        number = sys.stdin.fileno()
        before = termios.tcgetattr(number)

        def waiting() -> str:
            out = b""
            while select.select([number], [], [], 0.0)[0]:
                data = os.read(number, 1024)
                if not data:
                    break
                out += data
            text = out.decode("utf-8", "ignore")
            # Arrows and function keys begin with Escape, and are more than that.
            return "" if text.startswith(ESCAPE) and len(text) > 1 else text

        try:
            # Ctrl-C still interrupts.
            tty.setcbreak(number)
            yield waiting
        finally:
            termios.tcsetattr(number, termios.TCSADRAIN, before)


def typed_lines(stream: TextIO | None = None) -> Callable[[], str | None]:
    """Return what gives the next line that came in, stripped, or None where none waits.

    A pipe cannot be asked on every system whether it has something, so a thread reads it.
    """
    lines: queue.SimpleQueue[str] = queue.SimpleQueue()
    source = stream or sys.stdin

    def read() -> None:
        for line in source:
            if line.strip():
                lines.put(line.strip())

    threading.Thread(target=read, name="lines", daemon=True).start()

    def take() -> str | None:
        try:
            return lines.get_nowait()
        except queue.Empty:
            return None

    return take
