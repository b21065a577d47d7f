"""The command line as its users meet it: exit codes, one clear line for bad input, JSON answers, files left behind."""

from __future__ import annotations

import contextlib
import csv
import errno
import gzip
import io
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml

from daq.locations import data_dir
from daq.sessions import session_names
from server import cli

Document = dict[str, Any]
Edit = Callable[[Document], object]
H01, HMEAN, RAW = "synek2019_H01", "synek2019_HMEAN", "DEV-08"
SPECIMENS = ("synek2019_H01", "synek2019_H02", "synek2019_H03", "synek2019_B01")
COMMANDS = ("check", "friction", "compare", "refit", "reproduce", "export", "simulate", "demo")
CASE = {
    "id", "role", "posture", "location", "masses_g", "measured_N", "measured_sd_N", "predicted_N", "residual_N",
    "measured_Nmm", "predicted_Nmm", "z", "z_sagittal",
}  # fmt: skip
ERRORS = {
    "cases", "components", "rmse_N", "rmse_rel_pct", "magnitude_error_N", "magnitude_error_pct",
    "direction_error_deg", "direction_cases",
}  # fmt: skip


class Answer(NamedTuple):
    code: int
    out: str
    err: str

    def body(self, command: str) -> Document:
        """The JSON on standard output, which holds nothing else, names its schema and has no NaN."""
        assert (self.code, self.err) == (0, "")
        return strict(self.out, command)


def strict(text: str, command: str) -> Document:
    def refuse(word: str) -> NoReturn:
        pytest.fail(f"{word} is not JSON")

    body: Document = json.loads(text, parse_constant=refuse)
    assert body["schema"] == f"fingertwin/{command}/1"
    return body


def numbers(summary: Document) -> dict[str, float]:
    """Every number of a summary by its path."""
    return {
        f"{name} {plane} {key}": value
        for name, planes in summary.items()
        for plane, errors in planes.items()
        for key, value in errors.items()
        if value is not None
    }


def run(*arguments: object) -> Answer:
    """Run the command line in this process."""
    out, err = io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        patch.setattr(sys, "argv", ["fingertwin", *map(str, arguments)])
        with pytest.raises(SystemExit) as left:
            cli.main()
    assert isinstance(left.value.code, int)
    return Answer(left.value.code, out.getvalue(), err.getvalue())


def started(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Run the command line as a user does, in its own process with its output in pipes."""
    command = [sys.executable, "-m", "server.cli", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)  # noqa: S603


def refused(*arguments: object, saying: str = "", instead: str = "expected") -> str:
    """Exit 2, nothing on standard output, one line on stderr that says what was found and what was expected."""
    answer = run(*arguments)
    assert (answer.code, answer.out) == (2, ""), answer
    assert answer.err.startswith("fingertwin: ")
    assert answer.err.count("\n") == 1
    assert saying in answer.err
    assert instead in answer.err
    return answer.err


def altered(folder: Path, edit: Edit, source: str = H01) -> Path:
    """A copy of a shipped session with its description changed."""
    session = folder / "altered"
    shutil.copytree(data_dir() / "sessions" / source, session)
    file = session / "session.yaml"
    document = yaml.safe_load(file.read_text(encoding="utf-8"))
    edit(document)
    file.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
    return session


def with_readings(folder: Path, edit: Callable[[str], str]) -> Path:
    """A copy of a recorded session with its readings changed."""
    session = altered(folder, lambda d: None, RAW)
    file = session / "readings.csv.gz"
    file.write_bytes(gzip.compress(edit(gzip.decompress(file.read_bytes()).decode()).encode(), 1))
    return session


def keys(**values: Any) -> Edit:
    return lambda document: document.update(values)


def first_case(**values: Any) -> Edit:
    return lambda document: document["cases"][0].update(values)


def every_case(change: Callable[[Document], object]) -> Edit:
    return lambda document: [change(case) for case in document["cases"]]


def kept(condition: Callable[[Document], bool]) -> Edit:
    return lambda document: document.update(cases=[c for c in document["cases"] if condition(c)])


@pytest.fixture(scope="module")
def compared() -> Document:
    return run("compare", H01, "--json", "-").body("compare")


@pytest.fixture(scope="module")
def revision(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Document]:
    path = tmp_path_factory.mktemp("revision") / "new" / "H01-r1.json"
    return path, run("refit", H01, "--out", path, "--json", "-").body("refit")


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("simulated") / "rig"
    body = run("simulate", "synek2019", "--out", folder, "--rate-hz", 20, "--seed", 3, "--json", "-").body("simulate")
    assert body["cases"] == 40
    return folder


# Help, version and arguments


@pytest.mark.parametrize(
    ("command", "options"),
    [
        ("check", "--json"),
        ("friction", "--json"),
        ("compare", "--model --figures --json"),
        ("refit", "--method --model --out --plane --figures --json"),
        ("reproduce", "--figures --json"),
        ("export", "--format --out --model --json"),
        ("simulate", "--out --model --rate-hz --noise-N --repeats --seed --json"),
        ("demo", "--out"),
    ],
)
def test_help_of_a_command_lists_its_options(command: str, options: str) -> None:
    answer = run(command, "--help")
    assert (answer.code, answer.err) == (0, "")
    assert [o for o in options.split() if o not in answer.out] == []


def test_help_lists_the_commands_and_is_what_no_argument_gives() -> None:
    answer = run("--help")
    assert [c for c in COMMANDS if f"\n  {c} " not in answer.out] == []
    assert run() == answer


def test_version() -> None:
    answer = started("--version")
    assert (answer.returncode, answer.stderr) == (0, "")
    assert answer.stdout.split()[0] == "fingertwin"


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["comapre", H01], "comapre"),
        (["compare"], "session"),
        (["friction"], "sessions"),
        (["compare", H01, H01], H01),
        (["compare", H01, "--modle", "x"], "--modle"),
        (["compare", H01, "--model"], "--model"),
        (["refit", H01, "--method", "simplex"], "'map', 'slsqp'"),
        (["refit", H01, "--plane", "coronal"], "'sagittal', 'space'"),
        (["export", H01, "--format", "docx"], "'csv', 'parquet'"),
        (["simulate", "synek2019"], "--out"),
        (["simulate", "synek2019", "--out", "x", "--repeats", "many"], "--repeats"),
    ],
)
def test_an_argument_that_is_wrong_is_named(arguments: list[str], named: str) -> None:
    line = refused(*arguments, saying=named, instead="Try 'fingertwin --help'.")
    assert "Value error" not in line


@pytest.mark.parametrize("command", ["compare", "refit", "friction", "export", "check"])
@pytest.mark.parametrize(
    ("session", "said"),
    [
        ("synek2019_H04", "Did you mean synek2019_H0"),
        ("no/such/folder", "no/such/folder"),
        ("", "session"),
        ("x" * 5000, "xxx"),
        ("nul\0byte", "nul"),
    ],
)
def test_a_session_that_is_not_there(command: str, session: str, said: str) -> None:
    if command != "check":
        refused(command, session, saying=said, instead="")
        return
    answer = run("check", session)
    assert answer.code == 2
    assert said in answer.out + answer.err


def test_a_folder_or_file_that_is_no_session(tmp_path: Path) -> None:
    refused("compare", tmp_path, saying="session.yaml")
    refused("compare", data_dir() / "sessions" / RAW / "readings.csv.gz", saying="no session's description")
    other = tmp_path / "notes.txt"
    other.write_text("just words", encoding="utf-8")
    refused("compare", other, saying="notes.txt")


@pytest.mark.parametrize(
    "text",
    ["a: [", "a: 1\na: 2", "? [a]\n: 1", "day: 2020-13-45", "!!python/object:os.system x", "a\0b: 1", "", "[]", "3"],
)
def test_a_description_that_is_no_yaml(tmp_path: Path, text: str) -> None:
    file = tmp_path / "session.yaml"
    file.write_text(text, encoding="utf-8")
    refused("compare", tmp_path, saying="session.yaml")
    assert run("check", tmp_path).code == 2


def test_a_session_is_found_by_name_by_folder_and_by_file(compared: Document) -> None:
    folder = data_dir() / "sessions" / H01
    for path in (folder, folder / "session.yaml"):
        assert run("compare", path, "--json", "-").body("compare") == compared


def test_a_study_or_protocol_that_is_not_there(tmp_path: Path) -> None:
    refused("reproduce", "einstein1905", saying="einstein1905")
    refused("simulate", "einstein1905", "--out", tmp_path / "s", saying="levels, synek2019")
    assert not (tmp_path / "s").exists()


@pytest.mark.parametrize("model", ["nosuch", "nosuch.json", "", ".", "nul\0"])
def test_a_model_that_is_not_there(model: str) -> None:
    refused("compare", H01, "--model", model)
    refused("refit", H01, "--model", model)


def test_a_model_that_is_none(tmp_path: Path) -> None:
    own = tmp_path / "answer.json"
    assert run("compare", H01, "--json", own).code == 0
    refused("compare", H01, "--model", own, saying="answer.json")
    refused("compare", H01, "--model", data_dir() / "sessions" / H01 / "session.yaml", saying="finger/1")
    refused("compare", H01, "--model", data_dir() / "sessions" / RAW / "readings.csv.gz", saying="not text")
    for text in ("{", "[]", "null", '{"format": "fingertwin-model/1"}'):
        own.write_text(text, encoding="utf-8")
        refused("compare", H01, "--model", own, saying="answer.json")


# Where answers go


def test_json_beside_the_table(tmp_path: Path, compared: Document) -> None:
    file = tmp_path / "new" / "answer.json"
    answer = run("compare", H01, "--json", file)
    assert (answer.code, answer.err) == (0, "")
    assert "RMSE" in answer.out
    assert strict(file.read_text(encoding="utf-8"), "compare") == compared
    assert [p.name for p in file.parent.iterdir()] == ["answer.json"]


@pytest.mark.parametrize("arguments", [["compare", H01], ["friction", H01], ["check", H01]])
@pytest.mark.parametrize("where", ["", "folder", "file/answer.json"])
def test_an_answer_that_cannot_be_written(tmp_path: Path, arguments: list[str], where: str) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").touch()
    answer = run(*arguments, "--json", tmp_path / where if where else "")
    assert (answer.code, answer.out, answer.err.count("\n")) == (2, "", 1)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "folder"]
    assert list((tmp_path / "folder").iterdir()) == []


def full_disk(*_: object) -> NoReturn:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@pytest.mark.parametrize(
    "arguments",
    [
        ["compare", H01, "--json"],
        ["export", H01, "--out"],
        ["export", H01, "--format", "parquet", "--out"],
        ["refit", H01, "--out"],
        ["compare", H01, "--figures"],
        ["simulate", "synek2019", "--rate-hz", "20", "--out"],
    ],
)
def test_a_full_disk_leaves_nothing_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str]
) -> None:
    monkeypatch.setattr("daq.files.os.fsync", full_disk)
    answer = run(*arguments, tmp_path / "out")
    assert (answer.code, answer.out, answer.err.count("\n")) == (2, "", 1)
    assert os.strerror(errno.ENOSPC) in answer.err
    assert [p for p in tmp_path.rglob("*") if p.is_file()] == []


@pytest.mark.parametrize(
    "arguments",
    [["export", H01, "--out"], ["refit", H01, "--out"], ["compare", H01, "--figures"], ["simulate", "levels", "--out"]],
)
def test_an_output_below_a_file(tmp_path: Path, arguments: list[str]) -> None:
    (tmp_path / "file").touch()
    refused(*arguments, tmp_path / "file" / "out", saying="file", instead="")


@pytest.mark.parametrize("command", ["export", "refit"])
@pytest.mark.parametrize("where", ["", "folder"])
def test_an_output_that_is_a_folder_is_named(tmp_path: Path, command: str, where: str) -> None:
    (tmp_path / "folder").mkdir()
    line = refused(command, H01, "--out", tmp_path / where if where else "", saying=where, instead="")
    assert ".tmp" not in line
    assert list((tmp_path / "folder").iterdir()) == []


def test_an_interrupt_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*_: object, **__: object) -> NoReturn:
        raise KeyboardInterrupt

    monkeypatch.setattr("server.commands.twin.open_bench", interrupt)
    answer = run("refit", H01)
    assert (answer.code, answer.out, answer.err.count("\n")) == (130, "", 1)
    assert answer.err.startswith("fingertwin: Interrupted")


def test_a_pipe_gets_no_progress_bar_and_no_escape_codes(tmp_path: Path) -> None:
    answer = started("compare", RAW)
    assert (answer.returncode, answer.stderr) == (0, "")
    assert "\x1b" not in answer.stdout
    assert "RMSE" in answer.stdout


def test_an_output_that_lacks_a_letter_shows_a_mark(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONIOENCODING", "ascii")
    answer = started("check", altered(tmp_path, keys(id="Größe", finger="Fünfter")))
    assert (answer.returncode, answer.stderr) == (2, "")
    assert "F?nfter" in answer.stdout


def test_bad_input_in_its_own_process_has_no_traceback() -> None:
    answer = started("compare", "nosuch")
    assert (answer.returncode, answer.stdout, answer.stderr.count("\n")) == (2, "", 1)


# check


@pytest.mark.parametrize("session", session_names())
def test_every_shipped_session_is_usable(session: str) -> None:
    body = run("check", session, "--json", "-").body("check")
    assert (body["ok"], body["errors"], body["session"]) == (True, 0, session)
    assert all(set(f) == {"level", "code", "where", "text"} for f in body["findings"])


def checked(session: Path) -> tuple[int, set[tuple[str, str]]]:
    answer = run("check", session, "--json", "-")
    assert answer.err == ""
    return answer.code, {(f["level"], f["code"]) for f in strict(answer.out, "check")["findings"]}


@pytest.mark.parametrize(
    "edit",
    [
        first_case(force_sd_N=0),
        first_case(force_N=[float("nan"), 0, 0]),
        first_case(force_N=[1, 2]),
        first_case(masses_g={"FPL": 100}),
        first_case(masses_g={"FDP": -1}),
        first_case(masses_g={"FDP": 1e300}),
        first_case(role="guess"),
        first_case(posture="fist"),
        first_case(location="elbow"),
        first_case(loaded_s=[1, 2]),
        keys(format="bench-session/9"),
        keys(cases=[]),
        keys(finger="nosuch"),
        keys(readings="../elsewhere.csv"),
        keys(readings="absent.csv"),
        keys(tension_factor=-1),
        keys(budget=["a"]),
        lambda d: d["specimen"].update(donor_name="Jane Doe"),
        lambda d: d["postures_deg"]["hook"].update(PIP="bent"),
        lambda d: d["postures_deg"]["hook"].update(PIP=6500),
        lambda d: d.pop("specimen"),
    ],
)
def test_a_description_that_cannot_be_used_fails_check_and_compare(tmp_path: Path, edit: Edit) -> None:
    session = altered(tmp_path, edit)
    code, found = checked(session)
    assert code == 2
    assert "error" in {level for level, _ in found}
    refused("compare", session)
    assert run("check", session).code == 2


def test_a_name_under_specimen_is_refused(tmp_path: Path) -> None:
    session = altered(tmp_path, lambda d: d["specimen"].update(donor_name="Jane Doe"))
    line = refused("refit", session, saying="donor_name")
    assert "Jane" not in line


def test_masses_in_kilograms_are_refused(tmp_path: Path) -> None:
    kilograms = every_case(lambda c: c.update(masses_g={k: m / 1000 for k, m in c["masses_g"].items()}))
    code, found = checked(altered(tmp_path, kilograms))
    assert code == 2
    assert ("error", "session") in found


@pytest.mark.parametrize(
    ("budget", "said"),
    [
        ("generous", "generous"),
        ({"base": "generous"}, "generous"),
        ({"angle_sd_deg": -1}, "angle_sd_deg"),
        ({"angle_sd_deg": "wide"}, "angle_sd_deg"),
        ({"angle_sd": 1}, "angle_sd"),
        ({"tendon_point_sd_mm": 2}, "tendon_point_sd_mm"),
        ({"tendon_point_sd_mm": {}}, "tendon_point_sd_mm"),
        ({"tendon_point_sd_mm": {"wrist": 1}}, "wrist"),
    ],
)
def test_a_budget_that_is_unknown_or_negative(tmp_path: Path, budget: Any, said: str) -> None:
    session = altered(tmp_path, keys(budget=budget))
    refused("compare", session, saying=said)


@pytest.mark.parametrize(
    "edit",
    [
        keys(budget="generous"),
        lambda d: d["postures_deg"]["hook"].update(PIP=0, DIP=0),
        every_case(lambda c: c.update(excluded="all of them")),
        lambda d: d["postures_deg"]["hook"].update(wrist=10),
    ],
)
def test_what_compare_refuses_is_not_usable_to_check(tmp_path: Path, edit: Edit) -> None:
    session = altered(tmp_path, edit)
    refused("compare", session)
    refused("refit", session)
    assert run("check", session).code == 2


@pytest.mark.parametrize(
    ("edit", "said"),
    [
        (lambda t: "\n".join([*t.split("\n")[:50], "2.4" + 6 * ",nan", *t.split("\n")[51:]]), "nan"),
        (lambda t: t[: len(t) // 2], "cut off"),
        (lambda t: t[: t.index("\n", len(t) // 2) + 1], "outside the recording"),
        (lambda t: t[: t.index("\n") + 1], "no readings"),
        (lambda t: "", "header"),
        (lambda t: t.replace("Fx_N", "Fx", 1), "Fx"),
        (lambda t: t.replace("Fx_N", "Fx_pebble", 1), "pebble"),
    ],
)
def test_readings_that_cannot_be_used(tmp_path: Path, edit: Callable[[str], str], said: str) -> None:
    session = with_readings(tmp_path, edit)
    refused("compare", session, saying=said)
    code, found = checked(session)
    assert code == 2
    assert "error" in {level for level, _ in found}


def test_a_torn_archive(tmp_path: Path) -> None:
    session = altered(tmp_path, lambda d: None, RAW)
    file = session / "readings.csv.gz"
    file.write_bytes(file.read_bytes()[:50_000])
    refused("compare", session, saying="torn or damaged")
    assert checked(session)[0] == 2


def test_readings_in_other_units_are_converted_and_said(tmp_path: Path, compared: Document) -> None:
    body = run("compare", with_readings(tmp_path, lambda t: t.replace("Tz_Nmm", "Tz_Nm", 1)), "--json", "-").body(
        "compare"
    )
    assert any("Tz" in note and "1000" in note for note in body["notes"])
    assert compared["notes"] == []


@pytest.mark.parametrize(("window", "said"), [([1e5, 1e5 + 3], "outside"), ([9, 5], "loaded_s"), ([6, 6.01], "c001")])
def test_a_window_without_readings(tmp_path: Path, window: list[float], said: str) -> None:
    session = altered(tmp_path, first_case(loaded_s=window), RAW)
    refused("compare", session, saying=said)
    answer = run("check", session)
    assert answer.code == 2
    assert "c001" in answer.out


# friction


def test_friction_of_the_published_specimens() -> None:
    body = run("friction", *SPECIMENS, "--json", "-").body("friction")
    assert round(body["pooled"]["factor"], 4) == 0.8348
    assert body["pooled"]["n"] == len(body["cases"]) == 32
    assert [s["name"] for s in body["specimens"]] == ["H01", "H02", "H03", "B01"]
    assert all(s["low"] < s["factor"] < s["high"] for s in [*body["specimens"], body["pooled"]])
    assert "0.8348" in run("friction", *SPECIMENS).out


def test_friction_without_a_pair(tmp_path: Path) -> None:
    refused("friction", altered(tmp_path, kept(lambda c: c["location"] == "tip")), saying=H01)


def test_friction_that_the_session_asks_for(tmp_path: Path) -> None:
    session = altered(tmp_path, keys(tension_factor={"estimate": "force_balance"}))
    body = run("compare", session, "--json", "-").body("compare")
    assert body["tension_factor"] == run("friction", H01, "--json", "-").body("friction")["pooled"]["factor"]
    assert "8 pairs" in body["tension_factor_source"]


# compare


@pytest.mark.parametrize("session", session_names())
def test_compare_of_every_shipped_session(session: str) -> None:
    body = run("compare", session, "--json", "-").body("compare")
    assert body["session"] == session
    for case in body["cases"]:
        assert set(case) == CASE
        for key in ("measured_N", "measured_sd_N", "predicted_N", "residual_N"):
            assert len(case[key]) == 3
        assert np.allclose(np.subtract(case["measured_N"], case["predicted_N"]), case["residual_N"])
        assert all(case[k] is None or len(case[k]) == 3 for k in ("measured_Nmm", "predicted_Nmm"))
    groups = {f"{c['role']}/{c['location']}" for c in body["cases"]}
    assert set(body["summary"]) == groups
    for name, planes in body["summary"].items():
        count = sum(f"{c['role']}/{c['location']}" == name for c in body["cases"])
        assert set(planes["sagittal"]) == set(planes["space"]) == ERRORS
        assert (planes["sagittal"]["components"], planes["space"]["components"]) == (2 * count, 3 * count)
    for key in ("by_muscle", "by_posture"):
        assert sum(group["space"]["cases"] for group in body[key].values()) == len(body["cases"])


def test_a_summary_is_that_of_its_cases(compared: Document) -> None:
    residuals = [c["residual_N"][:2] for c in compared["cases"] if (c["role"], c["location"]) == ("validation", "tip")]
    stated = compared["summary"]["validation/tip"]["sagittal"]["rmse_N"]
    assert stated == pytest.approx(np.sqrt(np.mean(np.square(residuals))), rel=1e-12)


def test_compare_with_a_shipped_finger_and_with_its_file() -> None:
    named = run("compare", HMEAN, "--model", "synek2019_optimised", "--json", "-").body("compare")
    file = data_dir() / "fingers" / "synek2019_optimised.yaml"
    assert run("compare", HMEAN, "--model", file, "--json", "-").body("compare") == named
    assert named["model"] == "synek2019_optimised"
    own = run("compare", HMEAN, "--json", "-").body("compare")
    published = [b["summary"]["identification/tip"]["sagittal"]["rmse_N"] for b in (own, named)]
    assert [round(x, 2) for x in published] == [0.53, 0.11]


def test_a_tendon_that_the_finger_lacks(tmp_path: Path) -> None:
    document = yaml.safe_load((data_dir() / "fingers" / "synek2019_initial.yaml").read_text(encoding="utf-8"))
    document["id"] = "without_lumbrical"
    document["muscles"].remove("LU")
    document["segments"] = [s for s in document["segments"] if s["slip"] != "LU"]
    document["hood"]["radial"].remove("LU")
    del document["hood"]["fractions"]["LU_ES"]
    file = tmp_path / "finger.yaml"
    file.write_text(yaml.safe_dump(document), encoding="utf-8")
    refused("compare", H01, "--model", file, saying="LU")


def test_a_straight_finger_is_named(tmp_path: Path) -> None:
    session = altered(tmp_path, lambda d: d["postures_deg"]["hook"].update(PIP=0, DIP=0))
    refused("compare", session, saying="hook")
    refused("refit", session, saying="hook")


def test_no_weight_and_no_force_give_an_answer(tmp_path: Path) -> None:
    nothing = every_case(lambda c: c.update(masses_g={}, force_N=[0, 0, 0]))
    body = run("compare", altered(tmp_path, nothing), "--json", "-").body("compare")
    errors = body["summary"]["identification/tip"]["space"]
    assert errors["rmse_N"] == pytest.approx(0.0, abs=1e-12)
    assert (errors["rmse_rel_pct"], errors["direction_error_deg"], errors["direction_cases"]) == (None, None, 0)


def test_figures_are_written_and_named(tmp_path: Path) -> None:
    folder = tmp_path / "figures"
    body = run("compare", H01, "--figures", folder, "--json", "-").body("compare")
    assert Path(body["figures"]) == folder / "compare.html"
    drawn = {p.stem for p in folder.glob("*.svg")}
    assert drawn == {p.stem for p in folder.glob("*.png")}
    assert {"vectors", "errors"} <= drawn
    assert all(p.stat().st_size > 1000 for p in folder.iterdir())


# refit


def test_a_refit_lowers_the_error_and_says_what_it_did(revision: tuple[Path, Document], compared: Document) -> None:
    path, body = revision
    wanted = {
        "outcome", "message", "objective", "evaluations", "seconds", "before", "after", "parameters", "model",
    }  # fmt: skip
    assert wanted <= set(body)
    assert {"name", "unit", "initial", "value", "sd", "at_bound"} <= set(body["parameters"][0])
    assert (body["outcome"], body["model"]) == ("converged", str(path))
    assert body["before"] == compared["summary"]
    assert set(body["after"]) == set(body["before"])
    for name in ("identification/tip", "validation/tip"):
        before, after = (body[when][name]["sagittal"]["rmse_N"] for when in ("before", "after"))
        assert after < before


def test_a_revision_compares_as_its_refit_said(revision: tuple[Path, Document]) -> None:
    path, body = revision
    again = run("compare", H01, "--model", path, "--json", "-").body("compare")
    assert numbers(again["summary"]) == pytest.approx(numbers(body["after"]), rel=1e-9)
    assert again["notes"] == []


def test_a_revision_on_another_session_leaves_its_rig_behind(revision: tuple[Path, Document]) -> None:
    body = run("compare", HMEAN, "--model", revision[0], "--json", "-").body("compare")
    assert any(H01 in note for note in body["notes"])


def test_a_refit_from_its_own_revision_stays(revision: tuple[Path, Document], tmp_path: Path) -> None:
    path, body = revision
    again = run("refit", H01, "--model", path, "--out", tmp_path / "r2.json", "--json", "-").body("refit")
    assert again["objective"] == pytest.approx(body["objective"], rel=1e-6)
    assert numbers(again["before"]) == pytest.approx(numbers(body["after"]), rel=1e-9)


def test_a_revision_is_never_overwritten(revision: tuple[Path, Document], tmp_path: Path) -> None:
    path, _ = revision
    content = path.read_bytes()
    refused("refit", H01, "--out", path, saying=path.name)
    assert path.read_bytes() == content


def test_without_out_revisions_are_numbered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names = [run("refit", H01, "--json", "-").body("refit")["model"] for _ in range(2)]
    assert [Path(n).as_posix() for n in names] == [f"models/{H01}-r1.json", f"models/{H01}-r2.json"]
    assert sorted(p.name for p in Path("models").glob("*.json")) == [f"{H01}-r1.json", f"{H01}-r2.json"]


def test_eq_5_as_published(tmp_path: Path) -> None:
    body = run("refit", HMEAN, "--method", "slsqp", "--out", tmp_path / "r.json", "--json", "-").body("refit")
    assert body["method"] == "slsqp"
    errors = body["after"]["identification/tip"]["sagittal"]
    assert (round(errors["rmse_N"], 2), round(errors["rmse_rel_pct"], 2)) == (0.11, 10.73)


def test_a_refit_without_identification_cases(tmp_path: Path) -> None:
    session = altered(tmp_path, every_case(lambda c: c.update(role="validation")))
    for method in ("map", "slsqp"):
        refused("refit", session, "--method", method, saying="identification")


def test_a_single_case_in_one_posture_moves_little_and_says_what_it_cannot_know(tmp_path: Path) -> None:
    session = altered(tmp_path, lambda d: d.update(cases=d["cases"][:1]))
    body = run("refit", session, "--out", tmp_path / "r.json", "--json", "-").body("refit")
    assert body["outcome"] == "converged"
    assert "say nothing about" in body["message"]
    assert all(p["sd"] is None or p["sd"] <= 1.000001 * p["prior_sd"] for p in body["parameters"])
    again = run("compare", session, "--model", tmp_path / "r.json", "--json", "-").body("compare")
    assert numbers(again["summary"]) == pytest.approx(numbers(body["after"]), rel=1e-9)


def test_contradictory_cases_end_with_a_misfit_that_is_said(tmp_path: Path) -> None:
    def contradict(document: Document) -> None:
        first = document["cases"][0]
        document["cases"][1] |= {"masses_g": first["masses_g"], "force_N": [-f for f in first["force_N"]]}

    body = run("refit", altered(tmp_path, contradict), "--out", tmp_path / "r.json", "--json", "-").body("refit")
    assert body["outcome"] == "converged"
    assert "The misfit is" in body["message"]


def test_a_refit_prints_what_to_do_next(tmp_path: Path) -> None:
    answer = run("refit", H01, "--out", tmp_path / "r.json")
    assert (answer.code, answer.err) == (0, "")
    assert f"fingertwin compare {H01} --model {tmp_path / 'r.json'}" in answer.out


# reproduce


def test_reproduce_sets_every_published_number_beside_ours() -> None:
    body = run("reproduce", "synek2019", "--json", "-").body("reproduce")
    assert all({"quantity", "published", "ours", "unit", "agrees"} <= set(row) for row in body["rows"])
    names = [row["quantity"] for row in body["rows"]]
    assert len(names) == len(set(names)) > 50
    assert [row["quantity"] for row in body["rows"] if row["agrees"] is False] == []
    assert all(row["note"] for row in body["rows"] if row["agrees"] is None)
    assert {fit["specimen"] for fit in body["fits"]} == {"HMEAN", "H01", "H02", "H03"}
    assert all(all(fit["held_to"].values()) for fit in body["fits"])


# export


def table(file: Path) -> list[dict[str, Any]]:
    if file.suffix == ".parquet":
        rows: list[dict[str, Any]] = pq.read_table(file).to_pylist()
        return rows
    with file.open(newline="", encoding="utf-8") as text:
        return [{k: v or None for k, v in row.items()} for row in csv.DictReader(text)]


@pytest.mark.parametrize("ending", ["csv", "parquet"])
@pytest.mark.parametrize("session", [H01, RAW])
def test_an_exported_session_holds_what_compare_says(tmp_path: Path, ending: str, session: str) -> None:
    file = tmp_path / f"table.{ending}"
    body = run("export", session, "--format", ending, "--out", file, "--json", "-").body("export")
    cases = run("compare", session, "--json", "-").body("compare")["cases"]
    rows = table(file)
    assert (body["rows"], body["file"], len(rows)) == (len(cases), str(file), len(cases))
    for row, case in zip(rows, cases, strict=True):
        assert [row[k] for k in ("id", "role", "posture", "location")] == [
            case[k] for k in ("id", "role", "posture", "location")
        ]
        names = {"measured_N": "F{}_N", "predicted_N": "predicted_F{}_N", "residual_N": "residual_F{}_N"}
        for key, name in names.items():
            assert [float(row[name.format(a)]) for a in "xyz"] == pytest.approx(case[key], rel=1e-12)
        moments = [row[f"T{a}_Nmm"] for a in "xyz"]
        assert (None if moments[0] is None else [float(m) for m in moments]) == case["measured_Nmm"]
        assert float(row["z"]) == pytest.approx(case["z"], rel=1e-12)
        assert {m: float(row[f"{m}_g"]) for m in case["masses_g"]} == case["masses_g"]
    assert len(rows[0]) == len(set(rows[0]))


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_an_exported_model_holds_its_parameters(tmp_path: Path, ending: str, revision: tuple[Path, Document]) -> None:
    file = tmp_path / f"table.{ending}"
    assert run("export", revision[0], "--format", ending, "--out", file).code == 0
    rows = table(file)
    assert [row["name"] for row in rows] == [p["name"] for p in revision[1]["parameters"]]
    assert [float(row["value"]) for row in rows] == [p["value"] for p in revision[1]["parameters"]]


def test_an_export_stays_in_the_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    session = altered(tmp_path, keys(id="../../elsewhere/H01"))
    here = tmp_path / "a" / "b"
    here.mkdir(parents=True)
    monkeypatch.chdir(here)
    assert run("export", session).code == 0
    assert sorted(p.name for p in here.iterdir()) == ["H01.csv", "H01.csv.json"]
    assert not (tmp_path / "elsewhere").exists()


# simulate


def test_a_simulated_session_is_usable_and_its_truth_is_found(simulated: Path) -> None:
    assert run("check", simulated).code == 0
    body = run("compare", simulated, "--json", "-").body("compare")
    truth = json.loads((simulated / "truth.json").read_text(encoding="utf-8"))["wrench_N_Nmm"]
    for case in body["cases"]:
        assert case["measured_N"] == pytest.approx(truth[case["id"]][:3], abs=0.05)
        assert case["predicted_N"] == pytest.approx(truth[case["id"]][:3], abs=1e-5)


def test_a_seed_repeats_a_simulation(simulated: Path, tmp_path: Path) -> None:
    def files(seed: int) -> list[bytes]:
        folder = tmp_path / str(seed) / "rig"
        assert run("simulate", "synek2019", "--out", folder, "--rate-hz", 20, "--seed", seed).code == 0
        return [(folder / "session.yaml").read_bytes(), gzip.decompress((folder / "readings.csv.gz").read_bytes())]

    same, other = files(3), files(4)
    assert same[0] == other[0] == (simulated / "session.yaml").read_bytes()
    assert same[1] == gzip.decompress((simulated / "readings.csv.gz").read_bytes())
    assert other[1] != same[1]


def test_a_simulation_never_overwrites(simulated: Path) -> None:
    refused("simulate", "synek2019", "--out", simulated, saying=str(simulated))


def test_a_simulation_keeps_what_lies_in_a_folder(tmp_path: Path) -> None:
    (tmp_path / "readings.csv.gz").write_text("precious", encoding="utf-8")
    refused("simulate", "synek2019", "--out", tmp_path)
    assert (tmp_path / "readings.csv.gz").read_text(encoding="utf-8") == "precious"


@pytest.mark.parametrize(
    "option",
    [
        ("--rate-hz", "0"), ("--rate-hz", "nan"), ("--rate-hz", "inf"), ("--rate-hz", "0.01"), ("--noise-N", "-1"),
        ("--noise-N", "inf"), ("--noise-N", "nan"), ("--repeats", "0"), ("--seed", "-1"), ("--model", "nosuch"),
        ("--model", "nosuch.json"),
    ],
)  # fmt: skip
def test_a_simulation_that_makes_no_sense_writes_nothing(tmp_path: Path, option: tuple[str, str]) -> None:
    refused("simulate", "synek2019", "--out", tmp_path / "s", *option, instead="")
    assert not (tmp_path / "s").exists()


@pytest.mark.parametrize(
    "edit",
    [
        keys(format="protocol/9"),
        keys(blocks=[]),
        lambda d: d["blocks"][0].update(postures=["fist"]),
        lambda d: d["blocks"][0].update(masses_g=[{"FPL": 100}]),
        lambda d: d["blocks"][0].update(masses_g=[{"FDP": -100}]),
        lambda d: d["timing"].update(load_s=0.1),
        lambda d: d["postures_deg"]["hook"].update(PIP=0, DIP=0),
        lambda d: d["postures_deg"]["hook"].update(wrist=10),
    ],
)
def test_a_protocol_that_cannot_be_run_writes_nothing(tmp_path: Path, edit: Edit) -> None:
    document = yaml.safe_load((data_dir() / "protocols" / "synek2019.yaml").read_text(encoding="utf-8"))
    edit(document)
    file = tmp_path / "protocol.yaml"
    file.write_text(yaml.safe_dump(document), encoding="utf-8")
    refused("simulate", file, "--out", tmp_path / "s", "--rate-hz", 20)
    assert not (tmp_path / "s").exists()


# demo


def test_the_demo_shows_the_error_fall(tmp_path: Path) -> None:
    answer = run("demo", "--out", tmp_path / "demo")
    assert (answer.code, answer.err) == (0, "")
    assert "Found: the tare missed a constant force (zero_offset.bone)" in answer.out
    assert "with zero_offset.bone" in answer.out
    assert "what is left" in answer.out
    assert "Beyond the catalogue they share an error of moment arms" in answer.out
    assert "It does not mend the bone loads" in answer.out
    for page in ("recorded/diagnose.html", "published/shared.html"):
        assert (tmp_path / "demo" / page).stat().st_size > 100_000
