"""`fingertwin export --format osim|mjcf` and `fingertwin import` of such files: fingers for other software."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from daq.errors import InputError
from server.console import answer, say
from server.exporting import writing

if TYPE_CHECKING:
    from fingermodel.fingers import Finger

# Endings that each format may have, the first one by default.
ENDINGS = {"osim": (".osim",), "mjcf": (".xml", ".mjcf")}
READABLE = (".osim", ".xml", ".mjcf")


def export_finger(source: str, file_format: str, out: Path | None, model: str | None, json: str | None) -> None:
    """Write a shipped finger, a finger file or a revision's finger for OpenSim or MuJoCo.

    Raises:
        InputError: no such finger, one that the format cannot hold, or a file that cannot be written.
    """
    from importlib.metadata import version

    from fingermodel.exchange.mjcf import write_mjcf
    from fingermodel.exchange.osim import write_osim

    if model is not None:
        raise InputError(f"--model {model} with --format {file_format}", "the finger alone", "Give it as the source")
    if out is not None and out.suffix.lower() not in ENDINGS[file_format]:
        raise InputError(
            f"--format {file_format} and {out.name}",
            f"a name that ends in {' or '.join(ENDINGS[file_format])}",
            "Let name and format agree",
        )
    finger, name, notes = _finger(source)
    made = f"{finger.title} ({name}), written by fingertwin {version('fingertwin')}"
    written = write_osim(finger, made) if file_format == "osim" else write_mjcf(finger, made)
    path = out or Path(f"{name}{ENDINGS[file_format][0]}")
    with writing(path):
        _write(path, written.text)
    notes += written.notes
    body: dict[str, Any] = {"source": source, "file": str(path), "rows": None, "notes": list(notes)}
    if not answer("export", body, json):
        for note in notes:
            say(f"{note}.")
        say(str(path))


def _finger(source: str) -> tuple[Finger, str, tuple[str, ...]]:
    """The finger, the name of what holds it, and what of that is not the finger's."""
    from fingermodel.finger_files import read_finger
    from fingermodel.model_files import read_revision

    path = Path(source)
    if path.suffix != ".json":
        finger = read_finger(source)
        return finger, finger.id, ()
    if not path.is_file():
        raise InputError(f"no model file {source}", "a revision written by `fingertwin refit --out`")
    revision = read_revision(path)
    held = [str(effect["name"]) for effect in revision.document.get("effects") or []]
    note = f"The file holds the fitted finger without the revision's effects: {', '.join(held)}"
    return revision.finger, revision.id, (note,) if held else ()


def _write(path: Path, text: str) -> None:
    from daq.files import replacing

    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def import_finger(source: Path, load_point: str | None, out: Path | None, json: str | None) -> None:
    """Make a finger file of an OpenSim or MJCF finger chain.

    Raises:
        InputError: no such file, no chain that a finger file can hold, or a finger file that is there already.
    """
    from daq.export import sha256_of
    from fingermodel.exchange.read_mjcf import read_mjcf
    from fingermodel.exchange.read_osim import read_osim
    from fingermodel.exchange.reading import vector
    from fingermodel.finger_files import write_finger

    target = out or Path(f"{source.stem}.yaml")
    if target.suffix.lower() not in (".yaml", ".yml"):
        raise InputError(f"--out {target.name}", "a name that ends in .yaml", "A finger file is YAML")
    if target.exists():
        raise InputError(f"{target} exists", "a new file", "Choose another --out")
    point = None if load_point is None else vector(load_point, 3, "--load-point")
    cite = f"{source.name}" + (f", SHA-256 {sha256_of(source)}" if source.is_file() else "")
    read = read_osim if source.suffix.lower() == ".osim" else read_mjcf
    imported = read(source, cite, point)
    heading = f"Made of {source.name}. The sources and certainty of its numbers are not in that file: fill them in."
    with writing(target):
        write_finger(imported.document, target, heading)
    finger = imported.finger
    body: dict[str, Any] = {
        "source": str(source),
        "finger": str(target),
        "id": finger.id,
        "bones": list(finger.topology.bones),
        "rotations": list(finger.topology.rotations),
        "segments": [segment.name for segment in finger.topology.segments],
        "reactions": imported.document["reactions"],
        "notes": list(imported.notes),
    }
    if not answer("import", body, json):
        for note in imported.notes:
            say(f"  {note}")
        rotations = ", ".join(finger.topology.rotations)
        say(f"  angles: {rotations}; the clamp carries {', '.join(imported.document['reactions'])}")
        say(f"{source.name}: {target}")
