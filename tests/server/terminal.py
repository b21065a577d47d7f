"""A terminal at which somebody answers what a command asks."""

from __future__ import annotations

import io
import sys
from collections.abc import Sequence

import pytest

from server import cli


class Typed(io.StringIO):
    """Text that says that it is a terminal; where it has ended, somebody may press Ctrl-C."""

    def __init__(self, text: str = "", interrupted: bool = False) -> None:
        super().__init__(text)
        self._interrupted = interrupted

    def isatty(self) -> bool:
        return True

    def readline(self, size: int | None = -1, /) -> str:  # type: ignore[override]
        line = super().readline(-1 if size is None else size)
        if not line and self._interrupted:
            raise KeyboardInterrupt
        return line


def answering(answers: Sequence[str], *arguments: object, interrupted: bool = False) -> tuple[int, str, str]:
    """Run the command line at a terminal.

    Args:
        answers: what is typed, line by line; then the input ends.
        arguments: of the command.
        interrupted: Ctrl-C is pressed then instead.

    Returns:
        Exit code, what was shown, and what stood on standard error.
    """
    out, err = Typed(), io.StringIO()
    typed = Typed("".join(f"{answer}\n" for answer in answers), interrupted)
    with pytest.MonkeyPatch.context() as patch:
        for name, stream in (("stdin", typed), ("stdout", out), ("stderr", err)):
            patch.setattr(sys, name, stream)
        patch.setattr(sys, "argv", ["fingertwin", *map(str, arguments)])
        patch.setenv("NO_COLOR", "1")
        with pytest.raises(SystemExit) as left:
            cli.main()
    assert typed.read() == "", "not all of what was typed was asked for"
    return int(left.value.code or 0), out.getvalue(), err.getvalue()
