"""Write files so that a reader never meets half of one."""

from __future__ import annotations

import errno
import os
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from uuid import uuid4

from daq.errors import InputError


def require_writable(path: Path, *, folder: bool = False) -> None:
    """Refuse a file, or a folder, that cannot be written; nothing is left there.

    Args:
        path: of it; it need not be there, nor the folders above it.
        folder: whether files are to be written into it.

    Raises:
        InputError: a file there could not be written.
    """
    try:
        if not folder and (not path.name or path.is_dir()):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        if not folder:
            if is_special(path):
                return
            path = _linked(path)
        nearest = path if folder else path.parent
        while not nearest.exists():
            nearest = nearest.parent
        # Written to, not asked for its rights: these do not tell all on every system.
        probe = nearest / f".{uuid4().hex[:12]}"
        probe.touch(exist_ok=False)
        probe.unlink()
    except OSError as error:
        kind = "folder" if folder else "file"
        raise InputError(
            f"cannot write {path} ({error.strerror})",
            f"a {kind} that can be written",
            f"Name another {kind}, or ask for the right to write there",
        ) from error


def read_text(path: Path, wanted: str) -> str:
    """Read a text in UTF-8.

    Args:
        path: of the file.
        wanted: what it should be, such as `a notebook as text`.

    Raises:
        InputError: it cannot be read, or is in another encoding.
    """
    try:
        return path.read_text("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path} is not UTF-8 text (byte {error.start})",
            f"{wanted} in UTF-8",
            "Save it as UTF-8; spreadsheets call that 'CSV UTF-8'",
        ) from error
    except OSError as error:
        raise InputError(
            f"{path} cannot be read ({error.strerror})", wanted, "Check the path and its rights"
        ) from error


def is_special(path: Path) -> bool:
    """Return whether a path leads to what is neither a file nor a folder, such as a device or a named pipe."""
    return path.exists() and not path.is_file() and not path.is_dir()


def _is_printed_to(path: Path) -> bool:
    """Return whether standard output goes to a file at this path, as `/dev/stdout` leads to it after `> FILE`."""
    try:
        return path.is_file() and os.path.samestat(path.stat(), os.fstat(sys.stdout.fileno()))
    except (AttributeError, OSError, ValueError):  # there is no standard output, or it is no file of the system's
        return False


def _linked(path: Path) -> Path:
    """Return the path that a symbolic link leads to, so that the link stays; any other path as it is."""
    return Path(os.path.realpath(path)) if path.is_symlink() else path


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary name beside `path`; rename it to `path` when the block ends well, else remove it.

    Of a symbolic link, the file that it leads to is replaced. A device or a named pipe stays, and is written to. So is
    the file that standard output goes to, after what was printed.

    Args:
        path: the file to write; its folder is made where it is absent.

    Raises:
        OSError: the folder cannot be written to.
    """
    if not path.name or path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    # The ending stays last: writers choose their format by it.
    name = f".{uuid4().hex[:12]}.{path.name}"
    printed = _is_printed_to(path)
    if printed or is_special(path):
        # Written whole elsewhere first: some writers go back in their file.
        with TemporaryDirectory() as folder:
            temporary = Path(folder, name)
            yield temporary
            with temporary.open("rb") as whole:
                if printed:
                    sys.stdout.flush()
                    shutil.copyfileobj(whole, sys.stdout.buffer)
                    sys.stdout.flush()
                else:
                    with path.open("wb") as target:
                        shutil.copyfileobj(whole, target)
        return
    path = _linked(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(name)
    try:
        yield temporary
        with temporary.open("rb+") as file:
            os.fsync(file.fileno())
        temporary.replace(path)
    finally:
        with suppress(FileNotFoundError):
            temporary.unlink()
