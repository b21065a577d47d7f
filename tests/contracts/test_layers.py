"""What each layer may load, and what no file of the repository may hold."""

from __future__ import annotations

import ast
import json
import pkgutil
import re
import shutil
import subprocess
import sys
from collections.abc import Iterable
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import grimp
import numpy as np
import pytest

import daq
import fingermodel
import server.service.routes
from daq.recordings.readings import ReadingBlock, write_readings

ROOT = Path(__file__).parents[2]
HARDWARE_WEB_DRAWING = ("serial", "fastapi", "uvicorn", "typer", "rich", "plotly", "matplotlib", "server")
# Assembled here, so that this file does not hold what it looks for.
MACHINES = [f"/{name}/" for name in ("work", "root", "home")]
REGISTRIES = [
    ".".join(words)
    for words in (
        ("pypi", "org"), ("files", "pythonhosted", "org"), ("registry", "npmjs", "org"), ("npmjs", "com"),
        ("conda", "anaconda", "org"), ("registry", "yarnpkg", "com"),
    )
]  # fmt: skip


@cache
def loaded_by(*modules: str) -> frozenset[str]:
    """Top-level names that are loaded once these modules are imported, each time in a fresh interpreter."""
    code = (
        "import importlib, json, sys\n"
        f"for name in {modules!r}: importlib.import_module(name)\n"
        "print(json.dumps(sorted({m.partition('.')[0] for m in sys.modules})))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120)  # noqa: S603
    return frozenset(json.loads(done.stdout))


def every_module_of(path: list[str], name: str) -> tuple[str, ...]:
    return (name, *(m.name for m in pkgutil.walk_packages(path, f"{name}.") if "_data" not in m.name))


@pytest.mark.parametrize("module", ["fingermodel", "fingermodel.model", "fingermodel.fitting.identification"])
def test_physics_loads_no_hardware_no_web_no_drawing(module: str) -> None:
    assert loaded_by(module).isdisjoint(HARDWARE_WEB_DRAWING)


def test_no_module_of_physics_loads_hardware_web_or_drawing() -> None:
    assert loaded_by(*every_module_of(fingermodel.__path__, "fingermodel")).isdisjoint(HARDWARE_WEB_DRAWING)


@pytest.mark.skipif(sys.platform != "linux", reason="only there a process can ask which cores it may use")
def test_what_tests_import_of_the_benchmarks_leaves_them_all_cores() -> None:
    code = "import os; had = os.sched_getaffinity(0); import benchmarks.recovery; print(os.sched_getaffinity(0) == had)"
    asked = [sys.executable, "-c", code]
    done = subprocess.run(asked, capture_output=True, text=True, check=True, timeout=120, cwd=ROOT)  # noqa: S603
    assert done.stdout.split() == ["True"]


def test_no_module_of_the_bench_loads_an_array_compiler_or_the_web() -> None:
    modules = every_module_of(daq.__path__, "daq")
    assert "daq.signals.corrections" in modules
    assert loaded_by(*modules).isdisjoint(
        {"jax", "jaxlib", "fingermodel", "server", "fastapi", "typer", "rich", "plotly", "matplotlib"}
    )


def test_a_recording_is_read_without_pandas_where_it_is_installed(tmp_path: Path) -> None:
    block = ReadingBlock(np.arange(3.0), np.ones((3, 6)), np.array([0, 1, 0]))
    files = [str(write_readings(tmp_path / name, [block])) for name in ("r.csv", "r.parquet")]
    code = (
        "import sys; from daq.recordings.readings import open_readings\n"
        f"for file in {files!r}: print(sum(len(b) for b in open_readings(file).blocks()), 'pandas' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120)  # noqa: S603
    assert done.stdout.split() == ["3", "False"] * 2


def test_the_command_line_starts_light() -> None:
    heavy = {"jax", "numpy", "scipy", "pyarrow", "plotly", "matplotlib", "pydantic", "yaml"}
    assert loaded_by("server.cli").isdisjoint(heavy)


def test_the_service_starts_without_what_draws_and_what_counts() -> None:
    started = every_module_of(server.service.routes.__path__, "server.service.routes")
    loaded = loaded_by("server.service.app", "server.service.services", *started)
    assert "fastapi" in loaded
    assert loaded.isdisjoint({"plotly", "matplotlib", "scipy", "distributed"})


def test_no_two_modules_import_each_other_not_even_inside_functions() -> None:
    graph = grimp.build_graph(*PACKAGES, exclude_type_checking_imports=True, cache_dir=None)
    assert len(graph.modules) > 100
    found = {name: graph.find_modules_directly_imported_by(name) for name in graph.modules}
    assert list(TopologicalSorter(found).static_order())  # raises CycleError, which names the modules


PACKAGES = ("daq", "fingermodel", "server", "fingertwin")
SLOW = {
    "fastapi", "httpx", "jax", "matplotlib", "numpy", "plotly", "pyarrow", "pydantic", "rich", "scipy", "sqlalchemy",
    "uvicorn", "yaml",
}  # fmt: skip


class Imports(ast.NodeVisitor):
    """What a module imports at its top, and what inside functions; what is for types alone is passed over."""

    def __init__(self, known: set[str]) -> None:
        self.top: set[str] = set()
        self.inside: set[str] = set()
        self._known, self._function = known, False

    def visit_FunctionDef(self, node: ast.FunctionDef | ast.AsyncFunctionDef) -> None:
        before, self._function = self._function, True
        self.generic_visit(node)
        self._function = before

    visit_AsyncFunctionDef = visit_FunctionDef

    def visit_If(self, node: ast.If) -> None:
        if not (isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"):
            self.generic_visit(node)

    def visit_Import(self, node: ast.Import) -> None:
        self._add(a.name for a in node.names)

    def visit_ImportFrom(self, node: ast.ImportFrom) -> None:
        whole = [f"{node.module}.{a.name}" for a in node.names]
        self._add(name if name in self._known else str(node.module) for name in whole)

    def _add(self, names: Iterable[str]) -> None:
        (self.inside if self._function else self.top).update(names)


def test_a_module_imports_inside_a_function_only_what_is_slow_to_load() -> None:
    files = {
        ".".join(f.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): f
        for package in PACKAGES
        for f in (ROOT / package).rglob("*.py")
    }
    found = {name: Imports(set(files)) for name in files}
    for name, file in files.items():
        found[name].visit(ast.parse(file.read_text("utf-8")))

    @cache
    def slow_of(name: str) -> frozenset[str]:
        """Slow packages that come with a module, and with the packages that hold it."""
        seen, todo, out = set(), [name], set()
        while todo:
            parts = todo.pop().split(".")
            out |= {parts[0]} & SLOW
            for module in (".".join(parts[: n + 1]) for n in range(len(parts))):
                if module in files and module not in seen:
                    seen.add(module)
                    todo += found[module].top
        return frozenset(out)

    ours = {(a, b) for a in files for b in found[a].inside if b.partition(".")[0] in PACKAGES}
    assert len(ours) > 20
    # A finger with fixed fractions does without the network (tests/fingermodel/hood/test_hood_network.py).
    ours.remove(("fingermodel.extensor", "fingermodel.hood.sharing"))
    # An interrupt is handled before the command line is loaded.
    ours.remove(("server.__main__", "server.cli"))
    assert [f"{a} imports {b}" for a, b in sorted(ours) if slow_of(b) <= slow_of(a)] == []


@cache
def texts() -> dict[str, str]:
    """Every text file of the repository by its path: those git tracks or would track."""
    git = shutil.which("git")
    if git is None or not (ROOT / ".git").exists():
        pytest.skip("git: needed to list the repository's files")
    listed = subprocess.run(  # noqa: S603
        [git, "-C", str(ROOT), "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    out = {}
    for name in filter(None, listed.split("\0")):
        data = (ROOT / name).read_bytes() if (ROOT / name).is_file() else b""
        if b"\0" not in data[:8192]:
            out[name] = data.decode("utf-8", errors="replace")
    return out


def holding(words: list[str], before: str) -> list[str]:
    pattern = re.compile(before + "(?:" + "|".join(map(re.escape, words)) + ")")
    return [
        f"{name}:{text.count(chr(10), 0, found.start()) + 1}: {found.group()}"
        for name, text in texts().items()
        for found in pattern.finditer(text)
    ]


def test_no_file_holds_a_path_of_a_machine() -> None:
    # A word before the slash makes it part of another path or address, such as .../home/.
    assert holding(MACHINES, r"(?<![\w.~$}<>/-])") == []


def test_no_file_holds_the_address_of_a_package_registry() -> None:
    assert holding(REGISTRIES, "") == []
