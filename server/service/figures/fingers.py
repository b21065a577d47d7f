"""Fingers in the service: what they are, and what other software has them as."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from daq.locations import data_dir
from fingermodel.fingers.files import finger_names, read_finger
from fingermodel.muscles.muscle_files import muscle_set_names
from server.application.exchange import ENDINGS, written_finger
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
