"""A PostgreSQL server of the tests' own: started once, thrown away at the end.

Its programs are looked for on the path and where Debian puts them. They refuse to run as root, so for root they run as
another user.
"""

from __future__ import annotations

import atexit
import os
import shutil
import socket
import subprocess
import tempfile
from functools import cache
from itertools import count
from pathlib import Path
from typing import Any

import pytest

from tests.requirements import demanded

REQUIRED = demanded("postgres")
# Who can run it in root's place.
_USERS = ("postgres", "nobody")
_NUMBERS = count(1)


def postgres_url() -> str:
    """The URL of a new, empty database; skips the test, or fails it, where there is no PostgreSQL."""
    server = _server()
    if isinstance(server, str):
        if REQUIRED:
            pytest.fail(f"{server}, and FINGERTWIN_REQUIRE asks for postgres")
        pytest.skip(f"{server}: not tested with PostgreSQL")
    return server.new_database()


class Server:
    """A server that is running.

    Args:
        folder: of its programs.
    """

    def __init__(self, programs: Path) -> None:
        self._programs = programs
        # Not among pytest's folders, where only root may look.
        self._folder = Path(tempfile.mkdtemp(prefix="fingertwin-postgres-"))
        self._user = _other_user(self._folder)
        data = self._folder / "data"
        self._run("initdb", "-D", data, "-A", "trust", "-U", "fingertwin", "-E", "UTF8", "--locale=C", "--no-sync")
        self._port = _free_port()
        settings = f"-p {self._port} -c listen_addresses=127.0.0.1 -c unix_socket_directories= -c fsync=off"
        self._control = ("pg_ctl", "-D", data, "-w")
        self._run(*self._control, "-l", self._folder / "log", "-o", settings, "start")
        atexit.register(self.close)

    def url(self, database: str) -> str:
        """Of a database."""
        return f"postgresql+psycopg://fingertwin@127.0.0.1:{self._port}/{database}"

    def new_database(self) -> str:
        """Make an empty database; return its URL."""
        import psycopg

        name = f"test{next(_NUMBERS)}"
        with psycopg.connect(self.url("postgres").replace("+psycopg", ""), autocommit=True) as connection:
            connection.execute(f"CREATE DATABASE {name}".encode())
        return self.url(name)

    def close(self) -> None:
        """Stop it, and remove all of it."""
        self._run(*self._control, "-m", "immediate", "stop")
        shutil.rmtree(self._folder, ignore_errors=True)

    def _run(self, program: str, *arguments: str | Path) -> None:
        as_other: dict[str, Any] = {} if self._user is None else {"user": self._user, "extra_groups": []}
        done = subprocess.run(  # noqa: S603
            [self._programs / program, *arguments],
            cwd=self._folder,
            stdin=subprocess.DEVNULL,
            # A pipe would stay open for as long as the server runs.
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            timeout=60,
            check=False,
            **as_other,
        )
        log = self._folder / "log"
        said = log.read_text(errors="replace") if log.exists() else ""
        assert done.returncode == 0, f"{program} ended with {done.returncode}: {said}"


@cache
def _server() -> Server | str:
    """The server, or why there is none."""
    found = shutil.which("initdb")
    folders = [Path(found).resolve().parent] if found else []
    folders += sorted(Path("/usr/lib/postgresql").glob("*/bin"), reverse=True)
    for folder in folders:
        if all((folder / name).exists() for name in ("initdb", "pg_ctl", "postgres")):
            return Server(folder)
    return "PostgreSQL is not installed"


def _other_user(folder: Path) -> str | None:
    if not hasattr(os, "geteuid") or os.geteuid() != 0:
        return None
    for user in _USERS:
        try:
            shutil.chown(folder, user)
        except LookupError:
            continue
        return user
    pytest.fail("no user other than root to run PostgreSQL as")


def _free_port() -> int:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        port: int = taken.getsockname()[1]
        return port
