"""One service for all tests of a module that do not mind what else it holds."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from fingertwin.client import Client
from tests.client.services import URL, InProcess, receiver_in
from tests.server.service.running import ServiceReceiver


@pytest.fixture(autouse=True)
def _no_token(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("FINGERTWIN_TOKEN", raising=False)


@pytest.fixture(scope="module")
def receiver(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServiceReceiver]:
    with receiver_in(tmp_path_factory.mktemp("service"), workers=1) as found:
        yield found


@pytest.fixture
def line(receiver: ServiceReceiver) -> InProcess:
    return InProcess(receiver)


@pytest.fixture
def twin(line: InProcess) -> Iterator[Client]:
    with Client(URL, transport=line, retries=0) as client:
        yield client
