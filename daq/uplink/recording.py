"""A session's readings file as one stream of a service: its name, description and chunks, the same each time."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from daq.acquisition.blocks import Chunk

if TYPE_CHECKING:
    from daq.recordings.readings import ReadingBlock
    from daq.sessions.models import Session

# A session that was uploaded has one stream; its name is the same each time, so that nothing is there twice.
STREAM = "readings"
# Readings of a chunk: some hundred kilobytes.
CHUNK = 4096


def description_of(session: Session, file: Path, sha256: str) -> dict[str, Any]:
    """Return the stream's description.

    Args:
        session: that the readings belong to.
        file: that holds them.
        sha256: of its bytes.
    """
    cell = None if session.load_cell is None else session.load_cell.model
    settings = {"file": file.name, "sha256": sha256}
    return {"driver": "upload", "settings": settings, "cell": {"model": cell}, "clock": "file"}


def epoch_of(sha256: str) -> str:
    """Return the stream's history: readings of another file would be another one."""
    return sha256[:32]


def chunks_of(blocks: Iterable[ReadingBlock], size: int = CHUNK) -> Iterator[Chunk]:
    """Yield readings as chunks of at most so many, and an empty one at the end."""

    def chunk(first: int, t_s: Any, wrench: Any, status: Any) -> Chunk:
        # There is no wall clock in a file, and the same file must make the same chunks.
        return Chunk(first, t_s, wrench, status, np.zeros(len(t_s), dtype=np.bool_), b"", [], 0.0)

    first = 0
    for block in blocks:
        status = np.zeros(len(block), dtype=np.int64) if block.status is None else block.status
        for a in range(0, len(block), size):
            part = slice(a, a + size)
            yield chunk(first + a, block.t_s[part], block.wrench[part], status[part])
        first += len(block)
    yield chunk(first, np.zeros(0), np.zeros((0, 6)), np.zeros(0, dtype=np.int64))
