"""A trail that was changed, shortened within or added to elsewhere is told; one that is sound stays so."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from daq import audit
from daq.audit import FILE, LOCK, Entry, faults, local_user, note, read
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


ADDING = """
import sys
from pathlib import Path
from daq.audit import note
for number in range(int(sys.argv[3])):
    note(Path(sys.argv[1]), "amend", sys.argv[2], {"number": number, "words": "x" * 500 * number})
"""
HOLDING = """
import sys, time
from pathlib import Path
from daq.audit import changing
with changing(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(600)
"""


def started(script: str, *given: str) -> subprocess.Popen[str]:
    return subprocess.Popen([sys.executable, "-c", script, *given], stdout=subprocess.PIPE, text=True)  # noqa: S603


def test_programs_that_add_at_once_keep_one_chain(tmp_path: Path) -> None:
    writers, each = 4, 12
    running = [started(ADDING, str(tmp_path), f"S{n}", str(each)) for n in range(writers)]
    assert [process.communicate(timeout=120.0) and process.returncode for process in running] == [0] * writers
    entries = read(tmp_path)
    assert faults(entries) == []
    for n in range(writers):
        assert [e.details["number"] for e in entries if e.about == f"S{n}"] == list(range(each))


def test_a_program_that_is_killed_holds_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    holder = started(HOLDING, str(tmp_path))
    assert holder.stdout is not None
    assert holder.stdout.readline() == "held\n"
    monkeypatch.setattr(audit, "_PATIENCE_S", 0.1)
    with pytest.raises(InputError, match="locked"):
        note(tmp_path, "amend", "S1", {})
    assert read(tmp_path) == []
    holder.kill()
    holder.communicate(timeout=60.0)
    note(tmp_path, "amend", "S1", {})
    assert faults(read(tmp_path)) == []
    assert {f.name for f in tmp_path.iterdir()} == {FILE, LOCK}


def test_an_entry_that_the_disk_has_no_room_for_leaves_the_trail_as_it_was(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = (folder / FILE).read_bytes()

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("daq.audit.os.fsync", full)
        with pytest.raises(InputError, match="No space left"):
            note(folder, "amend", "S1", {})
    assert (folder / FILE).read_bytes() == before
    note(folder, "amend", "S1", {})
    assert faults(read(folder)) == []
