"""A journal's write-ahead log, which SQLite reads up to its first fault without a word about what comes after it.

Frames carry a running checksum, so one flipped bit hides all later transactions, though their bytes are sound.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from daq.errors import JournalError
from daq.journal.rows import PAGE_BYTES
from daq.quoting import quoted

Words = NDArray[np.uint32]

_HEAD, _FRAME = 32, 24
_MAGIC = 0x377F0682
_FORMAT = 3007000
_DATABASE = b"SQLite format 3\x00"


def log_file(path: Path) -> Path:
    """Return the path of a journal's write-ahead log."""
    return path.with_name(path.name + "-wal")


@dataclass(frozen=True, eq=False)
class Log:
    """A log as it lies there.

    Attributes:
        data: all bytes.
        page_bytes: of the journal.
        order: of the bytes that are summed up, `<` or `>`.
        salts: (8 bytes) that mark the frames of this round.
        current: (frames,) whether a frame belongs to this round; what is older lies behind it.
        first_bad: number of the first frame of this round that is not sound; their count where all are.
        hidden: transactions that end at or behind that frame.
    """

    data: bytes
    page_bytes: int
    order: str
    salts: bytes
    current: NDArray[np.bool_]
    first_bad: int
    hidden: int

    @property
    def damaged(self) -> bool:
        """True if more is hidden than the one transaction that a crash may have torn."""
        return self.hidden > 1

    def mended(self, first_page: bytes) -> bytes:
        """Return the log with every frame that still tells its page, and new checksums; a damaged page stays as it is.

        Args:
            first_page: of the journal, without which SQLite reads nothing: it stands where the log's is damaged.
        """
        frames = _frames(self.data, self.page_bytes)
        last = int(np.flatnonzero(self.current)[-1]) if self.current.any() else -1
        pages = frames[: last + 1, :8].copy().view(">u4")
        highest = int(pages[self.current[: last + 1], 1].max(initial=0))
        magic = _MAGIC | (self.order == ">")
        head = struct.pack(">IIII", magic, _FORMAT, self.page_bytes, 1) + self.salts
        sums = chained(head, self.order)
        out = [head, struct.pack(">II", *sums)]
        for frame, (number, _) in zip(frames[: last + 1], pages, strict=True):
            if not 0 < number <= highest:
                continue  # a page that lies nowhere
            mark, page = frame[:8].tobytes(), frame[_FRAME:].tobytes()
            if number == 1:
                first_page = page = page if page.startswith(_DATABASE) else first_page
            sums = chained(mark + page, self.order, sums)
            out.append(mark + self.salts + struct.pack(">II", *sums) + page)
        return b"".join(out)


def read_log(path: Path) -> Log | None:
    """Read the log of a journal; None where it has none."""
    file = log_file(path)
    while True:
        try:
            data = file.read_bytes()
            with file.open("rb") as again:
                unchanged = again.read(_HEAD) == data[:_HEAD]
        except FileNotFoundError:
            return None
        if unchanged:  # the writer did not begin anew meanwhile
            break
    if len(data) < _HEAD + _FRAME:
        return None
    magic, _, page_bytes = struct.unpack(">III", data[:12])
    order = ">" if magic & 1 else "<"
    sums: tuple[int, int] | None = chained(data[:24], order)
    salts = data[16:24]
    if struct.pack(">II", *(sums or ())) != data[24:_HEAD] or magic | 1 != _MAGIC | 1:
        # The head itself is damaged. Its frames tell what it said; the journal is not opened to look, because closing
        # it would undo the locks that SQLite holds on it in this process.
        sums, order, page_bytes = None, "<", PAGE_BYTES
        marks = [frame[8:16].tobytes() for frame in _frames(data, page_bytes)[:2]]
        salts = next((mark for mark in marks if any(mark)), data[16:24])  # the first frame may be gone with the head
    frames = _frames(data, page_bytes)
    current = (frames[:, 8:16] == np.frombuffer(salts, np.uint8)).all(axis=1)
    first_bad = _first_bad(frames, current, order, sums)
    ends = frames[:, 4:8].any(axis=1) & current
    return Log(data, page_bytes, order, salts, current, first_bad, int(ends[first_bad:].sum()))


def require_sound_log(path: Path) -> None:
    """Check that the log hides nothing.

    Raises:
        JournalError: it does.
    """
    log = read_log(path)
    if log is not None and log.damaged:
        raise JournalError(
            f"{log_file(path).name} is damaged: behind its frame {log.first_bad} lie {log.hidden} transactions",
            "a sound log",
            f"Run fingertwin journal recover {quoted(path.name)}",
        )


def chained(data: bytes, order: str, sums: tuple[int, int] = (0, 0)) -> tuple[int, int]:
    """Carry SQLite's checksum on over data: each word's sum is itself and the two sums before, as of Fibonacci."""
    words = np.frombuffer(data, order + "u4").astype(np.uint32)
    return _ended(_added(words[None, :])[0], sums, len(words))


def _frames(data: bytes, page_bytes: int) -> NDArray[np.uint8]:
    length = _FRAME + page_bytes
    count = (len(data) - _HEAD) // length
    return np.frombuffer(data, np.uint8, count * length, _HEAD).reshape(count, length)


def _first_bad(frames: NDArray[np.uint8], current: NDArray[np.bool_], order: str, sums: tuple[int, int] | None) -> int:
    if sums is None:
        return 0
    upto = len(current) if current.all() else int(np.argmin(current))
    summed = np.concatenate([frames[:upto, :8], frames[:upto, _FRAME:]], axis=1)
    words = summed.view(order + "u4").astype(np.uint32)
    stated = np.ascontiguousarray(frames[:upto, 16:_FRAME]).view(">u4")
    for i, added in enumerate(_added(words)):
        sums = _ended(added, sums, words.shape[1])
        if sums != (int(stated[i, 0]), int(stated[i, 1])):
            return i
    return upto


@cache
def _fibonacci(count: int) -> Words:
    out = [0, 1]
    while len(out) < count:
        out.append((out[-1] + out[-2]) & 0xFFFFFFFF)
    return np.array(out, dtype=np.uint32)


def _added(words: Words) -> Words:
    """Return the sums (n, 2), modulo 2³², after the words (n, m)."""
    weights = _fibonacci(words.shape[1] + 1)[::-1]
    return np.stack([words @ weights[1:], words @ weights[:-1]], axis=1)


def _ended(added: Words, sums: tuple[int, int], count: int) -> tuple[int, int]:
    f = [int(x) for x in _fibonacci(count + 2)[-3:]]
    first = (int(added[0]) + f[1] * sums[1] + f[0] * sums[0]) & 0xFFFFFFFF
    second = (int(added[1]) + f[2] * sums[1] + f[1] * sums[0]) & 0xFFFFFFFF
    return first, second
