"""Amendments: an entry stays as it is, and everything else heeds what a case really was."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml

from daq.checks import check, measure_and_check
from daq.errors import InputError, SessionError
from daq.locations import data_dir
from daq.sessions import (
    AMENDMENTS_FILE as FILE,
)
from daq.sessions import parse_session, plain_document, read_amendments, read_session, write_session
from daq.sessions.amendments import amended_lines, amendment, exchanged, listed, write_amendments
from daq.signals.corrections import as_entered, measure
from daq.vocabulary import OTHER_MOUNT


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    out = tmp_path / "H01"
    shutil.copytree(data_dir() / "sessions" / "synek2019_H01", out)
    return out


def first(folder: Path) -> str:
    return read_session(folder).cases[0].id


def test_the_entry_stays_and_measuring_heeds_the_amendment(folder: Path) -> None:
    before, text = read_session(folder), (folder / "session.yaml").read_bytes()
    case = before.cases[0]
    ((tendon, grams),) = case.masses_g.items()
    other = next(m for m in ("FDS", "FDP") if m != tendon)
    write_amendments(folder, (amendment(before, case.id, "seen on the photo", tendons={tendon: other}),))
    assert (folder / "session.yaml").read_bytes() == text
    after = read_session(folder)
    assert after.cases == before.cases
    assert measure(after).cases[0].case.masses_g == {other: grams}
    assert as_entered(measure(after)).cases[0].case == case
    assert listed(after)[0]["entered"] == {"masses_g": {tendon: grams}}
    write_amendments(folder, ())
    assert not (folder / FILE).exists()
    assert measure(read_session(folder)).cases[0].case == case


def test_a_case_that_was_read_at_the_other_mount_is_measured_in_its_axes(tmp_path: Path) -> None:
    folder = tmp_path / "DEV-02"
    shutil.copytree(data_dir() / "sessions" / "DEV-02", folder)
    document = yaml.safe_load((folder / "session.yaml").read_text(encoding="utf-8"))
    mounts = document["load_cell"]["mounts"]
    mounts["tip"]["offset_mm"], mounts["bone"]["rotation_deg"] = [1.0, 2.0, 3.0], [10.0, -20.0, 70.0]
    (folder / "session.yaml").write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
    session = read_session(folder)
    before = measure(session).cases
    moved = {next(k for k, m in enumerate(before) if m.case.location == p): o for p, o in OTHER_MOUNT.items()}
    made = [amendment(session, before[k].case.id, "seen on the photo", location=other) for k, other in moved.items()]
    write_amendments(folder, tuple(made))
    after = measure(read_session(folder)).cases
    for k, (was, now) in enumerate(zip(before, after, strict=True)):
        turn = was.to_other_mount if k in moved else np.eye(6)
        assert now.case.location == moved.get(k, was.case.location)
        assert now.wrench == pytest.approx(turn @ was.wrench, abs=1e-9)
        assert now.to_other_mount @ turn == pytest.approx(was.to_other_mount if k not in moved else np.eye(6), abs=1e-9)
    again = as_entered(measure(read_session(folder)))
    assert again.sha256 == measure(session).sha256
    assert again.covariance() == pytest.approx(measure(session).covariance(), rel=1e-12)
    assert again.session == session


def test_cases_amended_alike_are_told_on_one_line(folder: Path) -> None:
    session = read_session(folder)
    bones = [c.id for c in session.cases if c.location == "bone"][:6]
    made = [amendment(session, case, "seen on the photo", location="tip") for case in bones]
    made += [amendment(session, session.cases[0].id, "the suture slipped", exclude=True)]
    write_amendments(folder, tuple(made))
    block, alone = amended_lines(listed(read_session(folder)))
    assert block.startswith(
        f"Amended {bones[0]}, {bones[1]}, {bones[2]} and 3 more: the cell was at the tip (entered: bone);"
    )
    assert alone.startswith(f"Amended {session.cases[0].id}: left out; the suture slipped")


def test_heeding_amendments_twice_is_heeding_them_once(folder: Path) -> None:
    session = read_session(folder)
    a, b = session.cases[0], next(c for c in session.cases if c.masses_g != session.cases[0].masses_g)
    write_amendments(folder, exchanged(session, a.id, b.id, "the sheet has them in the other order"))
    once = read_session(folder).amended
    assert once.amended.cases == once.cases
    found = {c.id: c for c in once.cases}
    assert (found[a.id].masses_g, found[a.id].posture) == (b.masses_g, b.posture)
    assert (found[b.id].masses_g, found[b.id].posture) == (a.masses_g, a.posture)


def test_a_copy_of_the_session_keeps_entries_and_amendments(folder: Path, tmp_path: Path) -> None:
    session = read_session(folder)
    write_amendments(folder, (amendment(session, first(folder), "the suture slipped", exclude=True),))
    amended = measure(read_session(folder)).session
    write_session(amended, tmp_path / "copy")
    copy = read_session(tmp_path / "copy")
    assert copy.cases == session.cases
    assert [c.id for c in measure(copy).session.cases if c.excluded] == [first(folder)]
    again, faults = parse_session(plain_document(amended), None)
    assert not faults
    assert again is not None
    assert again.amendments == amended.amendments


def test_a_later_amendment_builds_on_an_earlier_one(folder: Path) -> None:
    session = read_session(folder)
    name = session.cases[0].id
    ((tendon, _),) = session.cases[0].masses_g.items()
    one = amendment(session, name, "weighed again", masses_g={tendon: 400.0})
    write_amendments(folder, (one,))
    posture = next(p for p in session.postures_deg if p != session.cases[0].posture)
    write_amendments(folder, (one, amendment(read_session(folder), name, "seen on the video", posture=posture)))
    case = read_session(folder).amended.cases[0]
    assert (case.masses_g, case.posture) == ({tendon: 400.0}, posture)


@pytest.mark.parametrize(
    ("change", "found"),
    [
        ({"case": "c999"}, "no case c999"),
        ({"posture": "fist"}, "posture 'fist'"),
        ({"location": "palm"}, "mount 'palm'"),
        ({"tendons": {"LU": "FDS"}}, "not LU"),
        ({}, "is so already"),
        ({"why": " ", "exclude": True}, "without a reason"),
    ],
)
def test_what_cannot_be_is_refused(folder: Path, change: dict[str, object], found: str) -> None:
    session = read_session(folder)
    given = {"case": session.cases[0].id, "why": "so it was"} | change
    with pytest.raises(SessionError, match=found):
        amendment(session, **given)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "text",
    [
        "",
        "format: other/1\n",
        "format: bench-amendments/1\n",
        "format: bench-amendments/1\namendments: [1]\n",
        "a: [\n",
    ],
)
def test_a_damaged_file_is_one_clear_line(folder: Path, text: str) -> None:
    (folder / FILE).write_text(text, encoding="utf-8")
    with pytest.raises(SessionError, match=FILE):
        read_amendments(folder)
    assert not check(folder).ok


def test_an_amendment_of_no_case_is_named_with_its_place(folder: Path) -> None:
    said = {"case": "c999", "masses_g": {"FDP": 5.0}, "why": "x", "at": "2026-01-01"}
    (folder / FILE).write_text(yaml.safe_dump({"format": "bench-amendments/1", "amendments": [said]}), encoding="utf-8")
    with pytest.raises(InputError, match=r"amendments\[0\]"):
        read_session(folder)


def test_a_mass_below_a_gram_is_refused_unless_it_is_meant(folder: Path) -> None:
    file = folder / "session.yaml"
    document = yaml.safe_load(file.read_text(encoding="utf-8"))
    (tendon,) = document["cases"][0]["masses_g"]
    document["cases"][0]["masses_g"] = {tendon: 0.95}
    file.write_text(yaml.safe_dump(document), encoding="utf-8")
    with pytest.raises(SessionError, match=r"0.95 g; that looks like kg.*950 g"):
        read_session(folder)
    file.write_text(yaml.safe_dump(document | {"light_masses": True}), encoding="utf-8")
    assert read_session(folder).cases[0].masses_g == {tendon: 0.95}


def test_measuring_checks_by_the_way() -> None:
    session = read_session("DEV-02")
    measured, findings = measure_and_check(session)
    report = check(session)
    assert list(findings) == [*report.errors, *report.warnings]
    assert (measured.cases[5].wrench == measure(session).cases[5].wrench).all()
