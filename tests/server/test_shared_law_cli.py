"""The published specimens together: what they share that no effect describes, as a user meets it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from fingermodel.effects.user import load_effect
from server.figures.shared_law import law_figure, shared_sections
from tests.server.command_line import run

SPECIMENS = ("synek2019_B01", "synek2019_H01", "synek2019_H02", "synek2019_H03")


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    folder = tmp_path_factory.mktemp("shared")
    arguments = ("--permutations", "99", "--law", folder / "law.yaml", "--figures", folder / "report", "--json", "-")
    return folder, run("diagnose", *SPECIMENS, *arguments).body("diagnose")


def test_the_published_specimens_share_an_error_of_moment_arms(told: tuple[Path, dict[str, Any]]) -> None:
    shared = told[1]["shared"]
    assert shared.keys() >= {"log_evidence_over_own", "permutation_p", "left_out_gain", "carried_by", "laws"}
    assert shared["stage"] == "arms"
    assert shared["log_evidence_over_own"] > 3.0
    assert shared["permutation_p"] <= 0.02
    # H02 has two fits about equally good: which one a machine's rounding prefers decides whether it gains.
    gains = shared["left_out_gain"]
    assert sum(gains.values()) > 9.0
    assert all(gain > 0.0 for specimen, gain in gains.items() if specimen != "synek2019_H02")
    assert {(c["muscle"], c["joint"]) for c in shared["carried_by"][:2]} == {("RI", "PIP"), ("FDS", "PIP")}


def test_its_law_lowers_the_tip_error_of_specimens_that_it_was_not_learned_from(
    told: tuple[Path, dict[str, Any]],
) -> None:
    law = told[1]["shared"]["laws"][0]
    assert law["formula"] == "torque[PIP] += k * t_FDS * q_MCP"
    assert "torque[PIP] += k * t_FDS * sin(q_MCP)" in law["rivals"]
    assert all(gain > 0.0 for gain in law["left_out_gain"].values())
    falls = [e["tip"]["after"] < e["tip"]["before"] for e in law["unseen_rmse_N"].values()]
    assert sum(falls) >= 3
    # The bone loads are another matter, and it says so.
    assert any(e["bone"]["after"] > e["bone"]["before"] for e in law["unseen_rmse_N"].values())
    assert law["agreement"] < 2.0


def test_its_law_is_drawn_as_these_readings_would_show_it(told: tuple[Path, dict[str, Any]]) -> None:
    curve, law = told[1]["shared"]["curves"][0], told[1]["shared"]["laws"][0]
    shown = {(p["muscle"], p["joint"]): np.array(y) for p, y in zip(curve["parts"], law["curve"], strict=True)}
    sizes = {part: float(np.linalg.norm(y)) for part, y in shown.items()}
    assert max(sizes, key=lambda part: sizes[part]) == ("FDS", "PIP")
    said = law["value"] * np.deg2rad([p["MCP"] for p in curve["postures_deg"]])
    assert np.corrcoef(shown["FDS", "PIP"], said)[0, 1] > 0.9
    assert sizes["FDS", "PIP"] < np.linalg.norm(said), "smoothing takes some of it"
    figure = law_figure(told[1])
    assert law["formula"] in figure.layout.title.text
    assert sum(t.name == "the law" for t in figure.data) == len(curve["parts"])


def test_it_says_what_would_decide(told: tuple[Path, dict[str, Any]]) -> None:
    found = told[1]["shared"]["would_decide"]
    assert found["on"] in SPECIMENS
    assert found["readings"]
    assert found["between"][0] == told[1]["shared"]["laws"][0]["formula"]
    gains = [r["information_nat"] for r in found["readings"]]
    assert gains == sorted(gains, reverse=True)
    assert all("FDS" in r["masses_g"] for r in found["readings"][:2])


def test_the_law_is_an_effect_file_that_names_its_source(told: tuple[Path, dict[str, Any]], tmp_path: Path) -> None:
    folder, body = told
    assert body["law"] == str(folder / "law.yaml")
    document = yaml.safe_load((folder / "law.yaml").read_text(encoding="utf-8"))
    assert document["source"].startswith(
        "learned from synek2019_B01, synek2019_H01, synek2019_H02, synek2019_H03: k = "
    )
    assert load_effect(folder / "law.yaml").name == document["name"]


def test_add_puts_it_into_each_session(
    told: tuple[Path, dict[str, Any]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    law = str(told[0] / "law.yaml")
    body = run("add", law, "synek2019_H02", "--shared", "synek2019_H03", "--json", "-").body("add")
    assert set(body["sessions"]) == {"synek2019_H02", "synek2019_H03"}
    for name, one in body["sessions"].items():
        assert Path(one["model"]).is_file()
        assert name in one["model"]
        (k,) = [p for p in one["parameters"] if p["name"].startswith("shared_")]
        assert k["value"] < 0.0


def test_the_report_shows_curve_chance_and_laws(told: tuple[Path, dict[str, Any]]) -> None:
    folder, body = told
    page = folder / "report" / "shared.html"
    assert str(page) in body["figures"]
    text = page.read_text(encoding="utf-8")
    for words in (
        "Beyond the catalogue",
        "What the sessions share",
        "Would chance do as well?",
        "gain [nat]",
        "<td>synek2019_H01",
    ):
        assert words in text
    assert {p.stem for p in page.parent.glob("*.png")} == {"shared_curve", "shared_chance", "shared_law"}


def test_its_warnings_stand_above_the_verdict() -> None:
    warning = {"level": "warning", "code": "one_specimen", "place": "A1, A2", "words": "sessions of one specimen, A"}
    first = shared_sections({"sentence": "Undecided.", "warnings": [warning]})[0]
    assert first.parts[:2] == ["Warning: A1, A2: sessions of one specimen, A", "Undecided."]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("diagnose", "DEV-01", "--law", "law.yaml"), "several sessions"),
        (("diagnose", "DEV-01", "DEV-02", "--permutations", "-1"), "--permutations -1"),
        (("add", "hanger_mass", "DEV-02", "--shared", "DEV-02"), "given twice"),
        (("add", "hanger_mass", "DEV-02", "--shared", "DEV-01", "--out", "m.json"), "neither"),
    ],
)
def test_bad_input_is_one_clear_line(
    arguments: tuple[str, ...], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    answer = run(*arguments)
    assert answer.code == 2
    assert said in answer.err
    assert len(answer.err.strip().splitlines()) == 1
