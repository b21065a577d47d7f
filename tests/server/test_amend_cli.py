"""`fingertwin amend`, and what the other commands say of it."""

from __future__ import annotations

import json
import shlex
import shutil
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path
from threading import Barrier
from time import sleep
from typing import Any

import pytest

from daq import audit
from daq.locations import data_dir
from daq.sessions import read_session
from daq.sessions.amendments import amendments_of, block_of, write_amendments
from daq.sessions.models import Amendment
from fingermodel.comparing import compare
from fingermodel.diagnosis.verdict.changes import Amend
from fingermodel.session import Session
from server.application.amending import keep_amendments, take_back
from server.application.drawing import draw_comparison
from server.commands.diagnosis import amending
from tests.server.command_line import refused, run


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    out = tmp_path / "H01"
    shutil.copytree(data_dir() / "sessions" / "synek2019_H01", out)
    return out


def amended(folder: Path, *arguments: str) -> dict[str, Any]:
    answer = run("amend", folder, *arguments, "--json", "-")
    assert (answer.code, answer.err) == (0, "")
    body: dict[str, Any] = json.loads(answer.out)
    assert body["schema"] == "fingertwin/amend/1"
    return body


def entry(folder: Path, case: str = "") -> dict[str, Any]:
    cases = run("compare", folder, "--json", "-").body("compare")["cases"]
    found: dict[str, Any] = next(c for c in cases if not case or c["id"] == case)
    return found


def test_an_amendment_is_made_shown_and_taken_back(folder: Path) -> None:
    before = entry(folder)
    name, ((tendon, grams),) = before["id"], before["masses_g"].items()
    other = "FDS" if tendon != "FDS" else "FDP"
    body = amended(folder, name, "--tendon", f"{other}={tendon}", "--why", "the photo shows it", "--by", "A")
    assert [a["case"] for a in body["amendments"]] == body["made"] == [name]
    after = entry(folder, name)
    assert after["masses_g"] == {other: grams}
    assert after["predicted_N"] != before["predicted_N"]
    shown = run("compare", folder)
    assert shown.out.startswith(f"Amended {name}: {other} {grams:g} g hung (entered: {tendon} {grams:g} g); the photo")
    assert run("amend", folder).out.startswith(f"Amended {name}")
    taken = run("amend", folder, name, "--undo")
    assert taken.code == 0
    first, last = taken.out.splitlines()
    assert first.startswith(f"Taken back: {name}: ")
    assert last == f"{folder}: nothing is amended any more."
    assert entry(folder, name) == before
    assert run("amend", folder).out == f"{folder}: nothing is amended.\n"


def test_two_cases_are_exchanged_and_one_is_left_out(folder: Path) -> None:
    cases = run("compare", folder, "--json", "-").body("compare")["cases"]
    a, b = cases[0], next(c for c in cases if c["masses_g"] != cases[0]["masses_g"])
    amended(folder, a["id"], "--exchange", b["id"], "--why", "entered in the other order")
    assert entry(folder, a["id"])["masses_g"] == b["masses_g"]
    assert entry(folder, b["id"])["masses_g"] == a["masses_g"]
    amended(folder, cases[5]["id"], "--exclude", "--why", "the suture slipped")
    body = run("compare", folder, "--json", "-").body("compare")
    assert cases[5]["id"] not in {c["id"] for c in body["cases"]}
    assert body["excluded"] == {cases[5]["id"]: "the suture slipped"}


def test_an_exchange_is_taken_back_as_a_whole(folder: Path) -> None:
    before = run("compare", folder, "--json", "-").body("compare")["cases"]
    a, b = before[0]["id"], next(c["id"] for c in before if c["masses_g"] != before[0]["masses_g"])
    for one, other in ((a, b), (b, a)):
        amended(folder, a, "--exchange", b, "--why", "two lines of the sheet")
        assert run("amend", folder, one, "--undo").out.count("Taken back") == 2
        assert run("compare", folder, "--json", "-").body("compare")["cases"] == before
        amended(folder, a, "--exchange", b, "--why", "two lines of the sheet")
        amended(folder, other, "--exclude", "--why", "the suture slipped")
        kept = (folder / "amendments.yaml").read_bytes()
        saying = f"{other} was amended again after it was exchanged with {one}"
        refused("amend", folder, one, "--undo", saying=saying, instead=f"Undo {other} first")
        assert (folder / "amendments.yaml").read_bytes() == kept
        assert run("amend", folder, other, "--undo").out.count("Taken back") == 1
        assert run("amend", folder, other, "--undo").out.count("Taken back") == 2
    assert read_session(folder).amendments == ()


def test_a_report_says_first_what_was_amended(folder: Path, tmp_path: Path) -> None:
    case = entry(folder)["id"]
    amended(folder, case, "--exclude", "--why", "the suture slipped")
    bench = Session.open(folder, catalogue=False)
    page = draw_comparison(bench, compare(bench), tmp_path / "figures", static=False).read_text(encoding="utf-8")
    assert page.count(f"Amended {case}: left out; the suture slipped") == 1
    assert f"Left out {case}" not in page
    assert page.index("<h2>Before you read on</h2>") < page.index("<h2>Summary</h2>")


def test_a_block_of_cases_is_amended_where_that_is_a_change_and_taken_back_as_one(folder: Path) -> None:
    before = run("compare", folder, "--json", "-").body("compare")["cases"]
    posture = before[0]["posture"]
    here = [c for c in before if c["posture"] == posture and c["location"] == "tip"]
    swapped = ["--tendon", "FDS=FDP", "--tendon", "FDP=FDS", "--why", "the cables were led to the other pulley"]
    body = amended(folder, f"{posture},tip", *swapped)
    other = {"FDP": "FDS", "FDS": "FDP"}
    hung = {c["id"]: {other.get(t, t): g for t, g in c["masses_g"].items()} for c in here}
    # Of two that bear the same weight, nothing changes.
    assert body["made"] == [c["id"] for c in here if hung[c["id"]] != c["masses_g"]]
    after = {c["id"]: c["masses_g"] for c in run("compare", folder, "--json", "-").body("compare")["cases"]}
    assert {name: after[name] for name in hung} == hung
    undone = run("amend", folder, f"{posture},tip", "--undo")
    assert undone.out.count("Taken back") == len(body["made"])
    assert run("compare", folder, "--json", "-").body("compare")["cases"] == before


def test_weights_are_amended_wherever_they_hung(folder: Path) -> None:
    before = run("compare", folder, "--json", "-").body("compare")["cases"]
    one, other = sorted({grams for c in before for grams in c["masses_g"].values()})[:2]
    body = amended(folder, "all", "--weight", f"{one}={other}", "--weight", f"{other}={one}", "--why", "weighed again")
    weighs = {one: other, other: one}
    after = run("compare", folder, "--json", "-").body("compare")["cases"]
    assert [c["masses_g"] for c in after] == [
        {tendon: weighs.get(grams, grams) for tendon, grams in c["masses_g"].items()} for c in before
    ]
    assert body["made"] == [c["id"] for c in before if set(c["masses_g"].values()) & set(weighs)]


@pytest.mark.parametrize(
    "changes",
    [
        {"tendons": {"FDP": "FDS", "FDS": "FDP"}},
        {"weights_g": {"WEIGHT": 123.5}},
        {"masses_g": {"FDP": 1234.5678, "EDC": 0.0}},
        {"posture": "POSTURE"},
    ],
)
def test_what_a_search_proposes_is_the_amendment_that_its_command_makes(folder: Path, changes: dict[str, Any]) -> None:
    session = read_session(folder)
    weight = next(iter(session.cases[0].masses_g.values()))
    if "weights_g" in changes:
        changes = {"weights_g": {weight: 123.5}}
    if "posture" in changes:
        changes = {"posture": next(p for p in session.postures_deg if p != session.cases[0].posture)}
    change = asdict(Amend("all", **changes))
    wanted = amendments_of(session, block_of(session, "all"), "x", **changes)
    body = amended(folder, *shlex.split(amending(change)), "--why", "x")
    assert body["made"] == [a.case for a in wanted]
    after = {c.id: c for c in read_session(folder).amended.cases}
    for amendment in wanted:
        assert {name: getattr(after[amendment.case], name) for name in amendment.changes} == amendment.changes


def test_a_range_of_cases_names_them_in_their_order(folder: Path) -> None:
    ids = [c["id"] for c in run("compare", folder, "--json", "-").body("compare")["cases"]]
    body = amended(folder, f"{ids[2]}..{ids[4]}", "--exclude", "--why", "the clamp had slipped")
    assert body["made"] == ids[2:5]


@pytest.mark.parametrize(
    ("arguments", "saying", "instead"),
    [
        (["c999", "--exclude", "--why", "x"], "no case c999", "the id of a load case"),
        (["CASE", "--exclude"], "without a reason", "--why"),
        (["c999..", "--exclude", "--why", "x"], "no case c999", "the id of a load case"),
        (["tip,bone", "--exclude", "--why", "x"], "no case is tip and bone", "hold together"),
        (["all", "--exchange", "CASE", "--why", "x"], "--exchange with", "Name one"),
        (["CASE", "--why", "x"], "nothing to amend", "--tendon"),
        (["CASE", "--mass", "FDP", "--why", "x"], "--mass FDP", "TENDON=GRAMS"),
        (["CASE", "--mass", "FDP=5", "--mass", "FDP=6", "--why", "x"], "--mass FDP is given twice", "one value"),
        (["CASE", "--tendon", "FDS=FDP", "--tendon", "LU=FDP", "--why", "x"], "FDP is given twice", "one value"),
        (["CASE", "--mass", "FDP=heavy", "--why", "x"], "no mass", "FDP=950"),
        (["CASE", "--mass", "FDP=-5", "--why", "x"], "-5 g", "0 g or more"),
        (["CASE", "--mass", "FDP=0.95", "--why", "x"], "0.95 g", "1 g or more"),
        (["all", "--weight", "FDP=950", "--why", "x"], "no mass", "550=484"),
        (["all", "--weight", "550=483.5", "--why", "x"], "no weight of 483.5 g", "one that was entered [g]"),
        (["CASE", "--undo"], "no amendment", "fingertwin amend"),
        (["CASE", "--undo", "--exclude"], "--undo beside", "one of them"),
        (["CASE", "--exchange", "CASE", "--why", "x"], "the same entry", "two that differ"),
    ],
)
def test_what_cannot_be_amended_is_one_line_and_changes_nothing(
    folder: Path, arguments: list[str], saying: str, instead: str
) -> None:
    name = entry(folder)["id"]
    refused("amend", folder, *(name if a == "CASE" else a for a in arguments), saying=saying, instead=instead)
    assert not (folder / "amendments.yaml").exists()


def test_a_session_that_comes_with_the_software_stays_as_it_is() -> None:
    refused(
        "amend", "synek2019_H01", "c001", "--exclude", "--why", "x", saying="comes with the software", instead="yours"
    )


def test_amendments_that_are_made_and_taken_back_at_once_are_all_kept(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = read_session(folder)
    cases = [c for c in session.cases if len(c.masses_g) == 1][:6]
    made = [
        one
        for c in cases
        for one in amendments_of(session, [c], "seen on the photo", masses_g=dict.fromkeys(c.masses_g, 123.0))
    ]
    at_once = Barrier(len(made))

    def slowly(where: Path, amendments: tuple[Amendment, ...]) -> Path:
        sleep(0.02)
        return write_amendments(where, amendments)

    def keep(one: Amendment) -> None:
        at_once.wait()
        keep_amendments(str(folder), folder, [one])

    def undo(one: Amendment) -> None:
        at_once.wait()
        take_back(folder, [one.case])

    monkeypatch.setattr("server.application.amending.write_amendments", slowly)
    with ThreadPoolExecutor(len(made)) as pool:
        list(pool.map(keep, made))
        assert {a.case for a in read_session(folder).amendments} == {a.case for a in made}
        list(pool.map(undo, made))
    assert read_session(folder).amendments == ()
    trail = audit.read(folder)
    assert [e.what for e in trail] == ["amend"] * len(made) + ["amend undone"] * len(made)
    assert audit.faults(trail) == []
