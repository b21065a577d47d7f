"""Shared by all tests: which absent program skips a test, and which absence is a failure."""

from __future__ import annotations

import os
import signal
import sys

import pytest

import server  # noqa: F401 - settles the number of threads before anything numerical loads
from tests.settings import load_profile

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
