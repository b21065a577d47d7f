"""The service's trail: every change with its token, in the database's own keeping, on a page and in exports."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from sqlalchemy import text
from sqlalchemy.exc import DatabaseError

from daq.audit import Entry, faults
from server.service.security.tokens import create, revoke
from server.service.storage.audit import entries, faults_of
from tests.server.command_line import run
from tests.server.service.recorded import small
from tests.server.service.running import ServiceReceiver

AT = "/api/v1/sessions/S1"


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServiceReceiver]:
    out = ServiceReceiver(tmp_path_factory.mktemp("service"))
    yield out
    out.close()


@pytest.fixture(scope="module")
def changed(service: ServiceReceiver) -> ServiceReceiver:
    """A session that was made by nobody known, and edited with a token."""
    token, secret = create(service.parts.database, "Anna", "write")
    client = service.client()
    client.post("/api/v1/sessions", json={"id": "S1", "document": small()}).raise_for_status()
    case = small()["cases"][0]["id"]
    mine = {"Authorization": f"Bearer {secret}"}
    client.post(f"{AT}/cases/{case}/exclude", json={"reason": "slipped"}, headers=mine).raise_for_status()
    assert client.post(f"{AT}/cases/{case}/include", json={"author": "Otto"}, headers=mine).status_code == 422
    revoke(service.parts.database, token.id)
    return service


def test_each_change_is_kept_with_the_name_of_its_token_and_not_the_clients_word(changed: ServiceReceiver) -> None:
    told = [(e.who, e.what, e.about) for e in entries(changed.parts.database)]
    assert told == [
        ("service", "token made", None),
        ("local", "session created", "S1"),
        ("Anna", "session edited", "S1"),
        ("service", "token revoked", None),
    ]
    (edit,) = changed.client().get(f"{AT}/edits").json()["edits"]
    assert edit["author"] == "Anna"
    assert "token" in list(entries(changed.parts.database))[2].origin


def test_the_database_refuses_to_change_or_remove_an_entry(changed: ServiceReceiver) -> None:
    database = changed.parts.database
    for statement in ("UPDATE audit SET who = 'Otto'", "DELETE FROM audit WHERE number = 2"):
        with pytest.raises(DatabaseError, match="only ever added to"), database.writing() as connection:
            connection.execute(text(statement))
    assert faults_of(database) == []


def test_the_trail_is_listed_checked_and_exported(changed: ServiceReceiver) -> None:
    client = changed.client()
    body = client.get("/api/v1/audit", params={"check": True, "limit": 2}).json()
    assert ([e["number"] for e in body["entries"]], body["faults"]) == ([1, 2], [])
    later = client.get("/api/v1/audit", params={"after": 2, "session": "S1"}).json()["entries"]
    assert [e["what"] for e in later] == ["session edited"]
    lines = client.get("/api/v1/audit/export").text.splitlines()
    assert faults([Entry(**json.loads(line)) for line in lines]) == []
    columns = client.get(f"{AT}/export", params={"format": "columns"}).json()
    assert [e["who"] for e in columns["audit"]] == ["local", "Anna"]


def test_the_command_line_keeps_a_trail_and_tells_where_one_was_changed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run("token", "create", "Anna", "--role", "read", "--data", tmp_path / "data").code == 0
    body = run("audit", "--data", tmp_path / "data", "--json", "-").body("audit")
    assert [(e["what"], e["details"]["name"]) for e in body["entries"]] == [("token made", "Anna")]
    assert run("refit", "synek2019_H01", "--method", "slsqp").code == 0
    (entry,) = run("audit", "models", "--json", "-").body("audit")["entries"]
    assert (entry["what"], entry["about"], entry["details"]["file"]) == (
        "refit",
        "synek2019_H01",
        "synek2019_H01-r1.json",
    )
    file = tmp_path / "models" / "audit.jsonl"
    file.write_text(file.read_text(encoding="utf-8").replace("synek2019_H01-r1", "synek2019_H01-r2"), encoding="utf-8")
    answer = run("audit", "models")
    assert (answer.code, answer.out.splitlines()[0]) == (2, "error    entry 1 was changed")
    assert "entry 1 was changed" in answer.err
    assert run("audit", tmp_path / "none").code == 2
