"""Population work comes out the same wherever it is computed."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from itertools import count

import pytest

from daq.errors import InputError
from server.service.jobs.executors import (
    DaskExecutor,
    Executor,
    ExecutorError,
    ExecutorSettings,
    ProcessExecutor,
    SerialExecutor,
)
from tests.server.service.work import picky, square

ITEMS = [(f"n{n}", n) for n in range(20)]

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning:distributed", "ignore::ResourceWarning")


def in_threads() -> Executor:
    return DaskExecutor(workers=2, processes=False)


def in_cluster() -> Executor:
    return DaskExecutor(workers=1)


EVERY = [SerialExecutor, lambda: ProcessExecutor(2), in_threads]


@pytest.mark.parametrize("start", [*EVERY, in_cluster], ids=["serial", "processes", "dask threads", "dask processes"])
def test_every_item_comes_back_once(start: Callable[[], Executor]) -> None:
    with start() as executor:
        assert sorted(executor.map(square, ITEMS)) == sorted((key, n * n) for key, n in ITEMS)
        assert list(executor.map(square, [])) == []


@pytest.mark.parametrize("start", EVERY, ids=["serial", "processes", "dask"])
def test_bad_input_comes_back_as_it_was_said(start: Callable[[], Executor]) -> None:
    with start() as executor:
        with pytest.raises(InputError) as refused:
            list(executor.map(picky, [("three", 3)]))
        assert (refused.value.found, refused.value.expected) == ("a three", "another number")


@pytest.mark.parametrize("start", [lambda: ProcessExecutor(2), in_threads], ids=["processes", "dask"])
def test_a_fault_names_its_item_and_items_are_taken_as_they_are_needed(start: Callable[[], Executor]) -> None:
    taken, done = count(), 0

    def endless() -> Iterator[tuple[str, int]]:
        for n in taken:
            assert n <= done + 4, "more is taken than two workers need"
            yield f"n{n}", 4 if n == 4 else 1

    with start() as executor, pytest.raises(ExecutorError, match="n4: ValueError: four"):
        for done, _ in enumerate(executor.map(picky, endless()), 1):  # noqa: B007 - the generator above reads it
            pass


def test_a_worker_that_dies_is_said_and_the_others_go_on() -> None:
    with ProcessExecutor(1) as executor:
        with pytest.raises(ExecutorError, match=r"n5: the worker died \(exit code 1\)"):
            list(executor.map(picky, [("n5", 5)]))
        assert list(executor.map(picky, [("n6", 6)])) == [("n6", 6)]


def test_settings_choose_the_place(monkeypatch: pytest.MonkeyPatch) -> None:
    assert isinstance(ExecutorSettings().open(), SerialExecutor)
    with ExecutorSettings(workers=2).open() as executor:
        assert isinstance(executor, ProcessExecutor)
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match="Dask is not installed"):
        ExecutorSettings("dask").open()
