"""Small files that would fill a computer's memory are refused before anything makes room for them."""

from __future__ import annotations

import gzip
import tracemalloc
from pathlib import Path

import pytest

from daq.errors import ReadingsError
from daq.lab.files import AXES
from daq.lab.opened import open_channels
from daq.recordings.columns import HEADERS
from daq.recordings.readings import open_readings
from tests.daq.lab_bombs import BOMBS


@pytest.mark.parametrize("name", BOMBS)
def test_a_small_file_that_claims_far_more_than_it_holds_is_refused(name: str, tmp_path: Path) -> None:
    file = BOMBS[name](tmp_path / name)
    assert file.stat().st_size < 2 << 20
    tracemalloc.start()
    try:
        with pytest.raises(ReadingsError) as caught:
            list(open_channels(file).blocks([f"ATI/{axis}" for axis in AXES]))
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)
    assert most < 32 << 20


@pytest.mark.parametrize("rows", [b"0.5,0,0,0,0,0,0\n", b"\n"], ids=["numbers", "empty lines"])
def test_a_gzip_file_that_is_unpacked_to_far_more_than_it_holds_is_refused(
    rows: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("daq.recordings.unpacking.MODEST", 1 << 20)
    first = ",".join(HEADERS).encode() + b"\n" + 6 * b"0.0,1,2,3,4,5,6\n"
    file = tmp_path / "bomb.csv.gz"
    file.write_bytes(gzip.compress(first + rows * ((3 << 20) // len(rows))))
    assert file.stat().st_size < 10_000
    said = "bomb.csv.gz has [0-9]+ bytes and is unpacked to more than 1[0-9]{6}; expected at most 100 times"
    with pytest.raises(ReadingsError, match=said):
        list(open_channels(file).blocks(HEADERS))
    with pytest.raises(ReadingsError, match=said):
        list(open_readings(file).blocks())
