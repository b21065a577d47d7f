"""A service of its own for each test of sessions."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.server.service.running import ServiceReceiver


@pytest.fixture
def fresh(tmp_path: Path) -> Iterator[ServiceReceiver]:
    out = ServiceReceiver(tmp_path)
    yield out
    out.close()
