"""Tokens: made and shown once, kept as a hash, valid until they end or are revoked."""

from __future__ import annotations

import datetime as dt
import hmac
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from daq.errors import InputError
from server import cli
from server.service.operation.folder import held
from server.service.operation.migrate import upgrade
from server.service.security.tokens import FRESH_S, NEW_S, PATTERN, TokenBook, create, listed, revoke
from server.service.settings import DATABASE_FILE
from server.service.storage.database import Database


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    made = Database(f"sqlite:///{tmp_path / DATABASE_FILE}")
    upgrade(made)
    yield made
    made.close()


class Clock:
    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def book_of(database: Database, clock: Clock | None = None) -> TokenBook:
    book = TokenBook(lambda: database, clock or Clock())
    book.refresh()
    return book


def test_a_token_has_256_bits_of_its_own_and_only_its_hash_is_kept(database: Database, tmp_path: Path) -> None:
    texts = [create(database, f"bench {n}", "write")[1] for n in range(20)]
    secrets = {text.split("_")[2] for text in texts}
    assert len(secrets) == 20
    assert all(PATTERN.fullmatch(text) and len(bytes.fromhex(text.split("_")[2])) == 32 for text in texts)
    database.close()
    stored = b"".join(file.read_bytes() for file in tmp_path.iterdir())
    assert not any(secret.encode() in stored or bytes.fromhex(secret) in stored for secret in secrets)


def test_only_the_whole_text_of_a_token_is_valid(database: Database) -> None:
    (token, text), (_, other) = create(database, "a", "read"), create(database, "b", "write")
    book = book_of(database)
    assert book.find(text) == token
    mixed = f"ft_{token.id}_{other.split('_')[2]}"
    for wrong in ("", "ft_", text[:-1], text + "0", text.upper(), f" {text}", mixed, text.replace("ft_", "xx_")):
        assert book.find(wrong) is None


@given(st.text(max_size=100))
def test_no_text_breaks_the_check(text: str) -> None:
    book = TokenBook(lambda: pytest.fail("the database is not asked"), Clock())
    assert book.find(text) is None


def test_a_check_compares_hashes_once_and_in_constant_time_whatever_it_is_given(
    database: Database, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, text = create(database, "a", "read")
    book, compared = book_of(database), []
    compare_digest = hmac.compare_digest

    def compare(a: str, b: str) -> bool:
        compared.append((len(a), len(b)))
        return compare_digest(a, b)

    monkeypatch.setattr(hmac, "compare_digest", compare)
    for given_text in (text, text[:-1] + "x", "ft_00000000_" + "0" * 64, "", "x" * 10_000):
        book.find(given_text)
    assert compared == [(64, 64)] * 5


def test_a_token_ends_at_its_time(database: Database) -> None:
    token, text = create(database, "a", "read", days=1)
    assert token.expires_utc is not None
    ends = dt.datetime.fromisoformat(token.expires_utc)
    assert token.state(ends - dt.timedelta(seconds=1)) == "valid"
    assert token.state(ends) == "expired"
    _, short = create(database, "b", "read", days=1e-12)
    book = book_of(database)
    assert book.find(text) is not None
    assert book.find(short) is None


def test_what_another_process_makes_or_revokes_counts_within_a_second(database: Database) -> None:
    clock = Clock()
    book = book_of(database, clock)
    token, text = create(database, "a", "read")
    assert book.find(text) is None
    clock.now += 2 * NEW_S
    book.refresh()
    assert book.find(text) == token
    assert book.holds(token)
    revoke(database, token.id)
    clock.now += FRESH_S
    book.refresh(known=True)
    assert book.find(text) is None
    assert not book.holds(token)


def test_a_revoked_token_stays_in_the_list_with_the_time_of_its_first_revocation(database: Database) -> None:
    token, _ = create(database, "a", "read")
    first = revoke(database, token.id)
    assert first.state() == "revoked"
    assert revoke(database, token.id) == first
    assert listed(database) == [first]
    with pytest.raises(InputError, match="there is no token 1234; expected an id"):
        revoke(database, "1234")


@pytest.mark.parametrize(("name", "days"), [("", 1), ("  ", 1), ("a\nb", 1), ("x" * 101, 1), ("a", 0), ("a", 1e9)])
def test_a_token_without_a_plain_name_or_time_is_refused(database: Database, name: str, days: float) -> None:
    with pytest.raises(InputError):
        create(database, name, "read", days)
    assert listed(database) == []


def command(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, *words: str) -> tuple[int, str, str]:
    monkeypatch.setattr("sys.argv", ["fingertwin", *words])
    with pytest.raises(SystemExit) as caught:
        cli.main()
    said = capsys.readouterr()
    return int(caught.value.code or 0), said.out, said.err


def test_the_commands_work_on_the_data_of_a_service_that_runs(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    data = ("--data", str(tmp_path / "data"))
    code, out, _ = command(capsys, monkeypatch, "token", "create", "anna", "--role", "write", *data)
    text = out.splitlines()[0]
    assert code == 0
    assert PATTERN.fullmatch(text)
    with held(tmp_path / "data"):
        database = Database(f"sqlite:///{tmp_path / 'data' / DATABASE_FILE}")
        book = book_of(database)
        found = book.find(text)
        assert found is not None
        assert (found.name, found.role) == ("anna", "write")
        made = json.loads(
            command(capsys, monkeypatch, "token", "create", "b", "--role", "read", *data, "--json", "-")[1]
        )
        code, out, _ = command(capsys, monkeypatch, "token", "list", *data)
        assert code == 0
        assert "anna" in out
        assert "valid" in out
        assert not re.search(r"[0-9a-f]{32}", out)
        assert command(capsys, monkeypatch, "token", "revoke", made["id"], *data)[0] == 0
        shown: list[dict[str, Any]] = json.loads(
            command(capsys, monkeypatch, "token", "list", *data, "--json", "-")[1]
        )["tokens"]
        assert {t["name"]: t["state"] for t in shown} == {"anna": "valid", "b": "revoked"}
        assert not any("sha256" in t or "token" in t for t in shown)
        database.close()


def test_the_commands_refuse_what_is_not_there_in_one_line(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for words in (
        ("token", "list", "--data", str(tmp_path / "absent")),
        ("token", "revoke", "12", "--data", str(tmp_path / "absent")),
        ("token", "create", "x", "--role", "read", "--data", str(tmp_path), "--days", "-1"),
        ("token", "create", "x", "--role", "read", "--database-url", "mysql://a/b"),
    ):
        code, out, err = command(capsys, monkeypatch, *words)
        assert (code, out, err.count("\n")) == (2, "", 1)
    assert not (tmp_path / "absent").exists()
