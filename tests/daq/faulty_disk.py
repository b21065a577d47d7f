"""A disk that fails: SQLite's own writes, syncs and mappings end in errors, and a power cut loses what was not synced.

SQLite's way to the disk (its default VFS) is taken over in this process by ctypes: every file in one folder answers as
the test says. What SQLite makes of it is SQLite's own code.
"""

from __future__ import annotations

import _sqlite3
import ctypes
import random
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

OK, FULL = 0, 13
IOERR_READ, IOERR_WRITE, IOERR_FSYNC, IOERR_TRUNCATE, IOERR_SHMSIZE = (10 | k << 8 for k in (1, 3, 4, 6, 19))
# What fails, and what SQLite is told then.
FAULTS = (
    ("write", FULL), ("write", IOERR_WRITE), ("sync", IOERR_FSYNC), ("truncate", IOERR_TRUNCATE),
    ("read", IOERR_READ), ("map", IOERR_SHMSIZE),
)  # fmt: skip
_POINTER, _INT, _LONG = ctypes.c_void_p, ctypes.c_int, ctypes.c_int64
_METHODS = (
    "close", "read", "write", "truncate", "sync", "size", "lock", "unlock", "reserved", "control", "sector", "device",
    "map", "shm_lock", "barrier", "unmap", "fetch", "unfetch",
)  # fmt: skip
# The name as it lies there: SQLite keeps it, and what it has written behind it.
_OPEN = ctypes.CFUNCTYPE(_INT, _POINTER, _POINTER, _POINTER, _INT, _POINTER)
_KINDS: dict[str, Any] = {
    "close": ctypes.CFUNCTYPE(_INT, _POINTER),
    "read": ctypes.CFUNCTYPE(_INT, _POINTER, _POINTER, _INT, _LONG),
    "write": ctypes.CFUNCTYPE(_INT, _POINTER, _POINTER, _INT, _LONG),
    "truncate": ctypes.CFUNCTYPE(_INT, _POINTER, _LONG),
    "sync": ctypes.CFUNCTYPE(_INT, _POINTER, _INT),
    "map": ctypes.CFUNCTYPE(_INT, _POINTER, _INT, _INT, _INT, _POINTER),
}


# What SQLite may still call, were a file left open.
_KEPT: list[Any] = []


class _Io(ctypes.Structure):
    _fields_ = [("version", _INT), *((name, _POINTER) for name in _METHODS)]


class _Vfs(ctypes.Structure):
    _fields_ = [
        ("version", _INT), ("file_bytes", _INT), ("most_path", _INT), ("next", _POINTER), ("name", ctypes.c_char_p),
        ("data", _POINTER), ("open", _POINTER),
    ]  # fmt: skip


@dataclass
class _File:
    """What a power cut would leave: what was synced, and in order what was written since (place, bytes)."""

    durable: bytearray
    pending: list[tuple[int, bytes | None]] = field(default_factory=list)

    def left(self, draw: random.Random) -> bytes:
        """The file after a power cut: each block since the last sync is there or not, the last one torn perhaps."""
        out = bytearray(self.durable)
        for at, data in self.pending:
            if draw.random() < 0.5:
                _apply(out, at, data if data is None else data[: draw.choice([len(data), draw.randint(0, len(data))])])
        return bytes(out)

    def sync(self) -> None:
        for at, data in self.pending:
            _apply(self.durable, at, data)
        self.pending.clear()


def _apply(content: bytearray, at: int, data: bytes | None) -> None:
    if data is None:
        del content[at:]
        return
    content.extend(bytes(max(at - len(content), 0)))
    content[at : at + len(data)] = data


@dataclass
class Disk:
    """What happens on it.

    Attributes:
        folder: whose files it holds.
        fails: an operation (read, write, truncate, sync, map), or "" for none.
        after: so many of these still work; then all fail until it is mended.
        code: of the error.
        short: share of what is to be written that is, before it fails.
        failed: how many of each operation have failed.
    """

    folder: Path
    fails: str = ""
    after: int = 0
    code: int = OK
    short: float = 0.0
    failed: Counter[str] = field(default_factory=Counter)
    files: dict[str, _File] = field(default_factory=dict)

    def mend(self) -> None:
        """Let everything work again."""
        self.fails = ""

    def refuses(self, operation: str) -> bool:
        """Whether an operation fails now."""
        if operation != self.fails:
            return False
        self.after -= 1
        self.failed[operation] += self.after < 0
        return self.after < 0

    def cut_power(self, target: Path, draw: random.Random) -> None:
        """Write into another folder what a power cut would leave now."""
        target.mkdir()
        for file in self.folder.iterdir():
            known = self.files.get(str(file))
            if not file.name.endswith("-shm"):
                (target / file.name).write_bytes(file.read_bytes() if known is None else known.left(draw))


def available() -> bool:
    """Whether SQLite's way to the disk can be taken over here."""
    try:
        return bool(_library().sqlite3_vfs_find)
    except (OSError, AttributeError):
        return False


def _library() -> ctypes.CDLL:
    return ctypes.CDLL(_sqlite3.__file__)


@contextmanager
def faulty(disk: Disk) -> Iterator[Disk]:
    """Take SQLite's way to the files of a folder over while the block runs; all of them must be closed by its end.

    Raises:
        AssertionError: one is still open.
    """
    find = _library().sqlite3_vfs_find
    find.restype, find.argtypes = _POINTER, [ctypes.c_char_p]
    vfs = _Vfs.from_address(find(None))
    before, opened = vfs.open, _OPEN(vfs.open)
    names: dict[int, str] = {}
    tables: dict[int, _Io] = {}
    held: list[Any] = []

    def taken_over(own: int) -> _Io:
        """The methods of a file with ours in their place."""
        table = _Io.from_buffer_copy(_Io.from_address(own))
        # A log has no shared memory of its own.
        theirs = {name: kind(at) for name, kind in _KINDS.items() if (at := getattr(table, name))}
        for name, function in _functions(disk, names, theirs).items():
            if name in theirs:
                callback = _KINDS[name](function)
                held.append(callback)
                setattr(table, name, ctypes.cast(callback, _POINTER).value)
        return table

    def open_(this: int, name: int | None, file: int, flags: int, out: int) -> int:
        path = "" if name is None else ctypes.string_at(name).decode()
        mine = path.startswith(f"{disk.folder}/")
        if mine and not (Path(path).exists() and path in disk.files):
            # Nobody has it open yet.
            disk.files[path] = _File(bytearray(Path(path).read_bytes() if Path(path).exists() else b""))
        code = int(opened(this, name, file, flags, out))
        own = ctypes.c_void_p.from_address(file)
        if code == OK and mine and own.value:
            names[file] = path
            if own.value not in tables:
                tables[own.value] = taken_over(own.value)
            own.value = ctypes.addressof(tables[own.value])
        return code

    callback = _OPEN(open_)
    _KEPT.append((tables, held, callback))
    vfs.open = ctypes.cast(callback, _POINTER).value
    try:
        yield disk
    finally:
        vfs.open = before
    assert not names, f"still open: {set(names.values())}"


def _functions(disk: Disk, names: dict[int, str], theirs: dict[str, Any]) -> dict[str, Callable[..., int]]:
    def read(file: int, buffer: int, count: int, at: int) -> int:
        return disk.code if disk.refuses("read") else int(theirs["read"](file, buffer, count, at))

    def write(file: int, buffer: int, count: int, at: int) -> int:
        fails = disk.refuses("write")
        count = int(disk.short * count) if fails else count
        if count:
            disk.files[names[file]].pending.append((at, ctypes.string_at(buffer, count)))
            theirs["write"](file, buffer, count, at)
        return disk.code if fails else OK

    def truncate(file: int, size: int) -> int:
        if disk.refuses("truncate"):
            return disk.code
        disk.files[names[file]].pending.append((size, None))
        return int(theirs["truncate"](file, size))

    def sync(file: int, flags: int) -> int:
        known = disk.files[names[file]]
        if disk.refuses("sync"):
            # As Linux does it: what could not be written is held to be so from then on.
            known.pending.clear()
            return disk.code
        known.sync()
        return OK

    def map_(file: int, page: int, size: int, extend: int, out: int) -> int:
        return disk.code if disk.refuses("map") else int(theirs["map"](file, page, size, extend, out))

    def close(file: int) -> int:
        del names[file]
        return int(theirs["close"](file))

    return {"close": close, "read": read, "write": write, "truncate": truncate, "sync": sync, "map": map_}
