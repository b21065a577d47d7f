"""The published specimens together: what they share that no effect describes, as a user meets it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from fingermodel.effects.user import load_effect
from server.figures.shared_law import shared_sections
from tests.server.command_line import run

SPECIMENS = ("synek2019_B01", "synek2019_H01", "synek2019_H02", "synek2019_H03")


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    folder = tmp_path_factory.mktemp("shared")
    arguments = ("--permutations", "99", "--law", folder / "law.yaml", "--figures", folder / "report", "--json", "-")
    return folder, run("diagnose", *SPECIMENS, *arguments).body("diagnose")


@pytest.mark.full
def test_the_law_is_an_effect_file_that_names_its_source(told: tuple[Path, dict[str, Any]], tmp_path: Path) -> None:
    folder, body = told
    assert body["law"] == str(folder / "law.yaml")
    document = yaml.safe_load((folder / "law.yaml").read_text(encoding="utf-8"))
    assert document["source"].startswith(
        "learned from synek2019_B01, synek2019_H01, synek2019_H02, synek2019_H03: k = "
    )
    assert load_effect(folder / "law.yaml").name == document["name"]


@pytest.mark.full
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


@pytest.mark.full
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
