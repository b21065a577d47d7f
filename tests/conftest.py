"""Shared by all tests: which absent program skips a test, and which absence is a failure."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path

import pytest

import server  # noqa: F401 - settles the number of threads before anything numerical loads
from tests.progress import Progress
from tests.settings import load_profile

QUICK = Path(__file__).parent / "daq"
# Most programs run once or twice: by these, which the product has for its largest, they compile in two thirds of the
# time. A run with the tests marked `full` leaves them out.
HURRIED = "--xla_cpu_use_fusion_emitters=false --xla_backend_optimization_level=1 "

load_profile()
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    # As of what a shell starts in the background: processes of tests would be deaf to Ctrl-C.
    signal.signal(signal.SIGINT, signal.default_int_handler)
# How wide a terminal is that nobody has: workers of pytest-xdist are told a width, and everything printed would wrap.
os.environ.pop("COLUMNS", None)
# Most services of tests do no jobs; compiling for them would take the machine from those that do.
os.environ.setdefault("FINGERTWIN_WARM_WORKERS", "false")
# Small programs are many: each is compiled once for all workers and subprocesses, too.
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES", "0")


def pytest_configure(config: pytest.Config) -> None:
    # Workers have it from the process that started them.
    if config.getoption("markexpr") == "not full" and HURRIED not in os.environ["XLA_FLAGS"]:
        os.environ["XLA_FLAGS"] = HURRIED + os.environ["XLA_FLAGS"]
    # Only the process that started the workers of pytest-xdist has where to write.
    if config.getoption("numprocesses", None) and not hasattr(config, "workerinput"):
        config.pluginmanager.register(Progress(), "progress")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Leave what is quick for the end, so that no worker is left alone with a long file."""
    items.sort(key=lambda item: item.path.is_relative_to(QUICK))


@pytest.fixture(autouse=True, scope="session")
def _compiled_once(tmp_path_factory: pytest.TempPathFactory) -> None:
    # One cache for all workers and subprocesses: a model is compiled once a run.
    if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        folder = tmp_path_factory.getbasetemp()
        shared = folder.parent if os.environ.get("PYTEST_XDIST_WORKER") else folder
        os.environ["JAX_COMPILATION_CACHE_DIR"] = str(shared / "compiled")
        if "jax" in sys.modules:
            # It has read its environment already, with the first test that was collected.
            sys.modules["jax"].config.update("jax_compilation_cache_dir", str(shared / "compiled"))
