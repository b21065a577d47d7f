"""What lacks space, files or its database for a while: started again, not given up; and the files that deploy it."""

from __future__ import annotations

import configparser
import errno
import re
import shutil
import sqlite3
import subprocess
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from sqlalchemy.exc import OperationalError

from daq.errors import InputError, LaterError
from server import cli
from server.service import app
from server.service.models import case_updates
from server.service.operation.folder import made
from server.service.operation.migrate import unusable, upgrade
from server.service.settings import Settings
from server.service.storage.database import Database

ROOT = Path(__file__).parents[4]
UNIT, IMAGE = ROOT / "docs/deploy/fingertwin.service", ROOT / "docs/deploy/Dockerfile"


def ended(monkeypatch: pytest.MonkeyPatch, *words: str) -> int:
    monkeypatch.setattr("server.service.web.logs.configure", lambda settings: None)
    monkeypatch.setattr("sys.argv", ["fingertwin", *words])
    with pytest.raises(SystemExit) as caught:
        cli.main()
    assert isinstance(caught.value.code, int)
    return caught.value.code


@pytest.mark.parametrize(
    ("fault", "code"), [(errno.ENOSPC, 75), (errno.EMFILE, 75), (errno.EIO, 75), (errno.EROFS, 2), (errno.EACCES, 2)]
)
def test_a_start_that_may_succeed_later_ends_otherwise_than_one_that_never_will(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    fault: int,
    code: int,
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise OSError(fault, "said by the system")

    monkeypatch.setattr(Path, "touch", refuse)
    assert ended(monkeypatch, "serve", "--data", str(tmp_path)) == code
    assert capsys.readouterr().err.count("\n") == 1
    with pytest.raises(InputError):
        made(tmp_path)


def test_a_disk_that_is_full_while_the_database_is_made_leaves_nothing_and_is_for_later(tmp_path: Path) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    database = Database(f"sqlite:///{tmp_path / 'a.db'}")
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("server.service.operation.migrate.os.link", full)
        patched.setattr(Path, "rename", full)
        with pytest.raises(LaterError, match="No space left"):
            upgrade(database)
    assert list(tmp_path.iterdir()) == []
    upgrade(database)
    database.close()


@pytest.mark.parametrize(
    ("said", "later"),
    [
        ("connection refused", True), ("the database system is starting up", True), ("too many clients already", True),
        ("password authentication failed for user anna", False), ('database "lab" does not exist', False),
    ],
)  # fmt: skip
def test_a_server_that_is_starting_is_for_later_and_a_wrong_password_is_not(said: str, later: bool) -> None:
    error = OperationalError("", {}, Exception(said))
    found = unusable(Database("postgresql+psycopg://anna@127.0.0.1/lab"), error)
    assert isinstance(found, LaterError) == later


@pytest.mark.parametrize(
    ("said", "later"),
    [
        ("database or disk is full", True), ("database is locked", True), ("disk I/O error", True),
        ("attempt to write a readonly database", False), ("file is not a database", False),
    ],
)  # fmt: skip
def test_a_full_disk_is_for_later_and_a_read_only_one_is_not(said: str, later: bool, tmp_path: Path) -> None:
    found = unusable(Database(f"sqlite:///{tmp_path / 'a.db'}"), OperationalError("", {}, Exception(said)))
    assert isinstance(found, LaterError) == later


@pytest.mark.parametrize(
    ("said", "later"),
    [(sqlite3.SQLITE_FULL, True), (sqlite3.SQLITE_IOERR_FSYNC, True), (sqlite3.SQLITE_IOERR_LOCK, False),
     (sqlite3.SQLITE_READONLY, False), (sqlite3.SQLITE_NOTADB, False)],
)  # fmt: skip
def test_a_disk_that_is_too_full_for_the_lock_is_for_later_and_one_that_knows_no_locks_is_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], said: int, later: bool
) -> None:
    class Refusing:
        def execute(self, words: str) -> None:
            if words.startswith("CREATE"):
                error = sqlite3.OperationalError("said by SQLite")
                error.sqlite_errorcode = said
                raise error

        def close(self) -> None:
            pass

    monkeypatch.setattr("daq.journal.lock.sqlite3.connect", lambda *_, **__: Refusing())
    assert ended(monkeypatch, "serve", "--data", str(tmp_path)) == (75 if later else 2)
    assert "cannot be locked (said by SQLite)" in capsys.readouterr().err


def test_a_service_gets_ready_once_what_it_lacks_is_back(monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[str] = []

    def predictor(name: str) -> Any:
        tried.append(name)
        if len(tried) < 4:
            raise OSError(errno.EMFILE, "Too many open files")
        topology = SimpleNamespace(rotations=(1,), muscles=(1,))
        return SimpleNamespace(topology=topology, predict=lambda *_: None)

    def start() -> None:
        tried.append("jobs")
        if tried.count("jobs") < 3:
            raise OperationalError("", {}, Exception("database or disk is full"))

    monkeypatch.setattr(app, "FIRST_WAIT_S", 0.001)
    jobs = SimpleNamespace(start=start, warm=lambda: None)
    parts: Any = SimpleNamespace(
        models=SimpleNamespace(predictor=predictor),
        jobs=jobs,
        settings=Settings(),
        ready=False,
        stopping=threading.Event(),
    )
    app._warm(parts)
    assert parts.ready
    assert (len(tried), tried.count("jobs")) == (7, 3)
    parts.stopping.set()
    parts.ready = False
    app._warm(parts)
    assert not parts.ready


def test_cases_not_computed_for_want_of_files_are_looked_at_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    looked = threading.Semaphore(0)

    def of(session: str) -> Any:
        looked.release()
        raise OSError(errno.EMFILE, "Too many open files")

    monkeypatch.setattr(case_updates, "_AGAIN_S", 0.001)
    nobody: Any = SimpleNamespace(listen=lambda _: None, of=of)
    looking = case_updates.CaseUpdates(nobody, nobody, nobody, nobody)
    looking.start()
    looking.touch("S")
    for _ in range(3):
        assert looked.acquire(timeout=10)
    looking.close()


def unit() -> configparser.ConfigParser:
    parser = configparser.ConfigParser(strict=False, interpolation=None, delimiters=("=",))
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    parser.read(UNIT, encoding="utf-8")
    return parser


def variables(text: str) -> set[str]:
    return {name.removeprefix("FINGERTWIN_").lower() for name in re.findall(r"FINGERTWIN_\w+(?==)", text)}


def test_the_unit_gives_up_only_what_never_will_succeed() -> None:
    service = unit()["Service"]
    assert service["Restart"] == "on-failure"
    assert "2" in service["RestartPreventExitStatus"].split()
    assert str(cli.AGAIN_LATER) not in service["RestartPreventExitStatus"].split()
    assert unit()["Unit"]["StartLimitIntervalSec"] == "0"
    assert service["ExecStart"].split()[1:] == ["serve"]


@pytest.mark.parametrize("file", [UNIT, IMAGE], ids=lambda f: f.name)
def test_deployed_settings_are_settings(file: Path) -> None:
    given = variables(file.read_text(encoding="utf-8"))
    assert given
    assert given <= set(Settings.model_fields)


def test_systemd_reads_the_unit(tmp_path: Path) -> None:
    program = shutil.which("systemd-analyze")
    if program is None:
        pytest.skip("systemd-analyze is absent: the unit is not read by systemd")
    copy = tmp_path / UNIT.name
    here = shutil.which("true") or "/bin/true"
    copy.write_text(UNIT.read_text(encoding="utf-8").replace("/opt/fingertwin/bin/fingertwin", here), encoding="utf-8")
    done = subprocess.run([program, "verify", copy], capture_output=True, text=True, check=False)  # noqa: S603
    # Older versions do not know how to wait longer each time, and say so.
    said = [line for line in done.stderr.splitlines() if copy.name in line and "Restart" not in line]
    assert said == []


def test_the_image_is_made_of_what_is_there() -> None:
    text = IMAGE.read_text(encoding="utf-8")
    for line in re.findall(r"^COPY (.*)$", text, re.MULTILINE):
        *sources, _ = line.split()
        assert all((ROOT / source).exists() for source in sources), line
    assert re.search(r'ENTRYPOINT \["fingertwin"\]\nCMD \["serve"\]', text)
    packages = {p.name for p in ROOT.iterdir() if (p / "__init__.py").exists()} - {"tests", "benchmarks"}
    assert packages <= set(re.findall(r"^COPY (\w+) ", text, re.MULTILINE))
