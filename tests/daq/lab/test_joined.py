"""Recordings whose header is in our own notation: their text is read as any program may have written it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from daq.errors import InputError
from daq.lab.drafts import joined
from daq.recordings.readings import ReadingBlock, write_readings

HEADER = "Time (s),Fx (N),Fy (N),Fz (N),Tx (N-m),Ty (N-m),Tz (N-m)"
WRENCH = np.random.default_rng(0).normal(size=(400, 6)).round(4)
ROWS = [",".join([f"{k / 100:.2f}", *(f"{v:.4f}" for v in row)]) for k, row in enumerate(WRENCH)]
IN_OURS = WRENCH * ([1.0] * 3 + [1000.0] * 3)


def read(path: Path) -> tuple[np.ndarray, np.ndarray | None, tuple[str, ...]]:
    """Wrench, status and notes of a recording that no mapping belongs to."""
    with joined([path], None) as readings:
        blocks = list(readings)
    status = [b.status for b in blocks if b.status is not None]
    return np.concatenate([b.wrench for b in blocks]), np.concatenate(status) if status else None, readings.notes


def written(folder: Path, lines: Sequence[str], end: str = "\n") -> Path:
    path = folder / "rig.csv"
    path.write_text("\n".join(lines) + end, "utf-8")
    return path


def test_a_heading_told_again_and_remarks_are_passed_over(tmp_path: Path) -> None:
    path = written(tmp_path, [HEADER, *ROWS[:150], HEADER, *ROWS[150:310], "# restart", *ROWS[310:]])
    wrench, _, notes = read(path)
    np.testing.assert_allclose(wrench, IN_OURS, rtol=1e-12)
    assert any("Tx (N-m) [N-m] × 1000" in note for note in notes)


@pytest.mark.parametrize("kept", [len(ROWS[-1]) - 2, 12])
def test_a_row_that_was_cut_off_is_left_out_and_said(kept: int, tmp_path: Path) -> None:
    wrench, _, notes = read(written(tmp_path, [HEADER, *ROWS[:-1], ROWS[-1][:kept]], ""))
    np.testing.assert_allclose(wrench, IN_OURS[:-1], rtol=1e-12)
    assert any(note.startswith("rig.csv is cut off") for note in notes)


@pytest.mark.parametrize("flag", ["2147483653", "0x80000005"])
def test_its_status_is_read(flag: str, tmp_path: Path) -> None:
    flags = ["0"] * 200 + [flag] * 200
    path = written(tmp_path, [HEADER + ",status", *(f"{row},{f}" for row, f in zip(ROWS, flags, strict=True))])
    _, status, notes = read(path)
    assert status is not None
    assert status.tolist() == [0] * 200 + [0x80000005] * 200
    assert not any("saturation was not looked for" in note for note in notes)


@pytest.mark.parametrize("flag", ["0.5", "1e300"])
def test_a_status_that_is_no_whole_number_is_refused(flag: str, tmp_path: Path) -> None:
    path = written(tmp_path, [HEADER + ",status", *(f"{row},{flag if k == 7 else 0}" for k, row in enumerate(ROWS))])
    with pytest.raises(InputError, match=r"reading 8: status is .*; expected a whole number"):
        read(path)


@pytest.mark.parametrize("remarks", [{}, {120: "touched"}, {0: '"a, b"'}])
def test_a_column_of_remarks_is_left_out(remarks: dict[int, str], tmp_path: Path) -> None:
    path = written(tmp_path, [HEADER + ",remark", *(f"{row},{remarks.get(k, '')}" for k, row in enumerate(ROWS))])
    np.testing.assert_allclose(read(path)[0], IN_OURS, rtol=1e-12)


def test_what_we_wrote_ourselves_is_read_as_it_is(tmp_path: Path) -> None:
    status = np.arange(400, dtype=np.int64)
    block = ReadingBlock(np.arange(400) / 100.0, IN_OURS, status)
    for name in ("a.csv", "a.csv.gz", "a.parquet"):
        wrench, flags, _ = read(write_readings(tmp_path / name, [block]))
        np.testing.assert_array_equal(wrench, IN_OURS)
        assert flags is not None
        np.testing.assert_array_equal(flags, status)


def test_a_cell_without_a_number_is_named(tmp_path: Path) -> None:
    path = written(tmp_path, [HEADER, *ROWS[:120], ROWS[120].replace(",", ",x", 1), *ROWS[121:]])
    with pytest.raises(InputError, match=r"rig.csv, line 122: Fx \(N\) is 'x"):
        read(path)
