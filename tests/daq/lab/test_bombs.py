"""Small files that would fill a computer's memory are refused before anything makes room for them."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import pytest

from daq.errors import ReadingsError
from daq.lab.files import AXES
from daq.lab.opened import open_channels
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
