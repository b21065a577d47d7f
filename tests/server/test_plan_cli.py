"""`fingertwin plan`: finger, protocol, notebook and a bench sheet with every case in order."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from daq.lab.notebook import read_notes
from daq.sessions.protocols import plan, read_protocol
from fingermodel.fingers.files import read_finger
from tests.server.test_exchange_cli import answered, refused

pdfium = pytest.importorskip("pypdfium2")


def lines_of(sheet: Path) -> list[str]:
    document = pdfium.PdfDocument(sheet)
    return [line for page in document for line in page.get_textpage().get_text_range().splitlines()]


def test_a_plan_of_a_shipped_protocol_for_a_scaled_finger(tmp_path: Path) -> None:
    out = tmp_path / "day"
    given = [
        "--finger",
        "an1979_middle",
        "--bone",
        "PP=48",
        "--protocol",
        "levels",
        "--only",
        "hook",
        "--only",
        "relaxed",
    ]
    body = answered("plan", "--out", out, *given, "--posture", "hook: MCP 5 PIP 70 DIP 45 abduction 0")
    protocol = read_protocol(str(out / "protocol.yaml"))
    cases, length_s = plan(protocol)
    whole = [c for c in plan(read_protocol("levels"))[0] if c.posture in ("hook", "relaxed")]
    assert [(c.posture, c.location, c.role, c.masses_g) for c in cases] == [
        (c.posture, c.location, c.role, c.masses_g) for c in whole
    ]
    assert protocol.postures_deg["hook"]["MCP"] == 5
    assert (body["cases"], body["length_s"]) == (len(cases), length_s)
    assert read_finger(str(out / "finger.yaml")).id == "day"
    # The sheet: every case once, in order, with what hangs; and as many pages as were said.
    sheet = out / "bench-sheet.pdf"
    said = "\n".join(lines_of(sheet))
    assert re.findall(r"\bc\d{3}\b", said) == [c.id for c in cases]
    for case in cases:
        hung = " + ".join(f"{tendon} {mass:g}" for tendon, mass in case.masses_g.items())
        assert re.search(rf"{case.id}\s+{re.escape(hung)}", said)
    assert said.count("nothing: tare") == len({c.block_start_s for c in cases})
    assert "PP 48 mm" in said
    assert len(pdfium.PdfDocument(sheet)) == body["pages"] > 1
    # The notebook goes into `fingertwin new` as it is.
    notes = read_notes((out / "notes.txt").read_text("utf-8"), ["RI", "LU", "UI", "FDP", "FDS", "EDC"])
    assert [(n.posture, n.location, n.role, dict(n.masses_g)) for n in notes] == [
        (c.posture, c.location, c.role, c.masses_g) for c in cases
    ]
    assert "has a plan already" in refused("plan", "--out", out, *given)


def test_loads_as_a_notebook_become_a_protocol(tmp_path: Path) -> None:
    loads = tmp_path / "loads.txt"
    loads.write_text("FDP 950, hook, tip\nFDS 950\nFDP 500 + FDS 0.3 kg\nEDC 400, relaxed, validation\n", "utf-8")
    angles = ["--posture", "hook: MCP 0 PIP 65 DIP 50", "--posture", "relaxed: MCP 20 PIP 30 DIP 15"]
    body = answered("plan", "--out", tmp_path / "own", "--finger", "an1979_middle", "--loads", loads, *angles)
    assert (body["cases"], body["finger"], body["heaviest_g"]["FDP"]) == (4, "an1979_middle", 950)
    cases, _ = plan(read_protocol(str(tmp_path / "own" / "protocol.yaml")))
    assert [(c.masses_g, c.posture, c.role) for c in cases][2:] == [
        ({"FDP": 500, "FDS": 300}, "hook", "identification"), ({"EDC": 400}, "relaxed", "validation"),
    ]  # fmt: skip
    assert not (tmp_path / "own" / "finger.yaml").exists()


def test_the_notebook_of_a_friction_protocol_says_how_each_weight_came_to_rest(tmp_path: Path) -> None:
    answered("plan", "--out", tmp_path / "day", "--finger", "an1979_middle", "--protocol", "friction")
    cases, _ = plan(read_protocol("friction"))
    text = (tmp_path / "day" / "notes.txt").read_text("utf-8")
    notes = [n for n in read_notes(text, ["RI", "LU", "UI", "FDP", "FDS", "EDC"]) if n.kind == "load"]
    assert [(n.direction, n.tapped) for n in notes] == [(c.reading.direction, c.reading.tapped) for c in cases]
    assert {n.direction for n in notes} == {"loading", "unloading"}
    assert any(n.tapped for n in notes)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (["--protocol", "levels"], "no finger; expected --finger FILE"),
        (["--finger", "an1979_middle"], "no loads; expected --protocol FILE"),
        (["--finger", "an1979_middle", "--protocol", "levels", "--only", "fist"], "has no posture 'fist'"),
        (["--finger", "an1979_middle", "--protocol", "nothing"], "no protocol 'nothing'"),
        (["--finger", "wu2008_index", "--protocol", "levels"], "which wu2008_index has not"),
        (["--finger", "an1979_middle", "--moment-arm", "FDP@MCP=10"], "moment arms without a bone length"),
        (["--finger", "an1979_middle", "--bone", "PP=4.8", "--protocol", "levels"], "PP"),
        (["--finger", "an1979_middle", "--protocol", "levels", "--posture", "hook"], "a name and angles in degrees"),
        (
            ["--finger", "an1979_middle", "--protocol", "levels", "--posture", "hook: MCP 0 PIP 200 DIP 50"],
            "within ±180",
        ),
        (
            ["--finger", "an1979_middle", "--protocol", "levels", "--posture", "hook: MCP 0 PIP 0 DIP 0"],
            "hook leaves the",
        ),
        (
            ["--finger", "an1979_middle", "--protocol", "levels", *2 * ["--posture", "hook: MCP 0 PIP 65 DIP 50"]],
            "--posture hook is given twice",
        ),
    ],
)
def test_what_cannot_be_planned_is_one_line(given: list[str], said: str, tmp_path: Path) -> None:
    assert said in refused("plan", "--out", tmp_path / "day", *given)
    assert not (tmp_path / "day").exists()
