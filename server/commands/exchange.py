"""`fingertwin export --format osim|mjcf` and `fingertwin import` of such files: fingers for other software."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from daq.errors import InputError
from daq.files import replacing
from fingermodel.exchange.reading import vector
from fingermodel.fingers.files import write_finger
from server.application.exchange import (
    ENDINGS,
    UNSOURCED,
    imported_body,
    named_finger,
    read_foreign,
    written_finger,
)
from server.application.exporting import writing
from server.commands.console import answer, say


def export_finger(source: str, file_format: str, out: Path | None, model: str | None, json: str | None) -> None:
    """Write a shipped finger, a finger file or a revision's finger for OpenSim or MuJoCo.

    Raises:
        InputError: no such finger, one that the format cannot hold, or a file that cannot be written.
    """
    if model is not None:
        raise InputError(f"--model {model} with --format {file_format}", "the finger alone", "Give it as the source")
    if out is not None and out.suffix.lower() not in ENDINGS[file_format]:
        raise InputError(
            f"--format {file_format} and {out.name}",
            f"a name that ends in {' or '.join(ENDINGS[file_format])}",
            "Let name and format agree",
        )
    finger, name, notes = named_finger(source)
    written = written_finger(finger, name, file_format)
    path = out or Path(f"{name}{ENDINGS[file_format][0]}")
    with writing(path), replacing(path) as temporary:
        temporary.write_text(written.text, encoding="utf-8")
    notes += written.notes
    body: dict[str, Any] = {"source": source, "file": str(path), "rows": None, "notes": list(notes)}
    if not answer("export", body, json):
        for note in notes:
            say(f"{note}.")
        say(str(path))


def import_finger(source: Path, load_point: str | None, out: Path | None, json: str | None) -> None:
    """Make a finger file of an OpenSim or MJCF finger chain.

    Raises:
        InputError: no such file, no chain that a finger file can hold, or a finger file that is there already.
    """
    target = out or Path(f"{source.stem}.yaml")
    if target.suffix.lower() not in (".yaml", ".yml"):
        raise InputError(f"--out {target.name}", "a name that ends in .yaml", "A finger file is YAML")
    if target.exists():
        raise InputError(f"{target} exists", "a new file", "Choose another --out")
    imported = read_foreign(source, None if load_point is None else vector(load_point, 3, "--load-point"))
    with writing(target):
        write_finger(imported.document, target, f"Made of {source.name}. {UNSOURCED}")
    body: dict[str, Any] = {"source": str(source), "finger": str(target)} | imported_body(imported)
    if not answer("import", body, json):
        say(f"  read: {imported.read}")
        if check := imported.check:
            said = ", ".join(f"{name} {error:.2g}" for name, error in check.worst_mm.items())
            say(f"  worst moment-arm error against {check.engine} over {check.postures} postures [mm]: {said}")
        for note in imported.notes:
            say(f"  {note}")
        say(f"  angles: {', '.join(body['rotations'])}; the clamp carries {', '.join(body['reactions'])}")
        say(f"{source.name}: {target}")
