"""A service that is killed while benches send and refits run: a sample of `benchmarks/service_kills.py`."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from tests.server.service.killing import Killed


@pytest.mark.skipif(sys.platform != "linux", reason="looks for the workers of a killed service in /proc")
def test_a_killed_service_has_lost_nothing_and_holds_nothing_by_halves(tmp_path: Path) -> None:
    tally = Killed(tmp_path, seed=3).run(3, longest_s=1.5, refits=False)
    assert tally.wrong == []
    assert tally.kills.total() == 3
    assert tally.acknowledged["chunks"] > 0
    assert tally.acknowledged["events"] > 0
    assert tally.heard > 0
