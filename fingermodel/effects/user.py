"""Effects of the user: from a file of formulas (.yaml) or a Python file (.py), held to the catalogue's contract.

A file of formulas is data: it is parsed, never run. A Python file is a program: loading it runs it, with all that the
user may do. It is taken only from a path that the user gives, never from inside another file.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from daq.documents import read_document
from daq.errors import ModelError
from daq.locations import data_dir
from fingermodel.effects.catalogue import EFFECTS
from fingermodel.effects.contract import class_faults, contract_faults, flat_faults
from fingermodel.effects.formula import REMEDY, WANTED, formula_document, formula_effect
from fingermodel.effects.formula_effect import FormulaEffect
from fingermodel.effects.formula_tree import near
from fingermodel.effects.python_effect import PYTHON_FORMAT, python_document, python_effect
from fingermodel.fingers import Topology
from fingermodel.fingers.files import read_finger
from fingermodel.stages import Effect, Layout
from fingermodel.structure import ANY_LAYOUT

__all__ = [
    "contract_faults",
    "effect_document",
    "effect_from_dict",
    "load_effect",
    "require_contract",
    "shipped_effects",
]
LARGEST = 65536


def shipped_effects() -> list[str]:
    """Names of the ready-made effects outside the catalogue."""
    return sorted(p.stem for p in (data_dir() / "effects").glob("*.yaml"))


def load_effect(path: str | os.PathLike[str], topology: Topology | None = None, layout: Layout = ANY_LAYOUT) -> Effect:
    """Read an effect of the user's.

    A formula is tried by itself. A Python file is run, and its effect is tried on made-up load cases of the finger.

    Args:
        path: of a .yaml, .yml or .py file, or the name of a shipped effect.
        topology: of the finger that it is for; the shipped `an1979_middle`'s by default.
        layout: of the session.

    Raises:
        ModelError: the first fault, in one line.
    """
    found = _find(Path(path))
    # Those that are shipped are tried by tests.
    shipped = found.parent == data_dir() / "effects"
    try:
        effect = _read(found, tried=shipped)
    except (OSError, RecursionError) as fault:
        raise ModelError(f"{found.name} cannot be read ({fault})", WANTED) from fault
    _require_new(effect, found.name)
    if isinstance(effect, FormulaEffect):
        if topology is not None:
            effect.check(topology)
        if not shipped:
            _require_slopes(effect, topology or read_finger("an1979_middle").topology, layout, found.name)
    else:
        require_contract(effect, topology or read_finger("an1979_middle").topology, layout, found.name)
    return effect


def _read(path: Path, *, tried: bool) -> Effect:
    if path.stat().st_size > LARGEST:
        raise ModelError(f"{path.name} is larger than {LARGEST // 1024} kB", "a short file with one effect")
    if path.suffix == ".py":
        return python_effect(path.resolve(), path.read_bytes())
    return formula_effect(read_document(path, WANTED, ModelError), path.name, tried=tried)


def _find(path: Path) -> Path:
    if path.is_file() and path.suffix in (".yaml", ".yml", ".py"):
        return path
    shipped = data_dir() / "effects" / f"{path}.yaml"
    if str(path) == path.name and shipped.is_file():
        return shipped
    if str(path) in EFFECTS:
        raise ModelError(
            f"{path} is an effect of the catalogue",
            "an effect of your own: a .yaml or .py file",
            f"Leave it out: every model holds the catalogue, and `add` lets {path} act",
        )
    if path.is_file():
        raise ModelError(f"{path.name} is no effect file", "a .yaml file of formulas or a .py file", REMEDY)
    names = shipped_effects()
    raise ModelError(
        f"no effect file {path}", f"a .yaml or .py file, or one of {', '.join(names)}", near(str(path), names)
    )


def _require_new(effect: Effect, where: str) -> None:
    """Refuse what can be seen to be wrong without a finger.

    Raises:
        ModelError: the first fault.
    """
    for fault in class_faults(effect):
        raise ModelError(f"{where}: {fault}", remedy=REMEDY)
    if effect.name in EFFECTS:
        raise ModelError(
            f"{where}: effect {effect.name} has the name of an effect of the catalogue", "another name", "Rename it"
        )


def _require_slopes(effect: FormulaEffect, topology: Topology, layout: Layout, where: str) -> None:
    """Refuse formulas that change nothing to first order at their null; on another finger they may not act at all."""
    try:
        faults = flat_faults(effect, topology, layout)
    except ModelError:
        return
    for fault in faults:
        raise ModelError(
            f"{where}: {fault}", remedy="Give one of them another null value; with the others at theirs nothing changes"
        )


def require_contract(effect: Effect, topology: Topology, layout: Layout, where: str = "") -> None:
    """Refuse an effect that breaks the contract on this finger in this session.

    Raises:
        ModelError: the first fault.
    """
    for fault in contract_faults(effect, topology, layout):
        raise ModelError(f"{where}: {fault}" if where else fault, remedy=REMEDY)


def effect_document(effect: Effect) -> dict[str, Any]:
    """Return an effect of the user's as plain data, to keep with the results it entered.

    Formulas come back from it with `effect_from_dict`. Of a Python file it holds name, fingerprint and text.

    Raises:
        ModelError: an effect that no file describes.
    """
    document = formula_document(effect) if isinstance(effect, FormulaEffect) else python_document(effect)
    if document is None:
        raise ModelError(f"effect {effect.name} comes from no file", "an effect of load_effect")
    return document


def effect_from_dict(document: Any, where: str, loaded: Sequence[Effect] = ()) -> Effect:
    """Build an effect from what `effect_document` made of it.

    Code in a document is never run: an effect from a Python file must be among those loaded from their files.

    Args:
        document: of the effect.
        where: names the file that holds it, in errors.
        loaded: effects that the user has given by their files.

    Raises:
        ModelError: the first fault, or a Python file that is needed.
    """
    if isinstance(document, dict) and document.get("format") == PYTHON_FORMAT:
        return _given(document, where, loaded)
    effect = formula_effect(document, where)
    _require_new(effect, where)
    return effect


def _given(document: dict[str, Any], where: str, loaded: Sequence[Effect]) -> Effect:
    name, sha256, file = (str(document.get(key, "")) for key in ("name", "sha256", "file"))
    for effect in loaded:
        known = python_document(effect)
        if known is not None and effect.name == name:
            if known["sha256"] == sha256:
                return effect
            raise ModelError(
                f"{where}: effect {name} was made by another version of its file than {known['file']}",
                f"the file with sha256 {sha256[:12]}…",
                "Give that version with --effect",
            )
    raise ModelError(
        f"{where}: effect {name} is Python code, which is not run from inside a file",
        f"the file itself, sha256 {sha256[:12]}…",
        f"Give it with --effect {file}" if file else "Give it with --effect",
    )
