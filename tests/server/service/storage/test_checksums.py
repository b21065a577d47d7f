"""One flipped bit in anything that is stored is told: by whoever reads it, by a copy, and by the slow look at all."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sqlalchemy import insert, select

from daq.acquisition.blocks import Chunk
from daq.errors import InputError
from server.service.ingest.stored import STORED, chunk_of
from server.service.operation.backup import backup, restore
from server.service.operation.migrate import expected, known, upgrade
from server.service.operation.scrub import Scrub, damage_of
from server.service.settings import DATABASE_FILE, Settings
from server.service.storage.checksums import DamagedError, Sealed, digest_of, sealed
from server.service.storage.database import Database
from server.service.storage.schema import chunks, events, metadata, streams
from tests.server.service.operation.test_migrations import value_of
from tests.server.service.recorded import DESCRIPTION, STREAM, chunks_of, document_of, put
from tests.server.service.running import ServiceReceiver

PLACES = [(t, c) for t in metadata.sorted_tables for c in t.columns if isinstance(c.type, Sealed)]
PLACES += [(chunks, chunks.c.payload), (events, events.c.body), (streams, streams.c.description)]


def filled(settings: Settings, version: str = "head") -> None:
    """A database with a row in each table."""
    database = Database(settings.url)
    upgrade(database)
    empty = np.zeros(3, dtype=np.int64)
    payload = Chunk(7, np.arange(3.0), np.ones((3, 6)), empty, empty > 0, b"raw", [(3, 0.1)], 1e9).to_bytes()
    stored: dict[str, dict[str, Any]] = {
        "chunks": {"first_seq": 7, "n": 3, "first_s": 0.0, "last_s": 2.0, "payload": payload}
        | {"sha256": digest_of(payload)},
        "events": {"body": '{"kind":"note"}', "sha256": digest_of(b'{"kind":"note"}')},
        "streams": {"description": "{}", "sha256": digest_of(b"{}")},
    }
    with database.writing() as connection:
        for table in metadata.sorted_tables:
            row = {c.name: value_of(c) for c in table.columns}
            connection.execute(insert(table).values(row | stored.get(table.name, {})))
    database.close()


def flip(file: Path, table: str, column: str, seed: int) -> None:
    """Turn one bit of a stored value round, as a disk does."""
    with closing(sqlite3.connect(file, isolation_level=None)) as connection:
        at, value = connection.execute(f'SELECT rowid, CAST("{column}" AS BLOB) FROM {table}').fetchone()  # noqa: S608
        bits = bytearray(value)
        place = int(np.random.default_rng(seed).integers(8 * len(bits)))
        bits[place // 8] ^= 1 << place % 8
        connection.execute("DROP TRIGGER IF EXISTS audit_no_update")  # a disk asks nobody
        kind = "BLOB" if column == "payload" else "TEXT"
        change = f'UPDATE {table} SET "{column}" = CAST(? AS {kind}) WHERE rowid = ?'  # noqa: S608
        connection.execute(change, (bytes(bits), at))


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    settings = Settings(data=tmp_path_factory.mktemp("sound"))
    filled(settings)
    backup(settings, settings.data / "copy.db")
    return (settings.data / "copy.db").read_bytes()


@pytest.mark.parametrize("place", range(len(PLACES)), ids=lambda i: f"{PLACES[i][1]}")
def test_a_flipped_bit_is_told_by_whoever_reads_it(sound: bytes, tmp_path: Path, place: int) -> None:
    table, column = PLACES[place]
    settings, copy = Settings(data=tmp_path), tmp_path / DATABASE_FILE
    for seed in range(5):
        copy.write_bytes(sound)
        database = Database(settings.url)
        assert damage_of(database) == []
        flip(copy, table.name, column.name, seed)
        (found,) = damage_of(database)
        assert found.startswith(f"{table.name} ")
        if isinstance(column.type, Sealed):
            with database.reading() as connection, pytest.raises(DamagedError, match=f"{column.name} of {table.name}"):
                connection.execute(select(column)).all()
        if table is chunks:
            with database.reading() as connection, pytest.raises(DamagedError, match="chunk 7 of stream one"):
                chunk_of(connection.execute(select(*STORED)).one())
        database.close()
    with pytest.raises(InputError, match=rf"1 stored rows are damaged: {table.name} .*; expected rows whose checksums"):
        backup(settings, tmp_path / "b.db")
    assert not (tmp_path / "b.db").exists()
    with pytest.raises(InputError, match="stored rows are damaged"):
        restore(Settings(data=tmp_path / "new"), copy)
    assert not (tmp_path / "new" / DATABASE_FILE).exists()


def test_a_chunk_under_another_number_or_time_is_damage(sound: bytes, tmp_path: Path) -> None:
    for change in ("first_seq = 8", "n = 2", "first_s = 0.5", "last_s = 3.0"):
        (tmp_path / "a.db").write_bytes(sound)
        with closing(sqlite3.connect(tmp_path / "a.db")) as connection, connection:
            connection.execute(f"UPDATE chunks SET {change}")  # noqa: S608
        database = Database(f"sqlite:///{tmp_path / 'a.db'}")
        assert len(damage_of(database)) == 1
        database.close()


def test_what_a_look_finds_stands_until_it_is_sound_again(sound: bytes, tmp_path: Path) -> None:
    (tmp_path / "a.db").write_bytes(sound)
    database = Database(f"sqlite:///{tmp_path / 'a.db'}")
    scrub = Scrub(database)
    assert (scrub.checked_utc, scrub.damaged) == (None, ())
    flip(tmp_path / "a.db", "revisions", "document", 0)
    assert scrub.look()
    assert scrub.checked_utc is not None
    assert list(scrub.damaged) == ["revisions one"]
    flip(tmp_path / "a.db", "revisions", "document", 0)
    assert scrub.look()
    assert list(scrub.damaged) == []
    database.close()


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServiceReceiver]:
    made = ServiceReceiver(tmp_path_factory.mktemp("service"))
    yield made
    made.close()


def test_a_damaged_chunk_is_a_failure_of_ours_and_the_health_says_so(service: ServiceReceiver) -> None:
    client = service.client()
    document = document_of("DEV-02")
    client.post("/api/v1/sessions", json={"id": "DEV-02", "document": document}).raise_for_status()
    client.put(f"/api/v1/sessions/DEV-02/streams/{STREAM}", json=DESCRIPTION).raise_for_status()
    for chunk, _ in zip(chunks_of("DEV-02"), range(4), strict=False):
        assert put(client, "DEV-02", chunk).status_code == 200
    file = service.parts.database.file
    assert file is not None
    flip(file, "chunks", "payload", 3)
    assert client.get("/api/v1/health").json()["database"]["damaged"] == 0
    for address in ("readings", "readings?points=2", "cases/c001/readings", "export?format=folder", "check"):
        answer = client.get(f"/api/v1/sessions/DEV-02/{address}")
        problem = answer.json()
        assert answer.status_code == 500
        assert answer.headers["content-type"] == "application/problem+json"
        assert problem["found"].startswith("chunk 0 of stream a")
        assert "Restore a backup" in problem["remedy"]
    health = client.get("/api/v1/health").json()
    assert (health["status"], health["database"]["damaged"]) == ("degraded", 1)
    assert "chunk 0" in json.dumps(health["problems"])


def test_restore_takes_a_backup_of_every_earlier_schema(tmp_path: Path) -> None:
    for version in known()[:-1]:
        file = tmp_path / f"{version}.db"
        database = Database(f"sqlite:///{file}")
        upgrade(database, version)
        with database.writing() as connection:
            # The first schema had no checksums.
            text = '{"a": 1}' if version == "0001" else sealed('{"a": 1}')
            connection.exec_driver_sql(
                "INSERT INTO sessions (id, created_utc, document, version) VALUES ('S', '', ?, 0)", (text,)
            )
        database.close()
        done, _ = restore(Settings(data=tmp_path / f"from-{version}"), file)
        assert (done.revision, done.sessions) == (expected(), 1)
        restored = Database(f"sqlite:///{done.file}")
        with restored.reading() as connection:
            assert connection.execute(select(metadata.tables["sessions"].c.document)).scalar_one() == {"a": 1}
        assert damage_of(restored) == []
        restored.close()


def test_a_document_that_was_damaged_before_it_had_a_checksum_is_told(tmp_path: Path) -> None:
    database = Database(f"sqlite:///{tmp_path / 'a.db'}")
    upgrade(database, "0001")
    with database.writing() as connection:
        connection.exec_driver_sql("INSERT INTO own_effects VALUES ('good', '', '{}'), ('bad', '', '{\"a: 1}')")
    upgrade(database)
    assert damage_of(database) == ["own_effects bad"]
    database.close()
