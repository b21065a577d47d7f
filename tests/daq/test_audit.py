"""A trail that was changed, shortened within or added to elsewhere is told; one that is sound stays so."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from daq.audit import FILE, Entry, faults, local_user, note, read
from daq.errors import InputError


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for case in ("c001", "c002", "c003"):
        note(tmp_path, "amend", "S1", {"case": case, "mass_g": 9.5e2, "words": "Γ – a photo"})
    return tmp_path


def test_a_trail_says_who_did_what_and_is_sound(folder: Path) -> None:
    entries = read(folder)
    assert [(e.number, e.who, e.what, e.details["case"]) for e in entries] == [
        (n, local_user(), "amend", f"c00{n}") for n in (1, 2, 3)
    ]
    assert faults(entries) == []
    assert read(folder / "elsewhere") == []


@pytest.mark.parametrize(
    "tamper",
    [
        lambda e: [e[0], replace(e[1], who="somebody else"), e[2]],
        lambda e: [e[0], replace(e[1], details={}), e[2]],
        lambda e: [e[0], e[2]],
        lambda e: e[1:],
        lambda e: [e[1], e[0], e[2]],
        lambda e: [*e, replace(e[2], details={})],
        lambda e: [e[0], replace(e[1], who="x", sha256=replace(e[1], who="x").digest()), e[2]],
    ],
    ids=["who", "what", "left out", "begin cut", "order", "twice", "made anew"],
)
def test_whatever_is_done_to_a_trail_is_told(folder: Path, tamper: Callable[[list[Entry]], list[Entry]]) -> None:
    assert faults(tamper(read(folder)))


@pytest.mark.parametrize("line", ["{}", "nonsense", '{"number": 1, "number": 2}', "[1]"])
def test_a_line_that_is_no_entry_is_bad_input(folder: Path, line: str) -> None:
    file = folder / FILE
    file.write_text(file.read_text(encoding="utf-8") + line + "\n", encoding="utf-8")
    with pytest.raises(InputError, match="line 4"):
        read(folder)


def test_a_trail_is_lines_of_json(folder: Path) -> None:
    lines = (folder / FILE).read_text(encoding="utf-8").splitlines()
    assert [json.loads(line)["number"] for line in lines] == [1, 2, 3]
