"""Replays of one session to a service, of which one broke off."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.server.service.recorded import chunks_of, describe, document_of, holding, put
from tests.server.service.running import ServiceReceiver

RECORDED = "DEV-01"
AT = "/api/v1/sessions"


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServiceReceiver]:
    yield from holding(tmp_path_factory.mktemp("service"), RECORDED)


def test_a_replay_that_broke_off_is_made_whole_by_the_next(service: ServiceReceiver, fresh: ServiceReceiver) -> None:
    client, document = fresh.client(), document_of(RECORDED)
    chunks = list(chunks_of(RECORDED))
    # Readings alone, as of a journal, and not all of them.
    client.post(AT, json={"id": RECORDED}).raise_for_status()
    describe(client, RECORDED)
    for chunk in chunks[: len(chunks) // 2]:
        put(client, RECORDED, chunk).raise_for_status()
    assert client.get(f"{AT}/{RECORDED}/comparison").status_code in (409, 422)
    again = client.post(AT, json={"id": RECORDED, "document": document})
    assert (again.status_code, again.json()["source"]) == (200, "document")
    describe(client, RECORDED, "b" * 32)
    for chunk in chunks:
        put(client, RECORDED, chunk, "b" * 32).raise_for_status()
    answer, whole = (c.get(f"{AT}/{RECORDED}/comparison").json() for c in (client, service.client()))
    assert answer["cases"] == whole["cases"]
    assert answer["waiting"] == answer["failed"] == {}
    assert client.post(AT, json={"id": RECORDED, "document": document | {"gravity_m_s2": 9.8}}).status_code == 409
