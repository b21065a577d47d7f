"""`diagnose`, `add`, `effects` and `next` as their users meet them."""

from __future__ import annotations

import json
import shlex
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest
import yaml

from fingermodel.api import Diagnosis, diagnose
from fingermodel.diagnosis.verdict.changes import Amend
from fingermodel.effects.catalogue import CATALOGUE
from fingermodel.effects.user import effect_document, load_effect, shipped_effects
from fingermodel.session import Session
from server.application.refitting import refit_compared
from server.commands.additions import moved, print_history
from server.commands.diagnosis import _print_verdict, _print_ways_on
from server.figures.diagnosis_revisions import steps_of
from tests.own_effect import python_file
from tests.server.command_line import H01, altered, refused, run
from tests.server.diagnosis_answers import found as missing_effect
from tests.simulator import draw_session

KEYS = {
    "verdict", "effects", "probability", "confirmed", "robustness", "ranking", "inclusion", "where", "hints",
    "before", "after", "next_cases", "seconds", "suspects", "session_faults", "repeatability", "beyond",
    "budget_multiple", "noise_multiple", "extra_noise_N", "predictive_check", "probability_of", "size",
}  # fmt: skip


@pytest.fixture(autouse=True, scope="module")
def _each_session_is_diagnosed_once() -> Iterator[None]:
    """`next` plans from the diagnosis that `diagnose` shows: the same readings under the same model give the same."""
    known: dict[tuple[str, str, bytes], Diagnosis] = {}

    def once(session: Session, **options: Any) -> Diagnosis:
        observed = session.observations
        said = repr((session.model.structure, session.loaded.added, observed.ids, observed.roles, options["thorough"]))
        key = (session.measured.session.id, said, observed.wrench.tobytes() + session.theta.tobytes())
        if key not in known:
            known[key] = diagnose(session, **options)
        return known[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("server.application.diagnosing.diagnose", once)
        yield


@pytest.fixture(scope="module")
def added(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    path = tmp_path_factory.mktemp("models") / "hanger.json"
    body = run("add", "hanger_mass", "DEV-02", "--out", path, "--json", "-").body("add")
    return path, body


@pytest.mark.parametrize(
    ("gain", "said"), [(12.34, "rises by 12.3"), (-0.2, "falls by 0.2"), (0.0, "rises by 0.0"), (-0.04, "rises by 0.0")]
)
def test_evidence_that_sinks_is_said_to_fall(gain: float, said: str) -> None:
    assert moved(gain) == said


def test_diagnose_answers_as_agreed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    body = run("diagnose", "DEV-02", "--figures", tmp_path / "report", "--json", "-").body("diagnose")
    assert body.keys() >= KEYS
    assert (body["verdict"], body["effects"]) == ("found", ["hanger_mass"])
    assert body["probability"] >= 0.9
    assert {"flips_when", "budget_multiple_at_which_it_fails", "sagittal_alone"} <= body["robustness"].keys()
    first = body["ranking"][0]
    assert first["effects"] == ["hanger_mass"]
    assert first["validation_rmse_N"]["after"] < 0.7 * first["validation_rmse_N"]["before"]
    (parameter,) = first["parameters"]
    assert (parameter["name"], parameter["unit"]) == ("hanger_mass.m0", "g")
    assert any(row["effects"] == [] for row in body["ranking"])
    assert {"by_muscle", "by_posture", "by_location", "by_component", "joint_torque_Nmm"} <= body["where"].keys()
    assert body["next_cases"][0].keys() >= {"posture", "location", "masses_g", "information_nat", "separates"}
    assert body["robustness"]["assumptions"][0].keys() == {"group", "words", "probability"}
    assert body["size"]["curves"][0].keys() >= {
        "posture",
        "location",
        "muscle",
        "load_g",
        "change_N",
        "low_N",
        "high_N",
    }
    assert not {"calibration", "false_finding_rate"} & body.keys()
    assert (tmp_path / "report" / "diagnose.html").stat().st_size > 100_000
    assert {p.stem for p in (tmp_path / "report").glob("*.png")} >= {"sensitivity", "size", "ranking"}


def test_diagnose_prints_the_verdict_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    answer = run("diagnose", "DEV-01")
    assert (answer.code, answer.err) == (0, "")
    lines = answer.out.splitlines()
    assert lines[0].startswith("Nothing is missing")
    assert lines[1].strip().startswith("Probability 0.9")
    assert lines[1].endswith(": no effect acts, and nothing unknown.")
    assert "validation RMSE [N]" in answer.out


def test_suspects_are_named_above_the_reasons(capsys: pytest.CaptureFixture[str]) -> None:
    body = missing_effect() | {"reasons": ["It explains the readings."]}
    _print_verdict(body)
    lines = [line.strip() for line in capsys.readouterr().out.splitlines()]
    assert lines[2] == "Suspect load case: c056 (0.99; reads like FDS hung, not FDP)."
    assert lines.index("It explains the readings.") > 2
    assert lines[3] == "The whole session: the finger is mirrored (probability 0.03)."
    assert any(line.startswith("Predictive check on the validation cases: p = 1e-09") for line in lines)


def test_the_commands_to_go_on_with_name_the_session_as_it_was_given(capsys: pytest.CaptureFixture[str]) -> None:
    amend = [asdict(Amend("all", tendons={"FDP": "FDS", "FDS": "FDP"}))]
    fault = {"words": "FDP and FDS were exchanged", "probability": 0.98, "amend": amend}
    hint = {"text": "a torque at the PIP", "effect": {"formula": "torque[PIP] += k"}}
    body = missing_effect() | {"session_faults": [fault], "hints": [hint], "ready_made": []}
    _print_ways_on(body, "'my bench/S1'")
    commands = [line.strip() for line in capsys.readouterr().out.splitlines() if "  fingertwin " in line]
    assert len(commands) == 2
    assert [shlex.split(command)[i] for command, i in zip(commands, (2, 3), strict=True)] == ["my bench/S1"] * 2


def test_adding_writes_a_revision_that_compares(added: tuple[Path, dict[str, Any]]) -> None:
    path, body = added
    assert body["added"] == ["hanger_mass"]
    assert body["log_evidence_gain"] > 100.0
    start, alone, step = body["history"]
    assert alone["id"] is None
    assert step["rmse_N"]["validation/tip"] < 0.2 * start["rmse_N"]["validation/tip"]
    compared = run("compare", "DEV-02", "--model", path, "--json", "-").body("compare")
    assert compared["summary"]["validation/tip"]["space"]["rmse_N"] == pytest.approx(step["rmse_N"]["validation/tip"])


def test_the_fall_of_the_error_shows_what_a_refit_alone_reaches(
    added: tuple[Path, dict[str, Any]], capsys: pytest.CaptureFixture[str]
) -> None:
    _, body = added
    plain = refit_compared(Session.open("DEV-02"))[2].summary()
    places = list(plain)
    assert [body["refitted_alone"][p]["space"]["rmse_N"] for p in places] == pytest.approx(
        [plain[p]["space"]["rmse_N"] for p in places]
    )
    start, alone, step = (h["rmse_N"]["validation/tip"] for h in body["history"])
    assert start > 3.0 * alone > step
    assert [s.lines[0] for s in steps_of({}, body["history"])] == ["start", "refit", "+ hanger mass"]
    print_history(body["history"])
    told = [line.split()[0] for line in capsys.readouterr().out.splitlines() if line.startswith("  ")]
    assert told[-3:] == ["start", "refit", "+hanger_mass"]


def test_what_was_added_is_held_and_can_be_taken_out(added: tuple[Path, dict[str, Any]], tmp_path: Path) -> None:
    path, _ = added
    held = run("diagnose", "DEV-02", "--model", path, "--json", "-").body("diagnose")
    assert held["held"] == ["hanger_mass.m0"]
    assert held["verdict"] == "nothing_missing"
    out = tmp_path / "without.json"
    body = run("add", "DEV-02", "--without", "hanger_mass", "--model", path, "--out", out, "--json", "-").body("add")
    assert [s["added"] for s in body["history"]] == [[], [], ["hanger_mass"], []]
    assert (body["removed"], body["log_evidence_gain"]) == (["hanger_mass"], None)
    last, before = body["history"][-1]["rmse_N"], body["history"][-2]["rmse_N"]
    assert last["validation/tip"] > 1.5 * before["validation/tip"]
    assert json.loads(out.read_text(encoding="utf-8"))["effects"] == []


def test_nothing_is_kept_of_any_session_where_one_cannot_be_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    answer = run("add", "hanger_mass", "DEV-02", "--shared", "DEV-99")
    assert answer.code == 2
    assert "no session at DEV-99" in answer.err
    assert not list(tmp_path.rglob("*.json"))


def test_the_catalogue_is_shown_whole() -> None:
    body = run("effects", "--json", "-").body("effects")
    assert [effect["name"] for effect in body["effects"]] == [effect.name for effect in CATALOGUE]
    for effect in body["effects"]:
        assert all(effect[key] for key in ("name", "stage", "title", "formula", "source", "tell", "parameters"))
    assert "capstan" in run("effects", "sheath_friction").out.lower() or "exp(" in run("effects", "sheath_friction").out


def test_every_effect_that_can_be_added_can_be_looked_up(tmp_path: Path) -> None:
    listed = run("effects").out
    ready_made = run("effects", "--json", "-").body("effects")["ready_made"]
    assert {effect["name"] for effect in ready_made} == set(shipped_effects())
    for effect in ready_made:
        assert effect["name"] in listed
        assert run("effects", effect["name"], "--json", "-").body("effects")["effects"] == [effect]
        assert all(parameter["name"] in run("effects", effect["name"]).out for parameter in effect["parameters"])
    file = tmp_path / "mine.yaml"
    file.write_text(
        "format: fingertwin-effect/1\nname: mine\ntitle: own\nsource: own\n"
        "formula: torque[PIP] += k * t_EDC\nparameters:\n  k: {unit: mm, range: [0, 5]}\n",
        encoding="utf-8",
    )
    assert "mine.k" in run("effects", file).out
    assert "torque[PIP] += k * t_EDC" in run("effects", "torque[PIP] += k * t_EDC").out
    assert "no effect file" in run("effects", tmp_path / "nowhere.yaml").err


def test_next_ranks_cases_and_freezes_them(tmp_path: Path) -> None:
    out = tmp_path / "frozen.json"
    body = run("next", "DEV-02", "--freeze", "--out", out, "--json", "-").body("next")
    assert body["frozen"] == str(out)
    assert body["next_cases"]
    frozen = json.loads(out.read_text(encoding="utf-8"))
    assert frozen["format"] == "fingertwin-frozen/1"
    assert set(frozen["explanations"]) == {"hanger_mass", "nothing missing"}


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("diagnose", "DEV-99"), "DEV-99"),
        (("diagnose", "DEV-01", "DEV-01"), "given twice"),
        (("diagnose", "DEV-01", "--effect", "nowhere.yaml"), "nowhere.yaml"),
        (("add", "DEV-01"), "effects and then a session"),
        (("add", "hangermass", "DEV-01"), "no effect 'hangermass'"),
        (("add", "DEV-01", "hanger_mass"), "fingertwin add hanger_mass DEV-01"),
        (("add", "torque[PIP] += k * sqrt(t_EDC) * t_EDC", "DEV-01"), "torque[PIP]"),
        (("add", "torque[WRIST] += k * t_EDC", "DEV-01"), "WRIST"),
        (
            ("add", "DEV-01", "--without", "hanger_mass"),
            "to take out; expected a model with an effect: this one has none.",
        ),
        (("effects", "hangermass"), "Did you mean hanger_mass?"),
        (("effects", "force_shnt"), "Did you mean force_shunt?"),
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
    assert not list(tmp_path.iterdir())


def test_two_sessions_of_one_id_are_not_told_apart(tmp_path: Path) -> None:
    refused("diagnose", H01, altered(tmp_path, lambda d: None), saying=f"two sessions are called {H01}")


def called(name: str, specimen: str | None = None) -> Callable[[dict[str, Any]], None]:
    """Give a session another id, and another specimen where one is given."""

    def edit(document: dict[str, Any]) -> None:
        document["id"] = name
        document["specimen"]["id"] = specimen or document["specimen"]["id"]

    return edit


def test_one_recording_under_two_names_is_not_counted_twice(tmp_path: Path) -> None:
    copy = altered(tmp_path, called("AGAIN", "ANOTHER"))
    file = copy / "session.yaml"
    # One case less makes it no other recording.
    document = yaml.safe_load(file.read_text(encoding="utf-8"))
    del document["cases"][0]
    file.write_text(yaml.safe_dump(document), encoding="utf-8")
    refused("diagnose", H01, copy, saying=f"{H01} and AGAIN hold the same forces")


def test_an_average_is_no_specimen_beside_its_members() -> None:
    refused("diagnose", H01, "synek2019_B01", "synek2019_HMEAN", saying=f"synek2019_HMEAN is the average of {H01}")


@pytest.mark.full
def test_sessions_of_one_specimen_are_told_apart_from_specimens_above_the_verdict(tmp_path: Path) -> None:
    again = altered(tmp_path, called("AGAIN", "H01"), "synek2019_H03")
    out = run("diagnose", H01, again, "--permutations", "0").out
    warned = f"Warning: {H01}, AGAIN: sessions of one specimen, H01"
    assert out.index(warned) < out.index("Undecided")
    assert "No law that specimens share is looked for" in out


@pytest.mark.full
def test_a_finding_is_confirmed_by_what_it_said_of_a_case_not_yet_measured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    hidden = {"hanger_mass": 40.0}
    draw_session(tmp_path / "first", 31, hidden, nuisance_scale=0.8)
    frozen = tmp_path / "frozen.json"
    plan = run("next", "first", "--freeze", "--out", frozen, "--json", "-").body("next")
    assert plan["next_cases"]
    further = [(c["posture"], c["location"], c["masses_g"]) for c in plan["next_cases"]]
    draw_session(tmp_path / "second", 31, hidden, nuisance_scale=0.8, further=further)
    later = run("diagnose", "second", "--frozen", frozen, "--json", "-").body("diagnose")
    assert (later["verdict"], later["effects"], later["confirmed"]) == ("found", ["hanger_mass"], True)


def test_a_model_with_an_effect_from_a_python_file_asks_for_the_file(
    added: tuple[Path, dict[str, Any]], tmp_path: Path
) -> None:
    own = python_file(tmp_path)
    revision = json.loads(added[0].read_text(encoding="utf-8"))
    document = effect_document(load_effect(own))
    assert document["file"] == "mine.py"
    revision["effects"].append({"name": "mine", "parameters": ["mine.k"], "document": document})
    model = tmp_path / "model.json"
    model.write_text(json.dumps(revision), encoding="utf-8")
    without = run("compare", "DEV-02", "--model", model)
    assert without.code == 2
    assert "Give it with --effect mine.py" in without.err
    given = run("compare", "DEV-02", "--model", model, "--effect", own, "--json", "-").body("compare")
    assert given["summary"] == run("compare", "DEV-02", "--model", added[0], "--json", "-").body("compare")["summary"]
    python_file(tmp_path, ('"mm", 5.0', '"mm", 6.0'))
    other = run("compare", "DEV-02", "--model", model, "--effect", own)
    assert other.code == 2
    assert "another version of its file" in other.err
