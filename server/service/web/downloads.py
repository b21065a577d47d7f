"""Files that are made for one answer: written beside everything else, sent in portions, and gone afterwards."""

from __future__ import annotations

import re
from collections.abc import AsyncIterator, Callable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

import anyio
from starlette.responses import StreamingResponse
from starlette.types import Receive, Scope, Send

from server.service.web.problems import ProblemError
from server.service.web.workers import run

_PORTION = 1 << 18
_UNSAFE = re.compile(r"[^A-Za-z0-9._-]+")


async def download(
    write: Callable[[Path], Path],
    kind: str,
    headers: Mapping[str, str] | None = None,
) -> FileAnswer:
    """Answer with a file that is written now.

    Args:
        write: is given an empty folder, and returns the file that it made in it; its name is the client's.
        kind: media type.
        headers: of the answer.

    Raises:
        ProblemError: 503 the file cannot be written.
    """
    folder = TemporaryDirectory(prefix="fingertwin-", ignore_cleanup_errors=True)
    try:
        file = await run("apart", write, Path(folder.name))
        return FileAnswer(file, folder, kind, headers)
    except BaseException as error:
        folder.cleanup()
        if isinstance(error, OSError):
            raise ProblemError(
                503,
                f"the file cannot be written ({error.strerror or type(error).__name__})",
                "space where the service keeps its temporary files",
                "Free some, and ask again",
            ) from error
        raise


class FileAnswer(StreamingResponse):
    """Sends a file, and removes its folder, whether or not the client has waited for all of it.

    Args:
        file: to send.
        folder: that goes with the answer.
        kind: media type.
        headers: further ones.
    """

    def __init__(
        self, file: Path, folder: TemporaryDirectory[str], kind: str, headers: Mapping[str, str] | None = None
    ) -> None:
        own = {"Content-Disposition": attachment(file.name), "Content-Length": str(file.stat().st_size)}
        super().__init__(self._portions(), 200, own | dict(headers or {}), kind)
        self._file, self._folder = file, folder
        self._open: anyio.AsyncFile[bytes] | None = None

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send the file."""
        try:
            self._open = await anyio.open_file(self._file, "rb")
            await super().__call__(scope, receive, send)
        finally:
            # Closed first: an open file cannot be removed everywhere.
            if self._open is not None:
                self._open.wrapped.close()
            self._folder.cleanup()

    async def _portions(self) -> AsyncIterator[bytes]:
        assert self._open is not None  # noqa: S101 - opened before the first portion is asked for
        while portion := await self._open.read(_PORTION):
            yield portion


def attachment(name: str) -> str:
    """Return the header that saves an answer under a name, of which only harmless characters are left."""
    safe = _UNSAFE.sub("_", name).strip(".") or "download"
    return f'attachment; filename="{safe[:150]}"'
