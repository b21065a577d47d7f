"""The command line as its users meet it: help, arguments, codes, a clear line for bad input, where answers go."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import threading
from pathlib import Path
from typing import NoReturn

import pytest
import typer

from daq.locations import data_dir
from server import cli
from tests.server.command_line import COMMANDS, H01, RAW, Document, altered, keys, refused, run, started, strict

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
        ("simulate", "--out --model --effect --rate-hz --noise-N --repeats --seed --json"),
        ("demo", "--out --json"),
    ],
)
def test_help_of_a_command_lists_its_options(command: str, options: str) -> None:
    answer = run(command, "--help")
    assert (answer.code, answer.err) == (0, "")
    assert [o for o in options.split() if o not in answer.out] == []


def test_every_command_answers_as_json() -> None:
    left, without = [("fingertwin", typer.main.get_command(cli.app))], []
    while left:
        name, command = left.pop()
        parts = getattr(command, "commands", {})
        left += parts.items()
        if not parts and not any("--json" in p.opts for p in command.params):
            without.append(name)
    assert without == []


def test_help_of_export_says_that_a_finger_for_other_programs_comes_of_no_session() -> None:
    assert "for osim and mjcf a revision or a finger" in " ".join(run("export", "--help").out.split())


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
    # Of an option without its value, Typer does not say whose it is.
    of = "" if arguments[0] == "comapre" or arguments[-1] == "--model" else f" {arguments[0]}"
    line = refused(*arguments, saying=named, instead=f" Try 'fingertwin{of} --help'.")
    assert not [odd for odd in ("Value error", "?.", "..") if odd in line]


@pytest.mark.parametrize("command", ["compare", "refit", "friction", "export", "check"])
@pytest.mark.parametrize(
    ("session", "said"),
    [
        ("synek2019_H04", "Did you mean synek2019_H0"),
        ("DEV-2", "Did you mean DEV-02?"),
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


@pytest.mark.skipif(sys.platform == "win32", reason="Windows lets few users make links, and has no named pipes")
@pytest.mark.parametrize("there", [True, False])
def test_an_answer_goes_where_a_link_leads(tmp_path: Path, there: bool) -> None:
    link, target = tmp_path / "link.json", tmp_path / "kept" / "answer.json"
    target.parent.mkdir()
    if there:
        target.write_text("earlier", encoding="utf-8")
    link.symlink_to(target)
    assert run("check", H01, "--json", link).code == 0
    assert link.readlink() == target
    strict(target.read_text(encoding="utf-8"), "check")
    assert [p.name for p in target.parent.iterdir()] == ["answer.json"]


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no named pipes in folders")
@pytest.mark.parametrize(
    ("arguments", "begin"),
    [
        (["check", H01, "--json"], b"{"),
        (["export", H01, "--out"], b"session,"),
        (["export", H01, "--format", "hdf5", "--out"], b"\x89HDF"),
    ],
)
def test_an_answer_goes_through_a_named_pipe(tmp_path: Path, arguments: list[str], begin: bytes) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    read: list[bytes] = []
    reader = threading.Thread(target=lambda: read.append(pipe.read_bytes()), daemon=True)
    reader.start()
    assert run(*arguments, pipe).code == 0
    reader.join(10.0)
    assert read[0].startswith(begin)
    assert pipe.is_fifo()
    assert [p.name for p in tmp_path.iterdir()] == ["pipe"]


@pytest.mark.skipif(not Path("/dev/stdout").exists(), reason="this system has no name for standard output")
@pytest.mark.parametrize("name", ["/dev/stdout", "printed"])
def test_an_answer_that_goes_to_the_file_of_standard_output_leaves_what_is_printed(tmp_path: Path, name: str) -> None:
    command = [sys.executable, "-m", "server", "check", str(H01), "--json", name]
    with (tmp_path / "printed").open("wb") as printed:
        printed.write(b"before\n")
        printed.flush()
        subprocess.run(command, stdout=printed, cwd=tmp_path, check=True, timeout=120)  # noqa: S603
    text = (tmp_path / "printed").read_text(encoding="utf-8")
    assert text.startswith("before\n")
    assert '"fingertwin/check/1"' in text
    assert "H01: usable" in text
    assert [p.name for p in tmp_path.iterdir()] == ["printed"]


@pytest.mark.parametrize("arguments", [["compare", H01], ["friction", H01], ["check", H01]])
@pytest.mark.parametrize("where", ["", "folder", "file/answer.json"])
def test_an_answer_that_cannot_be_written(tmp_path: Path, arguments: list[str], where: str) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").touch()
    answer = run(*arguments, "--json", tmp_path / where if where else "")
    assert (answer.code, answer.out, answer.err.count("\n")) == (2, "", 1)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "folder"]
    assert list((tmp_path / "folder").iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["diagnose", RAW, "--json", "file/out"], "file/out"),
        (["diagnose", RAW, "--figures", "file"], "file"),
        (["diagnose", RAW, "--frozen", "file"], "file"),
        (["refit", RAW, "--out", "file/out"], "file/out"),
        (["refit", RAW], "models"),
        (["add", "hanger_mass", RAW], "models"),
        (["next", RAW, "--freeze"], "models"),
    ],
)
def test_a_file_that_cannot_be_used_is_told_before_anything_is_computed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], named: str
) -> None:
    def compute(*_: object) -> NoReturn:
        pytest.fail("it was computed")

    (tmp_path / "file").touch()
    (tmp_path / "models").touch()
    monkeypatch.chdir(tmp_path)
    for place in ("diagnosis.run_diagnosis", "planning.run_diagnosis", "twin.refit_compared", "additions.add_bench"):
        monkeypatch.setattr(f"server.commands.{place}", compute)
    refused(*arguments, saying=str(Path(named)))
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "models"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["next", RAW, "--out", "x"], "--out without --freeze"),
        (["diagnose", RAW, "DEV-02", "--frozen", "foo.json"], "--frozen with several sessions"),
        (["diagnose", RAW, "--permutations", "0"], "--permutations with one session"),
        (["diagnose", RAW, "--law", "law.yaml"], "--law with one session"),
        (["log", "--driver", "replay", "--port", RAW, "--out", "x", "--model", "m.json"], "--model without --protocol"),
        (["log", "--driver", "replay", "--port", RAW, "--out", "x", "--session", "s"], "--session without --to"),
        (["log", "--driver", "replay", "--port", RAW, "--out", "x", "--baud", "9600"], "--baud with --driver replay"),
        (["replay", RAW, "--session", "s"], "--session without --to"),
        (["simulate-cell", "gauge-volts", "--wire", "tcp", "--link", "x"], "--link with --wire tcp"),
        (["simulate-cell", "ati-netft", "--link", "x"], "--link with --wire udp"),
    ],
)
def test_an_option_that_would_change_nothing_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], said: str
) -> None:
    monkeypatch.chdir(tmp_path)
    refused(*arguments, saying=f"{said} has no effect; expected ")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="this system has no pseudo-terminals")
def test_a_pseudo_terminal_has_no_port() -> None:
    refused("simulate-cell", "gauge-volts", "--port", "5000", saying="--port with a pseudo-terminal has no effect")


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
    answer = run(*arguments, tmp_path / "out.json")
    assert (answer.code, answer.out, answer.err.count("\n")) == (2, "", 1)
    assert os.strerror(errno.ENOSPC) in answer.err
    assert [p for p in tmp_path.rglob("*") if p.is_file()] == []


@pytest.mark.parametrize(
    "arguments",
    [["export", H01, "--out"], ["refit", H01, "--out"], ["compare", H01, "--figures"], ["simulate", "levels", "--out"]],
)
def test_an_output_below_a_file(tmp_path: Path, arguments: list[str]) -> None:
    (tmp_path / "file").touch()
    refused(*arguments, tmp_path / "file" / "out.json", saying="file", instead="")


@pytest.mark.parametrize("command", ["export", "refit"])
@pytest.mark.parametrize("where", ["", "folder"])
def test_an_output_that_is_a_folder_is_named(tmp_path: Path, command: str, where: str) -> None:
    (tmp_path / "folder").mkdir()
    line = refused(command, H01, "--out", tmp_path / where if where else "", saying=where, instead="")
    assert ".tmp" not in line
    assert list((tmp_path / "folder").iterdir()) == []


def test_a_pipe_gets_no_progress_bar_and_no_escape_codes(tmp_path: Path) -> None:
    answer = started("compare", RAW)
    assert (answer.returncode, answer.stderr) == (0, "")
    assert "\x1b" not in answer.stdout
    assert "RMSE" in answer.stdout


def test_an_output_that_lacks_a_letter_shows_a_mark(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONIOENCODING", "ascii")
    answer = started("check", altered(tmp_path, keys(id="Größe", finger="Fünfter")))
    assert (answer.returncode, answer.stderr.count("\n")) == (2, 1)
    assert "F?nfter" in answer.stdout


def test_bad_input_in_its_own_process_has_no_traceback() -> None:
    answer = started("compare", "nosuch")
    assert (answer.returncode, answer.stdout, answer.stderr.count("\n")) == (2, "", 1)
