"""Files that a user writes say each thing once: a key that is given twice is refused, since only one could count."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from daq.documents import read_document
from daq.errors import InputError
from daq.sessions import read_yaml
from fingermodel.diagnosis.next_cases.frozen import read_frozen
from fingermodel.exchange.reading import about_of
from fingermodel.model_files import read_revision
from server.service.web.strict_requests import read_json

TWICE = '{"format": "a", "inner": {"mass": 1, "mass": 2}}'


def finger_notes(file: Path) -> object:
    return about_of(file.read_text(encoding="utf-8"), "its notes")


def document(file: Path) -> object:
    return read_document(file, "a finger/1 file")


@pytest.mark.parametrize("read", [read_yaml, document, read_revision, read_frozen, finger_notes])
def test_a_key_given_twice_is_refused(read: Callable[[Path], Any], tmp_path: Path) -> None:
    file = tmp_path / "twice.json"
    file.write_text(TWICE, encoding="utf-8")
    with pytest.raises(InputError):
        read(file)
    assert read_document(_once(file), "a file") == json.loads(TWICE.replace('"mass": 1, ', ""))


def test_a_body_with_a_key_given_twice_is_refused() -> None:
    with pytest.raises(json.JSONDecodeError, match="'mass' is there twice"):
        read_json(TWICE.encode())


def _once(file: Path) -> Path:
    file.write_text(TWICE.replace('"mass": 1, ', ""), encoding="utf-8")
    return file
