"""Arguments of printed commands, as a shell takes them apart again."""

from __future__ import annotations

import shlex
import sys

import pytest

from daq.quoting import quoted


@pytest.mark.parametrize("plain", ["DEV-02", "models/H01-r1.json", "Prüfling", "http://127.0.0.1:8000"])
def test_what_no_shell_changes_stays_as_it_is(plain: str) -> None:
    assert quoted(plain) == plain


@pytest.mark.skipif(sys.platform == "win32", reason="shlex takes lines apart as other shells do")
@pytest.mark.parametrize(
    "argument",
    ["Prüf ling/s.yaml", "torque[PIP] += k * t_FDP", "it's", 'the "new" rig', "$HOME", "a\\b", "`x`", "", "!"],
)
def test_an_argument_comes_back_from_a_shell_as_it_was(argument: str) -> None:
    assert shlex.split(quoted(argument)) == [argument]


def test_a_space_is_put_in_quotes_that_every_shell_knows() -> None:
    assert quoted("Prüf ling") == '"Prüf ling"'
