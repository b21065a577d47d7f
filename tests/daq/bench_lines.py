"""A bench before anything was done, and what it says of a line that it refuses."""

from __future__ import annotations

from typing import Any

import pytest

from daq.bench.commands import perform
from daq.bench.run import BenchRun
from daq.errors import InputError
from tests.daq.bench_plays import (
    Bench,
    Line,
    predicted,
    setup,
    tared,
)  # fmt: skip

BEGUN: list[Line] = ["next", *tared()]


def bench(**changes: Any) -> Bench:
    return Bench(BenchRun(setup(**changes), predicted, "s"))


def refused(played: Bench, line: str) -> str:
    """What a command that cannot be done says; it leaves no event."""
    command, _, argument = line.partition(" ")
    with pytest.raises(InputError) as caught:
        perform(played.run, command, argument)
    assert "\n" not in str(caught.value)
    before = len(played.said)
    played.play([])
    assert len(played.said) == before
    return str(caught.value)
