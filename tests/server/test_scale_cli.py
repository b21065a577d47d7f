"""`fingertwin scale`: a finger file that stands alone, says where every number is from, and refuses other units."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from fingermodel.fingers.files import read_finger
from tests.server.command_line import Document, refused, run

HUMAN = "synek2019_initial"
# Table 3 of Synek et al. 2019, and the human lengths that the shipped bonobo was scaled from.
BONES = {"DP": 20.4, "MP": 38.1, "PP": 57.8}
REFERENCE = {"DP": 19.02, "MP": 28.83, "PP": 47.02}
ARMS = {"FDP@DIP": 3.9, "FDP@PIP": 10.4, "FDP@MCP": 12.9, "FDS@PIP": 6.6, "FDS@MCP": 13.3}


def options(option: str, values: dict[str, float]) -> list[str]:
    return [text for name, value in values.items() for text in (option, f"{name}={value}")]


@pytest.fixture(scope="module")
def scaled(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Document]:
    """The bonobo, made by the command as the shipped one is made by its script."""
    out = tmp_path_factory.mktemp("scaled") / "ape.yaml"
    given = [*options("--bone", BONES), *options("--moment-arm", ARMS), *options("--reference", REFERENCE)]
    answer = run("scale", HUMAN, *given, "--postures", "synek2019_B01", "--out", out, "--json", "-")
    return out, answer.body("scale")


def test_the_shipped_bonobo_is_what_the_command_makes(scaled: tuple[Path, Document]) -> None:
    ours, shipped = read_finger(scaled[0]), read_finger("synek2019_bonobo")
    for name in ("centre", "proximal_point", "distal_point", "load_point"):
        assert np.allclose(getattr(ours.values, name), getattr(shipped.values, name), atol=1e-9), name
    assert (ours.id, ours.prior_width) == ("ape", shipped.prior_width)


def test_the_answer_holds_lengths_and_arms_before_and_after(scaled: tuple[Path, Document]) -> None:
    body = scaled[1]
    assert {b["bone"]: b["after_mm"] for b in body["bones"]} == pytest.approx(BONES | {"MC": None})
    asked = {a["segment"]: a for a in body["moment_arms"] if a["asked_mm"] is not None}
    assert {name: a["mean_after_mm"] for name, a in asked.items()} == pytest.approx(
        {".".join(reversed(name.split("@"))): arm for name, arm in ARMS.items()}
    )
    postures = {"neutral", "minor_flexion", "major_flexion", "hyperextension", "hook"}
    assert all(set(a["before_mm"]) == set(a["after_mm"]) == postures for a in body["moment_arms"])


def test_every_number_that_was_scaled_says_so(scaled: tuple[Path, Document]) -> None:
    document = yaml.safe_load(scaled[0].read_text(encoding="utf-8"))
    assert HUMAN in document["sources"]["scaled"]
    assert "PP 57.8" in document["sources"]["scaled"]
    blocks = [*document["segments"], *document["joints"][1:], document["load_point"]]
    assert {(b["source"], b["certainty"]) for b in blocks} == {("scaled", "low")}
    assert all("x 1." in b["note"] for b in blocks)
    flexor = next(b for b in document["segments"] if (b["slip"], b["joint"]) == ("FDS", "PIP"))
    assert "mean moment arm of 6.6 mm" in flexor["note"]


@pytest.mark.parametrize("base", ["synek2019_network", "wu2008_index", "synek2019_bonobo"])
def test_elastic_hoods_inertia_and_scaled_fingers_scale_too(base: str, tmp_path: Path) -> None:
    out = tmp_path / "larger.yml"
    own = read_finger(base).phalanx_lengths_mm()
    given = options("--bone", {bone: 1.2 * length for bone, length in own.items()})
    assert "larger.yml" in run("scale", base, *given, "--out", out).out
    finger = read_finger(out)
    assert finger.phalanx_lengths_mm() == pytest.approx({bone: 1.2 * length for bone, length in own.items()})
    before, after = read_finger(base).document.get("inertia", []), finger.document.get("inertia", [])
    for was, now in zip(before, after, strict=True):
        assert now["mass_kg"] == pytest.approx(1.2**3 * was["mass_kg"])
        assert now["principal_kg_mm2"] == pytest.approx([1.2**5 * x for x in was["principal_kg_mm2"]])
        assert now["certainty"] == "assumed"


@pytest.mark.parametrize(
    ("given", "said"),
    [
        pytest.param([], "no bone length", id="nothing"),
        pytest.param(["--bone", "PP"], "--bone PP;", id="no-number"),
        pytest.param(["--bone", "PP=4o"], "--bone PP=4o", id="letter"),
        pytest.param(["--bone", "PP=nan"], "--bone PP=nan", id="nan"),
        pytest.param(["--bone", "PP=40", "--bone", "PP=41"], "given twice", id="twice"),
        pytest.param(["--bone", "XP=40"], "no such bone", id="unknown"),
        pytest.param(["--bone", "MC=60"], "does not enter the model", id="metacarpal"),
        pytest.param(["--bone", "PP=-40"], "above 0 mm", id="negative"),
        pytest.param(["--bone", "PP=0"], "above 0 mm", id="zero"),
        pytest.param(["--bone", "PP=0.0401"], "Is it in m?", id="metres"),
        pytest.param(["--bone", "PP=4.01"], "Is it in cm?", id="centimetres"),
        pytest.param(["--bone", "PP=200"], "0.3 to 3 times", id="too-long"),
        pytest.param(["--bone", "PP=40", "--reference", "DP=0.019"], "reference DP=0.019", id="reference-in-m"),
        pytest.param(["--bone", "PP=40", "--moment-arm", "FDP=10"], "TENDON@JOINT", id="arm-without-joint"),
        pytest.param(["--bone", "PP=40", "--moment-arm", "FDS@DIP=4"], "TENDON@JOINT", id="arm-not-there"),
        pytest.param(["--bone", "PP=40", "--moment-arm", "EDC@MCP=9"], "Write EDC@MCP=-9", id="arm-sign"),
        pytest.param(["--bone", "PP=40", "--moment-arm", "FDP@MCP=0.0102"], "Arms are in mm", id="arm-in-m"),
        pytest.param(["--bone", "PP=40", "--postures", "nosuch"], "nosuch", id="session"),
    ],
)
def test_what_cannot_be_used_is_one_line_and_writes_nothing(tmp_path: Path, given: list[str], said: str) -> None:
    refused("scale", HUMAN, *given, "--out", tmp_path / "x.yaml", saying=said)
    assert list(tmp_path.iterdir()) == []


def test_a_length_that_the_finger_does_not_state_is_asked_for(tmp_path: Path) -> None:
    out = tmp_path / "x.yaml"
    refused("scale", "wu2008_index", "--bone", "DP=22", "--out", out, saying="does not state", instead="--reference DP")
    assert run("scale", "wu2008_index", "--bone", "DP=22", "--reference", "DP=19.67", "--out", out).code == 0


def test_an_output_that_cannot_be_the_finger_is_refused(tmp_path: Path, scaled: tuple[Path, Document]) -> None:
    refused("scale", HUMAN, "--bone", "PP=50", "--out", tmp_path / "x.json", saying="x.json")
    refused("scale", scaled[0], "--bone", "PP=50", "--out", scaled[0], saying="is the finger that is scaled")
    refused("scale", "nosuch", "--bone", "PP=50", "--out", tmp_path / "x.yaml", saying="no finger 'nosuch'")
    (tmp_path / "file").write_text("", encoding="utf-8")
    refused("scale", HUMAN, "--bone", "PP=50", "--out", tmp_path / "file" / "x.yaml", saying="cannot be written")
