"""A service that is killed while benches send and refits run: a sample of `benchmarks/service_kills.py`."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from tests.server.service.killing import Killed
from tests.server.service.postgres import postgres_url


@pytest.mark.skipif(sys.platform != "linux", reason="looks for the workers of a killed service in /proc")
@pytest.mark.parametrize("kind", ["sqlite", pytest.param("postgresql", marks=pytest.mark.full)])
def test_a_killed_service_has_lost_nothing_and_holds_nothing_by_halves(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    url = postgres_url() if kind == "postgresql" else None
    if url is not None:
        monkeypatch.setenv("FINGERTWIN_DATABASE_URL", url)
    tally = Killed(tmp_path, url, seed=3).run(3, longest_s=1.5, refits=False)
    assert tally.wrong == []
    assert tally.kills.total() == 3
    assert tally.acknowledged["chunks"] > 0
    assert tally.acknowledged["events"] > 0
    assert tally.heard > 0
