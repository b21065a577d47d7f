"""Fingers in the service: what they are, and what other software has them as."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from daq.errors import InputError
from daq.locations import data_dir
from fingermodel.fingers.files import finger_from_dict, finger_names, finger_text, read_finger
from fingermodel.muscles.muscle_files import muscle_set_names
from fingermodel.studies.scaling import scale_finger, scaled_document, scaled_heading
from server.application.exchange import ENDINGS, UNSOURCED, imported_body, read_foreign, written_finger
from server.application.species import compare_species
from server.figures.species import species_plots
from server.service.figures.answer import Theme, drawn_plots
from server.service.web.problems import not_found


def known_finger(name: str) -> str:
    """Return the name of a finger that comes with the software.

    Raises:
        ProblemError: 404 there is none of that name.
    """
    if name not in finger_names():
        raise not_found("finger", name, "/api/v1/fingers")
    return name


@lru_cache(maxsize=64)
def finger_shown(name: str) -> dict[str, Any]:
    """Return a shipped finger without its numbers."""
    finger = read_finger(name)
    topology = finger.topology
    return {
        "name": name,
        "id": finger.id,
        "title": finger.title,
        "bones": list(topology.bones),
        "joints": list(topology.rotations),
        "tendons": list(topology.muscles),
        "judged_in": finger.judged_in,
        "moves": bool(finger.document.get("inertia")),
        "activates": name in muscle_set_names(),
    }


@lru_cache(maxsize=16)
def exported(name: str, file_format: str) -> tuple[str, str, tuple[str, ...]]:
    """Return a shipped finger in a format: the file's name, its text, and what the format cannot say.

    Raises:
        ModelError: a finger that the format cannot hold.
    """
    if file_format == "finger":
        return f"{name}.yaml", (data_dir() / "fingers" / f"{name}.yaml").read_text(encoding="utf-8"), ()
    written = written_finger(read_finger(name), name, file_format)
    return f"{name}{ENDINGS[file_format][0]}", written.text, written.notes


def formats(name: str) -> list[dict[str, Any]]:
    """Return the formats that a finger can be exported to, with what each cannot say of it."""
    out = []
    for file_format in ("finger", "osim", "mjcf"):
        try:
            file, _, notes = exported(name, file_format)
        except InputError:
            continue  # a finger that this format cannot hold is not offered in it
        out.append({"format": file_format, "file": file, "notes": [f"{n}." for n in notes]})
    return out


def imported(name: str, text: str, load_point_mm: Sequence[float] | None) -> dict[str, Any]:
    """Return a finger/1 document of another software's file.

    Args:
        name: of the file.
        text: its content.
        load_point_mm: (3,) of the last bone.

    Raises:
        ModelError: it cannot be read, or holds no finger chain that a finger/1 file can hold.
    """
    import numpy as np

    with TemporaryDirectory(prefix="fingertwin-", ignore_cleanup_errors=True) as folder:
        file = Path(folder) / name
        file.write_text(text, encoding="utf-8")
        found = read_foreign(file, None if load_point_mm is None else np.array(load_point_mm))
    heading = f"Made of {name}. {UNSOURCED}"
    head = {"schema": "fingertwin/finger-import/1", "name": name}
    return head | imported_body(found) | {"document": found.document, "file": finger_text(found.document, heading)}


def scaled(
    finger: str,
    bones_mm: Mapping[str, float],
    moment_arms_mm: Mapping[str, float],
    reference_mm: Mapping[str, float],
    name: str,
) -> dict[str, Any]:
    """Return a finger/1 document scaled to a specimen, with lengths and moment arms before and after.

    Raises:
        InputError: an unknown bone or tendon, or a length beyond reason.
    """
    found = scale_finger(finger, bones_mm, moment_arms_mm, reference_mm, name)
    document = scaled_document(found)
    finger_from_dict(document, name)
    head = {"schema": "fingertwin/scale/1"} | found.as_dict()
    return head | {"document": document, "file": finger_text(document, scaled_heading(found))}


def compared(finger: str, other: str, theme: Theme | None) -> dict[str, Any]:
    """Return two shipped fingers side by side, drawn where a theme is named.

    Raises:
        InputError: they do not fit together.
    """
    found = compare_species(finger, other)
    drawn = [] if theme is None else drawn_plots(species_plots(found), theme)
    return {"schema": "fingertwin/species/1"} | found.as_dict() | {"figures": drawn}
