"""Questions of a command at a terminal; a wrong answer is explained and asked again; nothing typed is lost."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TypeVar

from rich.markup import escape
from rich.prompt import Prompt

from daq.errors import InputError
from daq.lab.drafts import posture_of
from fingermodel.fingers.files import finger_names, read_finger
from fingermodel.fingers.finger import Finger
from server.commands.console import say
from server.commands.entries import once

T = TypeVar("T")


def ask(question: str, read: Callable[[str], T], default: str | None = None) -> T:
    """Ask until the answer can be read.

    Args:
        question: in words.
        read: makes something of the answer; its InputError is said, and the question put again.
        default: what an empty answer stands for; without one there has to be an answer.

    Raises:
        EOFError: the input has ended.
    """
    while True:
        text = Prompt.ask(escape(question), default=default or "", show_default=bool(default)).strip()
        try:
            if not text and default is None:
                raise InputError("no answer", "one: it cannot be left out")
            return read(text)
        except InputError as error:
            say(f"  {error}")


def number(text: str) -> float:
    """Read a number with point or comma.

    Raises:
        InputError: it is none.
    """
    try:
        found = float(text.replace(",", "."))
    except ValueError:
        found = math.nan
    if not math.isfinite(found):
        raise InputError(f"{text!r}", "a number, such as 0.85")
    return found


def lines(example: str, read: Callable[[str, bool], object]) -> str:
    """Ask for lines until an empty one; each has to be understood together with those before it.

    Args:
        example: of a line, with what else there is to know.
        read: makes something of all lines so far, and is told whether they are all; its InputError is said, and the
            last line asked for again.

    Returns:
        The lines.

    Raises:
        EOFError: the input has ended.
    """
    say(f"{example}; an empty line ends")
    taken: list[str] = []
    while True:
        line = input("  ").strip()
        tried = [*taken, line] if line else taken
        try:
            read("\n".join(tried), not line)
        except InputError as error:
            say(f"  {error}")
            continue
        if not line:
            return "\n".join(taken)
        taken = tried


def ask_finger() -> str:
    """Ask for a finger, by its file or name, until it can be read.

    Raises:
        EOFError: the input has ended.
    """

    def readable(text: str) -> str:
        read_finger(text)
        return text

    return ask(f"Finger: a file, or one of {', '.join(finger_names())}", readable, "an1979_middle")


def postures_of(texts: Sequence[str], finger: Finger) -> dict[str, dict[str, float]]:
    """Read postures such as `hook: MCP 0 PIP 65 DIP 50` [deg], whose angles have to be those of a finger's joints.

    Raises:
        InputError: one cannot be read or comes twice, or a session or the finger can have no such angles.
    """
    from fingermodel.comparison.observations import posture_rad

    found = once(map(posture_of, texts), "--posture")
    for name, angles in found.items():
        posture_rad(finger.topology, angles, f"posture {name}")
    return found


def ask_postures(names: Sequence[str], finger: Finger) -> dict[str, dict[str, float]]:
    """Ask for the angles of postures [deg], which have to be those of a finger's joints.

    Raises:
        EOFError: the input has ended.
    """

    def read(name: str) -> Callable[[str], dict[str, float]]:
        return lambda text: postures_of([f"{name}: {text}"], finger)[name]

    example = " ".join(
        f"{joint} {angle}" for joint, angle in zip(finger.topology.rotations, (0, 0, 65, 50), strict=False)
    )
    return {name: ask(f"Angles of {name} [deg], such as {example}", read(name)) for name in names}
