"""What is printed fits the terminal: every number of an answer stands whole, the answer comes before its details."""

from __future__ import annotations

import json
from typing import Any

import pytest

from daq.plain_json import clean
from fingermodel.comparing import compare
from fingermodel.session import Session
from server.cli_options import GROUPS, effects_like, sessions_like
from server.commands import console
from server.commands.additions import print_history
from server.commands.twin import print_comparison
from tests.server.command_line import run
from tests.server.conftest import WIDTHS


@pytest.fixture(scope="module")
def bench() -> Session:
    return Session.open("synek2019_H01", catalogue=False)


def numbers(value: Any) -> set[str]:
    """Every number of a part of an answer, as a table shows it; `components` are the cases times the plane's axes."""
    if isinstance(value, dict):
        return {n for key, x in value.items() if key != "components" for n in numbers(x)}
    if isinstance(value, list):
        return {n for x in value for n in numbers(x)}
    return {console.shown(value)} if isinstance(value, int | float) else set()


@pytest.mark.parametrize("wide", WIDTHS)
def test_every_number_of_a_comparison_stands_whole(
    wide: int, bench: Session, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", str(wide))
    comparison = compare(bench)
    print_comparison(bench, comparison)
    text = capsys.readouterr().out
    body = clean(comparison.as_dict())
    told: list[Any] = [body["summary"]]
    told += [[g["sagittal"], g["space"]] for key in ("by_muscle", "by_posture") for g in body[key].values()]
    told += [{k: c[k] for k in ("measured_N", "predicted_N", "residual_N", "z")} for c in body["cases"]]
    assert numbers(told) <= set(text.split())
    assert max(map(len, text.splitlines())) <= wide
    assert text.index("RMSE") < text.index(body["cases"][0]["id"])


@pytest.mark.parametrize("wide", WIDTHS)
def test_the_fall_of_the_error_loses_no_column(
    wide: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    places = ("identification/tip", "validation/tip", "identification/bone", "validation/bone")
    steps = [("an1979_middle", None, [], None), ("DEV-02-bbc5dde58db7", "an1979_middle", ["hanger_mass"], 308.0)]
    errors = dict.fromkeys(places, 0.275)
    history = [
        {"id": i, "parent": p, "added": a, "removed": [], "log_evidence_gain": e, "rmse_N": errors}
        for i, p, a, e in steps
    ]
    monkeypatch.setenv("COLUMNS", str(wide))
    print_history(history)
    text = capsys.readouterr().out
    assert max(map(len, text.splitlines())) <= wide
    assert text.split().count("0.275") == 8
    assert {"308.0", "start", "+hanger_mass", "an1979_middle", "DEV-02-bbc5dde58db7"} <= set(text.split())


def test_sentences_break_between_words_on_a_terminal_and_commands_stay_whole(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    sentence, command = "a sentence " * 12, "    fingertwin add hanger_mass DEV-02 --out " + "folder/" * 12
    monkeypatch.setenv("COLUMNS", "60")
    console.say(sentence)
    console.say(command)
    *lines, last = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 60
    assert " ".join(lines).split() == sentence.split()
    assert last == command
    monkeypatch.delenv("COLUMNS")
    console.say(json.dumps(sentence))
    assert capsys.readouterr().out.count("\n") == 1


def test_help_names_every_command_in_a_group_with_a_whole_sentence() -> None:
    asked = [run("-h"), run("--help")]
    assert asked[0] == asked[1]
    assert asked[0].code == 0
    assert all(f"\n{group}:\n" in asked[0].out for group in GROUPS)
    assert "\nCommands:\n" not in asked[0].out
    assert "..." not in asked[0].out.partition("\n\n")[2]


def test_the_shell_completes_sessions_and_effects() -> None:
    assert "DEV-02" in sessions_like("DEV")
    assert effects_like("hanger") == ["hanger_mass"]
    assert effects_like("force") == ["force_shunt"]
