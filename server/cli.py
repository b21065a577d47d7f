"""The `fingertwin` command. Exit 0 on success, 2 on bad input with one line on stderr, 1 on a failure of ours."""

from __future__ import annotations

import sys
from io import TextIOWrapper
from pathlib import Path
from typing import Annotated, Literal

import typer
from typer.exceptions import TyperException

from daq.errors import InputError, LaterError
from server import cli_bench, cli_fingers, cli_service, cli_studies
from server.cli_options import (
    BEGIN,
    OUT,
    SESSION,
    EffectFiles,
    Figures,
    Json,
    ModelOption,
    Session,
    app,
    effects_like,
    sessions_like,
)
from server.commands.console import refuse_useless
from server.interrupts import lost_interrupts_repeated
from server.leaving import INTERRUPTED, INTERRUPTED_CODE

# Its commands are there once it is imported.
__all__ = ["app", "cli_bench", "cli_fingers", "cli_service", "cli_studies", "main"]


@app.command(rich_help_panel=SESSION)
def check(session: Session, json: Json = None) -> None:
    """Validate a session: format, windows, plateaus, drift, saturation, gaps."""
    from server.commands.bench import check_session

    check_session(session, json)


@app.command(rich_help_panel=SESSION)
def amend(
    session: Session,
    case: Annotated[
        str | None,
        typer.Argument(
            help="Name the load case that was entered wrongly; or a block of them: a posture, tip, bone, all, c017.. "
            "(from it on), c017..c032, or several of these that hold together, such as hook,bone."
        ),
    ] = None,
    tendon: Annotated[
        list[str] | None,
        typer.Option(metavar="TRUE=ENTERED", help="FDS=FDP says that the weight hung on FDS, where FDP was entered."),
    ] = None,
    mass: Annotated[
        list[str] | None, typer.Option(metavar="TENDON=GRAMS", help="Say what really hung there; 0 stands for nothing.")
    ] = None,
    weight: Annotated[
        list[str] | None,
        typer.Option(metavar="TRUE=ENTERED", help="550=484 says that the weight entered as 484 g weighs 550 g."),
    ] = None,
    posture: Annotated[str | None, typer.Option(help="Name the posture that was really set.")] = None,
    mount: Annotated[str | None, typer.Option(metavar="tip|bone", help="Say where the cell really was.")] = None,
    exchange: Annotated[
        str | None, typer.Option(metavar="CASE", help="Name another case that was entered in this one's place.")
    ] = None,
    exclude: Annotated[bool, typer.Option("--exclude", help="Leave the case out.")] = False,
    undo: Annotated[bool, typer.Option("--undo", help="Take the case's last amendment back.")] = False,
    why: Annotated[str | None, typer.Option(help="Say how it is known; this is kept with the amendment.")] = None,
    by: Annotated[
        str | None, typer.Option(metavar="NAME", help="Name who says so; the trail keeps the user of this machine too.")
    ] = None,
    json: Json = None,
) -> None:
    """Say what a load case really was; the entry stays, and the amendment is heeded and shown everywhere."""
    from server.commands.amend import amend_case

    amend_case(
        session,
        case,
        tendon=tendon or [],
        mass=mass or [],
        weight=weight or [],
        posture=posture,
        location=mount,
        exchange=exchange,
        exclude=exclude,
        undo=undo,
        why=why,
        by=by,
        json=json,
    )


@app.command(rich_help_panel=SESSION)
def friction(
    sessions: Annotated[list[str], typer.Argument(autocompletion=sessions_like, help="Name one or more sessions.")],
    json: Json = None,
) -> None:
    """Find the friction factor by force balance (Synek 2019 Eq 1): per case, specimen and pooled."""
    from server.commands.bench import friction_of

    friction_of(sessions, json)


@app.command(rich_help_panel=SESSION)
def compare(
    session: Session, model: ModelOption = None, effect: EffectFiles = None, figures: Figures = None, json: Json = None
) -> None:
    """Compare predicted with measured forces, per load case and summarised."""
    from server.commands.twin import compare_session

    compare_session(session, model, effect or [], figures, json)


@app.command(rich_help_panel=SESSION)
def refit(
    session: Session,
    method: Annotated[
        Literal["map", "slsqp"],
        typer.Option(help="map fits all parameters at once, with priors; slsqp solves the three problems of Eq 5."),
    ] = "map",
    model: ModelOption = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="MODEL", help="Write the revision there; by default to models/SESSION-rN.json."),
    ] = None,
    plane: Annotated[
        Literal["sagittal", "space"] | None,
        typer.Option(help="Fit these force components; by default those that the finger's axes can predict."),
    ] = None,
    effect: EffectFiles = None,
    figures: Figures = None,
    json: Json = None,
) -> None:
    """Identify the parameters from the identification cases; validation cases are never fitted."""
    from server.commands.twin import refit_session

    refit_session(session, method, model, out, plane, effect or [], figures, json)


@app.command(rich_help_panel=SESSION)
def diagnose(
    sessions: Annotated[
        list[str], typer.Argument(autocompletion=sessions_like, help="Name one session; several are also pooled.")
    ],
    model: ModelOption = None,
    thorough: Annotated[
        bool,
        typer.Option(help="Try more starts and pairs, and every single effect to its end; this may take a minute."),
    ] = False,
    effect: EffectFiles = None,
    frozen: Annotated[
        list[Path] | None,
        typer.Option(metavar="FILE", help="Score these predictions of `next --freeze`; by default those in models."),
    ] = None,
    permutations: Annotated[
        int | None,
        typer.Option(
            metavar="N", help="With several sessions, hold what they share against so many shuffles; by default 199."
        ),
    ] = None,
    law: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="With several sessions, write the best law that they share as an effect file."
        ),
    ] = None,
    figures: Figures = None,
    json: Json = None,
) -> None:
    """Find where the model fails and which physical effect is missing, or that the data cannot say."""
    if len(sessions) > 1:
        from server.commands.pooling import diagnose_sessions

        refuse_useless("with several sessions", "one session", frozen=frozen)
        diagnose_sessions(sessions, model, thorough, effect or [], figures, json, permutations, law)
        return
    from server.commands.diagnosis import diagnose_session

    refuse_useless("with one session", "several sessions", law=law, permutations=permutations)
    diagnose_session(sessions[0], model, thorough, effect or [], frozen, figures, json)


@app.command("next", rich_help_panel=SESSION)
def next_load_cases(
    session: Session,
    model: ModelOption = None,
    effect: EffectFiles = None,
    freeze: Annotated[
        bool, typer.Option(help="Write the explanations' predictions down before they are measured.")
    ] = False,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Freeze them there; by default in models/SESSION-frozen-….json.")
    ] = None,
    json: Json = None,
) -> None:
    """Find the load cases that would best tell the remaining explanations apart."""
    from server.commands.planning import next_cases

    if not freeze:
        refuse_useless("without --freeze", "--freeze beside it", out=out)
    next_cases(session, model, effect or [], freeze, out, json)


@app.command(rich_help_panel=SESSION)
def add(
    names: Annotated[
        list[str],
        typer.Argument(
            metavar="EFFECT... SESSION", autocompletion=effects_like, help="Name the effects, then the session."
        ),
    ],
    without: Annotated[
        list[str] | None, typer.Option(metavar="EFFECT", help="Take this effect out of the model; repeatable.")
    ] = None,
    model: ModelOption = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="MODEL", help="Write the revision there; by default to models/SESSION-rN.json."),
    ] = None,
    shared: Annotated[
        list[str] | None,
        typer.Option(metavar="SESSION", help="Add the effects to this session as well; repeatable."),
    ] = None,
    figures: Figures = None,
    json: Json = None,
) -> None:
    """Add effects to the model, refit, and report the fall of the error on cases that were never fitted."""
    from server.commands.additions import add_to_sessions

    add_to_sessions(names, shared or [], without or [], model, out, figures, json)


@app.command(rich_help_panel=SESSION)
def effects(
    name: Annotated[
        str | None,
        typer.Argument(autocompletion=effects_like, help="Name one effect or its file; by default all are listed."),
    ] = None,
    json: Json = None,
) -> None:
    """Show effects: formula, parameters, units, ranges, source."""
    from server.commands.additions import show_effects

    show_effects(name, json)


@app.command(rich_help_panel=OUT)
def export(
    source: Annotated[
        str, typer.Argument(help="Name a session or a revision of a model; for osim and mjcf a revision or a finger.")
    ],
    file_format: Annotated[
        Literal["csv", "parquet", "xlsx", "hdf5", "c3d", "mat", "supplement", "osim", "mjcf"],
        typer.Option(
            "--format",
            help="Choose what to write: supplement is one archive for a paper, without private names; "
            "osim and mjcf hold the finger for OpenSim or MuJoCo.",
        ),
    ] = "csv",
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write this file; by default NAME with the format's ending, in this folder."),
    ] = None,
    model: ModelOption = None,
    json: Json = None,
) -> None:
    """Export a session's load cases (measured and predicted), its readings, a model's parameters, or a finger."""
    from server.commands.files import export_source

    export_source(source, file_format, out, model, json)


@app.command(rich_help_panel=BEGIN)
def demo(
    out: Annotated[Path, typer.Option(metavar="DIR", help="Write the reports in this folder.")] = Path("demo-output"),
    json: Json = None,
) -> None:
    """Run the main job on shipped data: replay, check, compare, refit, and the falling error."""
    from server.commands.demo import run_demo

    run_demo(out, json)


def version(value: bool) -> None:
    """Print the version and leave."""
    if value:
        from importlib.metadata import version as installed

        typer.echo(f"fingertwin {installed('fingertwin')}")
        raise typer.Exit


@app.callback()
def options(
    _: Annotated[bool, typer.Option("--version", callback=version, is_eager=True, help="Print the version.")] = False,
) -> None:
    """Log a load cell under a cadaver finger, compare it with a finger model, refit, and see the error fall."""


# Of a command that cannot be carried out now and may be later, as sysexits.h has it; 2 is for what never can be.
AGAIN_LATER = 75


def main() -> None:
    """Run the command line."""
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # where an encoding lacks a letter, a ? does
    try:
        with lost_interrupts_repeated():
            code = app(sys.argv[1:] or ["--help"], prog_name="fingertwin", standalone_mode=False)
    except InputError as error:
        _fail(str(error), AGAIN_LATER if isinstance(error, LaterError) else 2)
    except TyperException as error:
        text = " ".join(error.format_message().replace("Value error, ", "").split()).rstrip(".")
        context = getattr(error, "ctx", None)
        command = context.command_path if context else "fingertwin"
        _fail(f"{text}{'' if text.endswith('?') else '.'} Try '{command} --help'.", 2)
    except SystemExit as ended:
        # Typer ends with 1 where the reader of our output has gone: nothing is wrong.
        raise SystemExit(0 if isinstance(ended.__context__, BrokenPipeError) else ended.code) from None
    except (KeyboardInterrupt, typer.Abort):
        _fail(INTERRUPTED, INTERRUPTED_CODE)
    except BrokenPipeError:
        # The reader of our output has gone: nothing is wrong, and nothing more can be said.
        sys.stderr.close()
        raise SystemExit(0) from None
    except OSError as error:
        where = f": {error.filename}" if error.filename else ""
        _fail(f"{error.strerror or error}{where}. Check the path, its rights and the space left.", 2)
    if code == INTERRUPTED_CODE:  # Typer makes Ctrl-C within a command an exit code
        _fail(INTERRUPTED, INTERRUPTED_CODE)
    raise SystemExit(code if isinstance(code, int) else 0)


def _fail(text: str, code: int) -> None:
    sys.stderr.write(f"fingertwin: {text}\n")
    raise SystemExit(code)


if __name__ == "__main__":
    main()
