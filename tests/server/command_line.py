"""The command line in this process and in its own, what it answers, and sessions that were spoilt for it."""

from __future__ import annotations

import contextlib
import gzip
import io
import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import pytest
import yaml

from daq.locations import data_dir
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
