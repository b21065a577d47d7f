"""Fingers for OpenSim and MuJoCo, and out of their files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from daq.errors import InputError
from daq.export.tables import sha256_of
from fingermodel.fingers.files import read_finger

if TYPE_CHECKING:
    from fingermodel.exchange.described import Imported
    from fingermodel.exchange.reading import Floats
    from fingermodel.exchange.writing import Written
    from fingermodel.fingers import Finger
    from fingermodel.model_files import Revision

# Endings that each format may have, the first one by default.
ENDINGS = {"osim": (".osim",), "mjcf": (".xml", ".mjcf")}
READABLE = (".osim", ".xml", ".mjcf")
UNSOURCED = "The sources and certainty of its numbers are not in that file: fill them in."


def named_finger(source: str) -> tuple[Finger, str, tuple[str, ...]]:
    """Return the finger, the name of what holds it, and what of that is not the finger's."""
    from fingermodel.model_files import read_revision

    path = Path(source)
    if path.suffix != ".json":
        finger = read_finger(source)
        return finger, finger.id, ()
    if not path.is_file():
        raise InputError(f"no model file {source}", "a revision written by `fingertwin refit --out`")
    revision = read_revision(path)
    return revision.finger, revision.id, revision_notes(revision)


def written_finger(finger: Finger, name: str, file_format: str) -> Written:
    """Write a finger in a format of ENDINGS.

    Args:
        finger: to write.
        name: of what holds it, for the file's comment.
        file_format: osim or mjcf.

    Raises:
        ModelError: a finger that the format cannot hold.
    """
    from importlib.metadata import version

    from fingermodel.exchange.mjcf import write_mjcf
    from fingermodel.exchange.osim import write_osim

    made = f"{finger.title} ({name}), written by fingertwin {version('fingertwin')}"
    return write_osim(finger, made) if file_format == "osim" else write_mjcf(finger, made)


def revision_notes(revision: Revision) -> tuple[str, ...]:
    """Return notes on the parts of a revision that such a file cannot hold."""
    held = [str(effect["name"]) for effect in revision.document.get("effects") or []]
    return (f"The file holds the fitted finger without the revision's effects: {', '.join(held)}",) if held else ()


def read_foreign(source: Path, load_point_mm: Floats | None) -> Imported:
    """Read a finger out of an OpenSim or MJCF file.

    Args:
        source: the file; what ends in .osim is OpenSim's.
        load_point_mm: (3,) of the last bone, in its own axes; overrides the file's.

    Raises:
        ModelError: it cannot be read, or holds no finger chain that a finger/1 file can hold.
    """
    from fingermodel.exchange.read_mjcf import read_mjcf
    from fingermodel.exchange.read_osim import read_osim

    cite = f"{source.name}" + (f", SHA-256 {sha256_of(source)}" if source.is_file() else "")
    return (read_osim if source.suffix.lower() == ".osim" else read_mjcf)(source, cite, load_point_mm)


def imported_body(imported: Imported) -> dict[str, Any]:
    """Return the contents of an imported finger as plain data."""
    topology, check = imported.finger.topology, imported.check
    return {
        "id": imported.finger.id,
        "bones": list(topology.bones),
        "rotations": list(topology.rotations),
        "segments": [segment.name for segment in topology.segments],
        "reactions": imported.document["reactions"],
        "notes": list(imported.notes),
        "read": imported.read,
        "check": None
        if check is None
        else {
            "engine": check.engine,
            "postures": check.postures,
            "between": check.between,
            "worst_mm": {name: round(error, 6) for name, error in check.worst_mm.items()},
        },
    }
