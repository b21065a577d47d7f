"""The `fingertwin` application, and the options that its commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(
    name="fingertwin",
    help="Log a load cell under a cadaver finger, compare it with a finger model, refit, and see the error fall.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)

Session = Annotated[str, typer.Argument(help="Session folder, its session.yaml, or the name of a shipped session.")]
Json = Annotated[
    str | None, typer.Option("--json", metavar="FILE", help="Write the answer as JSON ('-' for standard output).")
]
ModelOption = Annotated[
    str | None,
    typer.Option(
        "--model", metavar="FILE", help="A revision, a finger file or a shipped finger; by default the session's."
    ),
]
EffectFiles = Annotated[
    list[str] | None,
    typer.Option("--effect", metavar="FILE", help="An effect of your own (.yaml formulas, or .py); repeatable."),
]
ServiceOption = Annotated[
    str | None, typer.Option("--to", metavar="URL", help="A service that it goes to; a token in FINGERTWIN_TOKEN.")
]
Figures = Annotated[
    Path | None, typer.Option("--figures", metavar="DIR", help="Write figures there: one HTML page, PNG and SVG.")
]
