"""The `fingertwin` application, and the options that its commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from daq.files import require_writable

# Groups of commands, in the order in which help shows them.
GROUPS = BEGIN, SESSION, BENCH, STUDY, OUT, SERVICE = (
    "To begin",
    "From a session to the missing effect",
    "At the bench",
    "Fingers, studies and plans",
    "For other programs",
    "Model service",
)


class Grouped(TyperGroup):
    """A command group whose help lists its commands in groups, each with the whole sentence that it does."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the groups; commands of none stand under Commands."""
        groups: dict[str, list[tuple[str, str]]] = {}
        for name, command in self.commands.items():
            panel = getattr(command, "rich_help_panel", None)
            group = panel if isinstance(panel, str) else "Commands"
            groups.setdefault(group, []).append((name, (command.help or "").partition("\n")[0]))
        for group in [*(g for g in GROUPS if g in groups), *(g for g in groups if g not in GROUPS)]:
            with formatter.section(group):
                formatter.write_dl(groups[group])


def sessions_like(incomplete: str) -> list[str]:
    """Return names of shipped sessions, for the shell to complete; folders it knows itself."""
    from daq.sessions import session_names

    return [name for name in session_names() if name.startswith(incomplete)]


def effects_like(incomplete: str) -> list[str]:
    """Return names of effects, and of sessions, for the shell to complete."""
    from fingermodel.effects.catalogue import EFFECTS
    from fingermodel.effects.user import shipped_effects

    return [name for name in (*EFFECTS, *shipped_effects()) if name.startswith(incomplete)] + sessions_like(incomplete)


def _writable_file(ctx: typer.Context, file: str | None) -> str | None:
    """Refuse a file that cannot be written before anything is computed for it."""
    if file not in (None, "-") and not ctx.resilient_parsing:
        require_writable(Path(file))
    return file


def _writable_folder(ctx: typer.Context, folder: Path | None) -> Path | None:
    if folder is not None and not ctx.resilient_parsing:
        require_writable(folder, folder=True)
    return folder


app = typer.Typer(
    name="fingertwin",
    cls=Grouped,
    help="Log a load cell under a cadaver finger, compare it with a finger model, refit, and see the error fall.",
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)

Session = Annotated[
    str,
    typer.Argument(
        autocompletion=sessions_like, help="Name a session's folder, its session.yaml, or a shipped session."
    ),
]
Json = Annotated[
    str | None,
    typer.Option(
        "--json",
        metavar="FILE",
        callback=_writable_file,
        help="Write the answer as JSON ('-' for standard output).",
    ),
]
ModelOption = Annotated[
    str | None,
    typer.Option(
        "--model",
        metavar="FILE",
        help="Use this model: a revision, a finger file or a shipped finger; by default the session's finger.",
    ),
]
EffectFiles = Annotated[
    list[str] | None,
    typer.Option(
        "--effect",
        metavar="FILE",
        help="Add an effect of your own to the catalogue (.yaml formulas, or .py); repeatable.",
    ),
]
ServiceOption = Annotated[
    str | None, typer.Option("--to", metavar="URL", help="Send it to this service, with the token in FINGERTWIN_TOKEN.")
]
Figures = Annotated[
    Path | None,
    typer.Option(
        "--figures",
        metavar="DIR",
        callback=_writable_folder,
        help="Write figures in this folder: one HTML page, PNG and SVG.",
    ),
]
