"""An effect of the user from a Python file. Loading it runs the file, like any program that they start."""

from __future__ import annotations

import hashlib
import importlib.abc
import importlib.util
import os
import sys
import traceback
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

from daq.errors import ModelError
from fingermodel.stages import Effect

PYTHON_FORMAT = "fingertwin-effect-python/1"


class _Text(importlib.abc.SourceLoader):
    """Loads a module from the text that was hashed, whatever has become of the file since, and leaves no byte code."""

    def __init__(self, path: Path, text: bytes) -> None:
        self.path, self.text = path, text

    def get_filename(self, fullname: str) -> str:
        """Return where tracebacks point."""
        return str(self.path)

    def get_data(self, path: str | os.PathLike[str]) -> bytes:
        """Return the text."""
        return self.text


def sha256_of(text: bytes) -> str:
    """Fingerprint of a file."""
    return hashlib.sha256(text).hexdigest()


@cache
def python_effect(path: Path, text: bytes) -> Effect:
    """Run a file and return an instance of the one effect in it; the same instance while neither path nor text changes.

    Raises:
        ModelError: code that fails, or that defines no effect or several.
    """
    module = _run(path, text)
    kinds = {
        kind
        for name, kind in vars(module).items()
        if isinstance(kind, type)
        and issubclass(kind, Effect)
        and kind.__module__ == module.__name__
        and not name.startswith("_")
    }
    if len(kinds) != 1:
        found = ", ".join(sorted(k.__name__ for k in kinds)) or "no effect"
        raise ModelError(
            f"{path.name} defines {found}",
            "exactly one public class that derives from fingermodel.stages.Effect",
            "Begin the names of helpers with _",
        )
    kind = kinds.pop()
    try:
        return kind()
    except Exception as fault:
        raise ModelError(
            f"{path.name}: {kind.__name__}() fails ({_said(fault, path)})", "a class that is made without arguments"
        ) from fault


def _run(path: Path, text: bytes) -> ModuleType:
    name = f"_fingertwin_effect_{sha256_of(bytes(path) + text)[:16]}"
    loader = _Text(path, text)
    spec = importlib.util.spec_from_loader(name, loader, origin=str(path))
    assert spec is not None  # noqa: S101 - a loader was given
    module = importlib.util.module_from_spec(spec)
    # Dataclasses look their module up.
    sys.modules[name] = module
    try:
        loader.exec_module(module)
    except (Exception, SystemExit) as fault:
        del sys.modules[name]
        raise ModelError(
            f"{path.name} fails while it is read ({_said(fault, path)})", "a Python file that runs"
        ) from fault
    return module


def _said(fault: BaseException, path: Path) -> str:
    """`line 3: NameError: …`."""
    lines = [f.lineno for f in traceback.extract_tb(fault.__traceback__) if f.filename == str(path)]
    line = fault.lineno if isinstance(fault, SyntaxError) else lines[-1] if lines else None
    what = fault.msg if isinstance(fault, SyntaxError) else " ".join(str(fault).split())[:200]
    return f"line {line}: " * (line is not None) + f"{type(fault).__name__}: {what}"


def python_document(effect: Effect) -> dict[str, Any] | None:
    """Return the file that an effect came from, with its text to be read by people; None where it is not from one."""
    loader = getattr(sys.modules.get(type(effect).__module__), "__loader__", None)
    if not isinstance(loader, _Text):
        return None
    return {
        "format": PYTHON_FORMAT,
        "name": effect.name,
        "title": effect.title,
        "file": loader.path.name,
        "sha256": sha256_of(loader.text),
        "text": loader.text.decode("utf-8", errors="replace"),
    }
