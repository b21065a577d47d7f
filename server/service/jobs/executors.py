"""One way to do population work, wherever it is computed: in this process, in others, or on a Dask cluster.

What comes out does not depend on where it was computed, as long as the function depends on its item alone: whatever
it draws is to be seeded from the item's key, never from the order.
"""

from __future__ import annotations

import importlib
import queue
import uuid
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import islice
from types import TracebackType
from typing import Any, Literal, Self, TypeVar

from daq.errors import InputError
from server.service.jobs.orders import Order, Outcome
from server.service.jobs.supervisor import Supervisor
from server.service.jobs.worker import Tell

Item = TypeVar("Item")
Result = TypeVar("Result")
# Items and results with their keys.
Keyed = Iterable[tuple[str, Item]]
Results = Iterator[tuple[str, Result]]

_ONE = "server.service.jobs.executors.compute_one"
# Items on their way to each worker: the next one is there when one is done.
_AHEAD = 2
# Of a cluster on this machine: nobody else is to reach it.
_LOOPBACK = {
    "protocol": "tcp://",
    "host": "127.0.0.1",
    "dashboard_address": "127.0.0.1:0",
    "worker_dashboard_address": "127.0.0.1:0",
}
# A scheduler that does not answer by then is not there.
_ANSWER_S = 30.0


class ExecutorError(Exception):
    """An item could not be computed, for another reason than bad input."""


@dataclass(frozen=True)
class ExecutorSettings:
    """Place of computation of population work."""

    kind: Literal["processes", "dask"] = "processes"  # processes on this machine, or a Dask cluster
    workers: int = 1  # processes on this machine; with one or none, all is computed in the calling process
    scheduler: str | None = None  # address of a Dask cluster's scheduler; None starts a cluster on this machine

    def open(self) -> Executor:
        """Start the executor."""
        if self.kind == "dask":
            return DaskExecutor(self.scheduler, self.workers)
        return ProcessExecutor(self.workers) if self.workers > 1 else SerialExecutor()


class Executor(ABC):
    """Computes many items; as a context manager it is closed at the end."""

    @abstractmethod
    def map(self, function: Callable[[Item], Result], items: Keyed[Item]) -> Results[Result]:
        """Yield the key and the result of each item, as they come.

        Args:
            function: at the top of a module, so that it can be found elsewhere.
            items: key, which no other has, and item; taken as they are needed.

        Raises:
            InputError: the function did.
            ExecutorError: the function raised something else, or a worker died.
        """

    @abstractmethod
    def close(self) -> None:
        """Stop what is still computed."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class SerialExecutor(Executor):
    """Computes one item after another in this process."""

    def map(self, function: Callable[[Item], Result], items: Keyed[Item]) -> Results[Result]:
        """Yield the results in the order of the items."""
        for key, item in items:
            yield key, function(item)

    def close(self) -> None:
        """Stop nothing: there is nothing to stop."""


class ProcessExecutor(Executor):
    """Computes in worker processes on this machine, which end with it.

    Args:
        workers: processes.
    """

    def __init__(self, workers: int) -> None:
        self._workers = workers
        self._supervisor = Supervisor(workers)

    def map(self, function: Callable[[Item], Result], items: Keyed[Item]) -> Results[Result]:
        """Yield the results in order of completion."""
        ends: queue.SimpleQueue[tuple[str, Outcome]] = queue.SimpleQueue()
        waiting, running = iter(items), dict[str, str]()
        try:
            while True:
                for key, item in islice(waiting, self._workers * _AHEAD - len(running)):
                    order = Order(uuid.uuid4().hex, _ONE, _Watcher(key, (function, item), ends))
                    running[key] = order.id
                    self._supervisor.submit(order)
                if not running:
                    return
                key, outcome = ends.get()
                del running[key]
                yield key, _result_of(key, outcome)
        finally:
            for name in running.values():
                self._supervisor.cancel(name)

    def close(self) -> None:
        """End the processes."""
        self._supervisor.close()


class DaskExecutor(Executor):
    """Computes on a Dask cluster whose workers have this software installed in the same version.

    Args:
        scheduler: its address; None starts a cluster of processes on this machine.
        workers: processes of that cluster.
        processes: False has it compute in threads of this process, for tests.
    """

    def __init__(self, scheduler: str | None = None, workers: int = 1, *, processes: bool = True) -> None:
        self._distributed = _distributed()
        self._cluster: Any = None
        if scheduler is None:
            self._cluster = self._distributed.LocalCluster(
                n_workers=max(workers, 1), threads_per_worker=1, processes=processes, **_LOOPBACK
            )
        try:
            self._client = self._distributed.Client(self._cluster or scheduler, set_as_default=False, timeout=_ANSWER_S)
        except (OSError, ValueError) as error:
            raise InputError(
                f"no Dask scheduler answers at {scheduler}", "the address of one, such as tcp://HOST:8786"
            ) from error

    def map(self, function: Callable[[Item], Result], items: Keyed[Item]) -> Results[Result]:
        """Yield the results in order of completion."""
        waiting, running = iter(items), dict[str, str]()
        done = self._distributed.as_completed(loop=self._client.loop)

        def send() -> None:
            ahead = max(sum(self._client.nthreads().values()), 1) * _AHEAD
            for key, item in islice(waiting, max(ahead - len(running), 0)):
                future = self._client.submit(_attempt, function, item, key=f"{key}-{uuid.uuid4().hex}", pure=False)
                running[future.key] = key
                done.add(future)

        send()
        try:
            while running:
                future = next(done)
                key = running.pop(future.key)
                try:
                    outcome = future.result()
                except Exception as error:
                    outcome = Outcome.of_error(error)
                result = _result_of(key, outcome)
                send()
                yield key, result
        finally:
            self._client.cancel(list(done.futures), force=True)

    def close(self) -> None:
        """Leave the cluster; one that was started here ends."""
        self._client.close()
        if self._cluster is not None:
            self._cluster.close()


def compute_one(payload: tuple[Callable[[Any], Any], Any], _: Tell) -> Any:
    """Compute one item in a worker process."""
    function, item = payload
    return function(item)


def _distributed() -> Any:
    try:
        return importlib.import_module("distributed")
    except ImportError as error:
        raise InputError(
            "Dask is not installed", "its package `distributed`", "pip install 'fingertwin[dask]'"
        ) from error


def _attempt(function: Callable[[Any], Any], item: Any) -> Outcome:
    """Compute one item on a cluster; bad input comes back in parts, which a pickled exception would lose."""
    try:
        return Outcome("done", function(item))
    except Exception as error:
        return Outcome.of_error(error)


def _result_of(key: str, outcome: Outcome) -> Any:
    if outcome.ending == "refused":
        raise InputError(outcome.found, outcome.expected, outcome.remedy)
    if outcome.ending != "done":
        raise ExecutorError(f"{key}: {outcome.found or outcome.ending}")
    return outcome.result


class _Watcher:
    """Hands the end of one item to whoever waits for it."""

    def __init__(self, key: str, payload: Any, ends: queue.SimpleQueue[tuple[str, Outcome]]) -> None:
        self._key, self._payload, self._ends = key, payload, ends

    def started(self) -> tuple[Any, Mapping[str, Any]]:
        return self._payload, {}

    def progressed(self, fraction: float, stage: str) -> None:
        pass

    def part(self, key: str, result: Any) -> None:
        pass

    def ended(self, outcome: Outcome) -> None:
        self._ends.put((self._key, outcome))
