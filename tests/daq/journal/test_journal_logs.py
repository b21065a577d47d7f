"""The log beside a journal, damaged where it hurts most: what it hides is found, and the rest recovered."""

from __future__ import annotations

from pathlib import Path

from daq.journal.check import recover
from daq.journal.rows import PAGE_BYTES
from daq.journal.wal import log_file
from daq.journal.writer import Journal
from tests.daq.journals import fill, firsts, kinds, torn_off

HEAD, FRAME = 32, 24


def crashed_journal(tmp_path: Path) -> tuple[Path, str]:
    path = tmp_path / "bench.journal"
    with Journal.create(path, "bench 1", 0) as journal:
        stream = fill(journal, 5, 700)
        return torn_off(path), stream


def overwrite(path: Path, at: int, data: bytes) -> None:
    with path.open("r+b") as file:
        file.seek(at)
        file.write(data)


def test_a_log_whose_beginning_is_zeros_hides_nothing(tmp_path: Path) -> None:
    crashed, stream = crashed_journal(tmp_path)
    overwrite(log_file(crashed), 0, bytes(4096))
    assert "log" in kinds(crashed)
    out = tmp_path / "out.journal"
    recover(crashed, out)
    assert firsts(out, stream) == [0, 700, 1400, 2100, 2800]


def test_a_log_whose_copy_of_the_first_page_is_damaged_costs_no_other(tmp_path: Path) -> None:
    crashed, stream = crashed_journal(tmp_path)
    data = log_file(crashed).read_bytes()
    frames = range(HEAD, len(data) - FRAME, FRAME + PAGE_BYTES)
    firsts_of_all = [at for at in frames if data[at : at + 4] == (1).to_bytes(4, "big")]
    assert firsts_of_all
    overwrite(log_file(crashed), firsts_of_all[0] + FRAME, b"x" * 100)
    assert "log" in kinds(crashed)
    out = tmp_path / "out.journal"
    recover(crashed, out)
    assert firsts(out, stream) == [0, 700, 1400, 2100, 2800]
