"""`fingertwin serve`, `token`, `backup`, `restore` and `purge`."""

from __future__ import annotations

import gc
import platform
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from daq.audit import local_user
from daq.errors import InputError
from daq.private import privately
from server.commands.console import answer, progress, say, table
from server.service.operation.backup import backup as copy_database
from server.service.operation.backup import restore as restore_database
from server.service.operation.folder import HeldError, alone, folder_of, held, made, sqlite_of
from server.service.operation.migrate import check, expected, explained, upgrade
from server.service.security.tokens import create, listed, revoke
from server.service.settings import Settings
from server.service.storage.audit import acting, entries
from server.service.storage.database import Database
from server.service.storage.purge import give_back
from server.service.storage.purge import purge as remove
from server.service.storage.reserve import released

if TYPE_CHECKING:
    from daq.audit import Entry
    from server.service.security.tokens import Role, Token
    from server.service.settings import What

Given = Mapping[str, Any]
# Nothing that a service holds is older.
_MOST_DAYS = 100_000


@privately
def serve(given: Given, json: str | None) -> None:
    """Run the service until it is told to stop."""
    # Nothing that is loaded at the start is garbage, and looking for it takes half a second; `app` collects from then.
    gc.disable()
    from server.service.serve import serve as run

    def make(settings: Settings) -> Any:
        from server.service.app import create_app

        return create_app(settings)

    def ready(address: str) -> None:
        if not answer("serve", {"url": address}, json):
            say(f"The service is at {address}; Ctrl-C ends it.")
        sys.stdout.flush()

    run(settings_of(given), make, ready)


@privately
def create_token(given: Given, name: str, role: Role, days: float | None, json: str | None) -> None:
    """Make a token and print it."""
    with database_of(settings_of(given), new=True) as database, acting(local_user(), platform.node()):
        token, text = create(database, name, role, days)
    if answer("token-create", {"token": text, **token.as_dict()}, json):
        return
    say(text)
    until = f"until {token.expires_utc}" if token.expires_utc else "until it is revoked"
    say(f"Token {token.id} of {token.name} may {_may(token)} {until}. It is not shown again.")


def list_tokens(given: Given, json: str | None) -> None:
    """Show the tokens."""
    with database_of(settings_of(given)) as database:
        found = listed(database)
    if answer("token-list", {"tokens": [t.as_dict() for t in found]}, json):
        return
    rows = [[t.id, t.name, t.role, t.state(), t.created_utc[:16], (t.expires_utc or "")[:16] or None] for t in found]
    table("Tokens", ["id", "name", "role", "state", "created (UTC)", "ends (UTC)"], rows)


def revoke_token(given: Given, number: str, json: str | None) -> None:
    """Make a token useless."""
    with database_of(settings_of(given)) as database, acting(local_user(), platform.node()):
        token = revoke(database, number)
    if not answer("token-revoke", token.as_dict(), json):
        say(f"Token {token.id} of {token.name} is revoked; a service that runs refuses it within a second or two.")


@privately
def backup(given: Given, target: Path, json: str | None) -> None:
    """Copy the service's database into one file."""
    with progress("Copying and checking"):
        done = copy_database(settings_of(given), target)
    if not answer("backup", done.as_dict(), json):
        say(f"{done.file}: {_megabytes(done.size_bytes)}, {done.sessions} sessions, checked")


@privately
def restore(given: Given, source: Path, force: bool, json: str | None) -> None:
    """Put a backup in the place of the service's database."""
    with acting(local_user(), platform.node()), progress("Checking and copying"):
        done, aside = restore_database(settings_of(given), source, force=force)
    if answer("restore", {**done.as_dict(), "former": None if aside is None else str(aside)}, json):
        return
    say(f"{done.file}: {_megabytes(done.size_bytes)}, {done.sessions} sessions, checked")
    if aside is not None:
        say(f"The former database is {aside}")


@privately
def purge(given: Given, what: What, older_days: float, session: str | None, dry_run: bool, json: str | None) -> None:
    """Remove what is older than so many days, and give its space back.

    Raises:
        InputError: no such number of days, or the database cannot be used.
    """
    if not 0.0 <= older_days <= _MOST_DAYS:
        found = f"--older-than {older_days:g}"
        raise InputError(found, f"0 to {_MOST_DAYS} days", "Give how many days ago, such as 30")
    settings, given_back = settings_of(given), False
    with (
        nullcontext() if dry_run else released(folder_of(settings)),
        database_of(settings) as database,
        acting(local_user(), platform.node()),
        progress("Counting" if dry_run else "Removing"),
    ):
        done = remove(database, what, older_days, session, dry_run=dry_run)
        if not dry_run:
            try:
                with held(folder_of(settings)), alone(database):
                    given_back = give_back(database, alone=True)
            except HeldError:
                given_back = give_back(database)
    if answer("purge", {**done.as_dict(), "dry_run": dry_run, "given_back": given_back}, json):
        return
    found = {
        "deleted": f"{done.sessions} deleted sessions with {_megabytes(done.chunk_bytes)} of readings",
        "jobs": f"{done.jobs} jobs",
        "messages": f"{done.messages} messages",
    }[what]
    say(f"{found} {'would be' if dry_run else 'are'} removed")
    if not dry_run and not given_back:
        say("Their space is used again; to make the file smaller, end the service and purge once more.")


def entries_of(given: Given) -> list[Entry]:
    """Read the service's trail, oldest entry first."""
    with database_of(settings_of(given)) as database:
        return list(entries(database))


def settings_of(given: Given) -> Settings:
    """Return the settings: what was given, then FINGERTWIN_… variables, then the defaults.

    Raises:
        InputError: one of them cannot be used.
    """
    from pydantic import ValidationError

    try:
        return Settings(**{name: value for name, value in given.items() if value is not None})
    except ValidationError as error:
        first = error.errors()[0]
        name = str(first["loc"][0]) if first["loc"] else "settings"
        said = str(first["msg"]).removeprefix("Input should be ").removeprefix("Value error, ")
        option = f"--{name.replace('_', '-')} or FINGERTWIN_{name.upper()}"
        raise InputError(f"{option} is {str(first.get('input'))[:100]!r}", said) from error


@contextmanager
def database_of(settings: Settings, *, new: bool = False) -> Iterator[Database]:
    """Yield the service's database, which may be in use.

    Raises:
        InputError: there is none and none is to be made, or it cannot be used.
    """
    file = sqlite_of(settings)
    if new:
        made(folder_of(settings))
    elif file is not None and not file.is_file():
        raise InputError(f"there is no database in {file.parent}", "the service's folder", "Give it with --data")
    database = Database(settings.url)
    try:
        if check(database) != expected():
            # Not under a service that runs and knows another version.
            with held(folder_of(settings)), alone(database):
                upgrade(database)
        with explained(database):
            yield database
    finally:
        database.close()


def _may(token: Token) -> str:
    return "read and write" if token.role == "write" else "read"


def _megabytes(size_bytes: int) -> str:
    return f"{size_bytes / 1e6:.1f} MB"
