"""Shared by all tests: which absent program skips a test, and which absence is a failure."""

from __future__ import annotations

import os
import shutil
import signal
import zlib
from pathlib import Path

import pytest

import server  # noqa: F401 - settles the number of threads before anything numerical loads
from tests.progress import Progress
from tests.settings import load_profile

TESTS = Path(__file__).parent
QUICK = TESTS / "daq"
# They take a worker some minutes each.
LONGEST = (
    "recovery/test_rough_benches.py",
    "recovery/test_diagnosis.py",
    "server/test_diagnosis_cli.py",
    "recovery/test_session_faults.py",
    "recovery/test_simulator.py",
    "browser/test_bench_page.py",
    "server/test_shared_law_cli.py",
    "browser/test_pages.py",
)
# Most programs run once or twice: by these, which the product has for its largest, they compile in two thirds of the
# time. A run with the tests marked `full` leaves them out.
HURRIED = "--xla_cpu_use_fusion_emitters=false --xla_backend_optimization_level=1 "
# Of compiled programs of earlier runs; a run leaves 26 MB.
CACHE_BYTES = 500_000_000

load_profile()
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    # As of what a shell starts in the background: processes of tests would be deaf to Ctrl-C.
    signal.signal(signal.SIGINT, signal.default_int_handler)
# How wide a terminal is that nobody has: workers of pytest-xdist are told a width, and everything printed would wrap.
os.environ.pop("COLUMNS", None)
# Most services of tests do no jobs; compiling for them would take the machine from those that do.
os.environ.setdefault("FINGERTWIN_WARM_WORKERS", "false")
# A run starts many processes: each would compile all of our modules, and workers rewrite all tests.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
# Small programs are many: each is compiled once for all workers and subprocesses, too.
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES", "0")


def pytest_configure(config: pytest.Config) -> None:
    # Workers have it from the process that started them.
    if config.getoption("markexpr") == "not full" and HURRIED not in os.environ["XLA_FLAGS"]:
        os.environ["XLA_FLAGS"] = HURRIED + os.environ["XLA_FLAGS"]
    _compiled_once(config)
    # Only the process that started the workers of pytest-xdist has where to write.
    if config.getoption("numprocesses", None) and not hasattr(config, "workerinput"):
        config.pluginmanager.register(Progress(), "progress")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the longest files and end with what is quick, so that no worker is left alone with a long file."""
    places = {TESTS / name: place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: (places.get(item.path, len(places)), item.path.is_relative_to(QUICK)))


def _compiled_once(config: pytest.Config) -> None:
    """Share one cache among workers, subprocesses and runs: a program is found by all that it follows from."""
    if "JAX_COMPILATION_CACHE_DIR" in os.environ:
        return
    folder = config.cache.mkdir("compiled")
    if sum(file.stat().st_size for file in folder.rglob("*")) > CACHE_BYTES:
        shutil.rmtree(folder)
    for file in folder.glob("*-cache"):
        # JAX writes them in place: a process that was killed may have left half of one.
        try:
            zlib.decompress(file.read_bytes())
        except zlib.error:
            file.unlink()
    os.environ["JAX_COMPILATION_CACHE_DIR"] = str(folder)
