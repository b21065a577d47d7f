"""Commands of the model service: `serve`, `token`, `backup`, `restore`, `purge`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from server.cli_options import SERVICE, Json, app

Data = Annotated[
    Path | None,
    typer.Option(
        metavar="DIR", help="Name the folder of the service's data; by default FINGERTWIN_DATA or the user's own."
    ),
]
DatabaseUrl = Annotated[
    str | None,
    typer.Option(
        metavar="URL", help="Use another database than SQLite in that folder: postgresql+psycopg://USER@HOST/NAME."
    ),
]


@app.command(rich_help_panel=SERVICE)
def serve(
    host: Annotated[
        str | None, typer.Option(help="Listen on this address; any but this machine's own needs tokens [127.0.0.1].")
    ] = None,
    port: Annotated[int | None, typer.Option(help="Listen on this port; 0 takes any free one [8765].")] = None,
    data: Data = None,
    database_url: DatabaseUrl = None,
    workers: Annotated[
        int | None, typer.Option(help="Refit and diagnose in so many processes; by default half the cores, at most 4.")
    ] = None,
    log_format: Annotated[
        Literal["text", "json"] | None, typer.Option(help="Write the log in this format, on standard error.")
    ] = None,
    log_level: Annotated[
        Literal["debug", "info", "warning", "error"] | None,
        typer.Option(help="Log events of this level and above [info]."),
    ] = None,
    json: Json = None,
) -> None:
    """Run the model service until Ctrl-C."""
    from server.commands.service import serve as run

    given = {"host": host, "port": port, "data": data, "database_url": database_url, "workers": workers}
    run(given | {"log_format": log_format, "log_level": log_level}, json)


token_app = typer.Typer(help="Say who may use the service from elsewhere.", no_args_is_help=True)
app.add_typer(token_app, name="token", rich_help_panel=SERVICE)


@token_app.command("create")
def token_create(
    name: Annotated[str, typer.Argument(help="Name who or what uses the token.")],
    role: Annotated[Literal["read", "write"], typer.Option(help="Say what the token may do; write may read too.")],
    days: Annotated[float | None, typer.Option(help="End the token after so many days; by default never.")] = None,
    data: Data = None,
    database_url: DatabaseUrl = None,
    json: Json = None,
) -> None:
    """Make a token and print it, once: it is kept nowhere."""
    from server.commands.service import create_token

    create_token({"data": data, "database_url": database_url}, name, role, days, json)


@token_app.command("list")
def token_list(data: Data = None, database_url: DatabaseUrl = None, json: Json = None) -> None:
    """Show the tokens without their secrets."""
    from server.commands.service import list_tokens

    list_tokens({"data": data, "database_url": database_url}, json)


@token_app.command("revoke")
def token_revoke(
    number: Annotated[str, typer.Argument(metavar="ID", help="Give an id of `token list`.")],
    data: Data = None,
    database_url: DatabaseUrl = None,
    json: Json = None,
) -> None:
    """Make a token useless, also for a service that runs."""
    from server.commands.service import revoke_token

    revoke_token({"data": data, "database_url": database_url}, number, json)


@app.command(rich_help_panel=SERVICE)
def backup(
    file: Annotated[Path, typer.Argument(help="Write this new file.")],
    data: Data = None,
    database_url: DatabaseUrl = None,
    json: Json = None,
) -> None:
    """Copy the service's database into one file, also while the service runs."""
    from server.commands.service import backup as run

    run({"data": data, "database_url": database_url}, file, json)


@app.command(rich_help_panel=SERVICE)
def restore(
    file: Annotated[Path, typer.Argument(help="Name a backup's file.")],
    force: Annotated[
        bool, typer.Option("--force", help="Take the place of a database that is there; it is kept under another name.")
    ] = False,
    data: Data = None,
    database_url: DatabaseUrl = None,
    json: Json = None,
) -> None:
    """Put a backup in the place of the service's database; the service must not run."""
    from server.commands.service import restore as run

    run({"data": data, "database_url": database_url}, file, force, json)


@app.command(rich_help_panel=SERVICE)
def purge(
    what: Annotated[
        Literal["deleted", "jobs", "messages"],
        typer.Argument(
            help="Remove the content of deleted sessions; jobs that have ended, with their results; or messages of the "
            "live stream, but those of running benches."
        ),
    ],
    older_than: Annotated[
        float, typer.Option(metavar="DAYS", help="Remove what was deleted, ended or told so long ago.")
    ] = 30.0,
    session: Annotated[str | None, typer.Option(metavar="ID", help="Remove that of this session only.")] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Count only.")] = False,
    data: Data = None,
    database_url: DatabaseUrl = None,
    json: Json = None,
) -> None:
    """Remove for good what nobody needs any more, and give its space back; the service may run meanwhile."""
    from server.commands.service import purge as run

    run({"data": data, "database_url": database_url}, what, older_than, session, dry_run, json)


@app.command(rich_help_panel=SERVICE)
def audit(
    folder: Annotated[
        Path | None, typer.Argument(help="Name a session's or models' folder; by default it is the service's trail.")
    ] = None,
    data: Data = None,
    database_url: DatabaseUrl = None,
    json: Json = None,
) -> None:
    """Show who changed what, when and from where, and check that the trail is as it was written."""
    from server.commands.audit import show_audit

    show_audit(folder, {"data": data, "database_url": database_url}, json)
