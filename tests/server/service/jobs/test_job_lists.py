"""A session's jobs of some kinds, in pages: jobs of other kinds between them take no place away."""

from __future__ import annotations

from pathlib import Path

from server.service.schemas.sessions import DOCUMENT
from tests.server.service.running import ServiceReceiver


def test_a_sessions_jobs_are_paged_by_kind_without_loss(tmp_path: Path) -> None:
    service = ServiceReceiver(tmp_path)
    client = service.client()
    client.post("/api/v1/sessions", json={"id": "H01", "document": DOCUMENT}).raise_for_status()
    place = "/api/v1/sessions/H01"
    asked = []
    for k in range(5):
        asked.append(client.post(f"{place}/fits", json={"model": ["an1979_middle", None][k % 2]}).json()["id"])
        client.post(f"{place}/diagnoses", json={"thorough": k % 2 == 0}).raise_for_status()
        client.post(f"/api/v1/jobs/{asked[-1]}/cancel")
    seen: list[str] = []
    after = None
    while True:
        page = client.get(f"{place}/fits", params={"limit": 2} | ({"after": after} if after else {})).json()
        assert {job["kind"] for job in page["jobs"]} <= {"refit"}
        seen += [job["id"] for job in page["jobs"]]
        if (after := page["next"]) is None:
            break
    assert seen == list(reversed(dict.fromkeys(asked)))
    assert len(seen) > 2
    assert client.get(f"{place}/fits", params={"after": "none"}).status_code == 404
    service.close()
