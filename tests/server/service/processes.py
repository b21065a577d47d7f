"""Services as processes of their own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import httpx

PATIENCE_S = 90


class Process:
    """A service that was started.

    Args:
        command: after the interpreter.
        settings: of the environment.
    """

    def __init__(self, command: list[str], **settings: str) -> None:
        self.process = subprocess.Popen(  # noqa: S603
            [sys.executable, *command],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            stdin=subprocess.DEVNULL,
            text=True,
            env=os.environ | {"PYTHONUNBUFFERED": "1"} | settings,
        )
        self._said: dict[str, list[str]] = {"out": [], "err": []}
        self._open = 2
        self._news = threading.Condition()
        out, err = self.process.stdout, self.process.stderr
        assert out is not None
        assert err is not None
        self._readers = [
            threading.Thread(target=self._read, args=(name, stream), daemon=True)
            for name, stream in (("out", out), ("err", err))
        ]
        for reader in self._readers:
            reader.start()

    @property
    def log(self) -> str:
        """What it has logged."""
        with self._news:
            return "".join(self._said["err"])

    def wait_for(self, text: str, where: str = "err") -> str:
        """Wait until it says something; return the line."""
        with self._news:
            self._news.wait_for(lambda: self._open == 0 or self._line(text, where) is not None, PATIENCE_S)
            line = self._line(text, where)
        assert line is not None, f"never said {text!r}: {self.log}"
        return line

    def address(self) -> str:
        """Wait until it answers; return where."""
        words = self.wait_for("http://", "out").split()
        found = next(word.rstrip(";") for word in words if word.startswith("http://"))
        return found.replace("0.0.0.0", "127.0.0.1")  # noqa: S104

    def client(self, token: str | None = None) -> httpx.Client:
        """Return a client of it."""
        headers = {"Authorization": f"Bearer {token}"} if token else {}
        return httpx.Client(base_url=self.address(), headers=headers, timeout=PATIENCE_S, trust_env=False)

    def ended(self) -> int:
        """Wait for its end, and for the last that it says; return the exit code."""
        code = self.process.wait(PATIENCE_S)
        for reader in self._readers:
            reader.join(PATIENCE_S)
        return code

    def close(self) -> None:
        """End it, however it is."""
        self.process.kill()
        self.ended()

    def _line(self, text: str, where: str) -> str | None:
        return next((line for line in self._said[where] if text in line), None)

    def _read(self, name: str, stream: IO[str]) -> None:
        with stream:
            for line in stream:
                with self._news:
                    self._said[name].append(line)
                    self._news.notify_all()
        with self._news:
            self._open -= 1
            self._news.notify_all()


@contextmanager
def running(command: list[str]) -> Iterator[Process]:
    """Start a service, and end it with the block."""
    process = Process(command)
    try:
        yield process
    finally:
        process.close()


def small(**settings: Any) -> list[str]:
    """Command of the small guarded application."""
    given = {"port": 0} | {k: str(v) if isinstance(v, Path) else v for k, v in settings.items()}
    return ["-m", "tests.server.service.small_service", json.dumps(given)]


def whole(data: Path, *words: str) -> list[str]:
    """Command of the service itself."""
    return ["-m", "server.cli", "serve", "--data", str(data), "--port", "0", *words]
