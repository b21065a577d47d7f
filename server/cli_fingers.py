"""Commands on fingers themselves: `scale`, `species`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from server.cli_options import STUDY, Figures, Json, app


@app.command(rich_help_panel=STUDY)
def scale(
    finger: Annotated[str, typer.Argument(help="Name a shipped finger, or a finger file.")],
    out: Annotated[Path, typer.Option(metavar="FILE", help="Write the scaled finger there (finger/1, .yaml).")],
    bone: Annotated[
        list[str] | None,
        typer.Option(metavar="BONE=MM", help="Give the length of a specimen's bone, joint to joint [mm]; repeatable."),
    ] = None,
    moment_arm: Annotated[
        list[str] | None,
        typer.Option(
            metavar="TENDON@JOINT=MM",
            help="Give the mean moment arm over the postures [mm], flexion positive, such as FDP@MCP=10.2; repeatable.",
        ),
    ] = None,
    reference: Annotated[
        list[str] | None,
        typer.Option(
            metavar="BONE=MM",
            help="Give the length of FINGER's own bone, if measured between other points; repeatable.",
        ),
    ] = None,
    postures: Annotated[
        str, typer.Option(metavar="SESSION", help="Average moment arms over the postures of this session.")
    ] = "synek2019_HMEAN",
    json: Json = None,
) -> None:
    """Scale a finger to a specimen's bone lengths, and its tendons to measured moment arms."""
    from server.commands.scaling import scale_specimen

    scale_specimen(finger, bone or [], moment_arm or [], reference or [], postures, out, json)


@app.command(rich_help_panel=STUDY)
def plan(
    out: Annotated[Path, typer.Option(metavar="DIR", help="Write finger, protocol, notebook and sheet there.")],
    finger: Annotated[
        str | None, typer.Option(metavar="FINGER", help="Load this shipped finger or finger file.")
    ] = None,
    bone: Annotated[
        list[str] | None,
        typer.Option(metavar="BONE=MM", help="Scale the finger to a specimen's bone, joint to joint [mm]; repeatable."),
    ] = None,
    moment_arm: Annotated[
        list[str] | None,
        typer.Option(metavar="TENDON@JOINT=MM", help="Give a measured mean moment arm [mm]; repeatable."),
    ] = None,
    reference: Annotated[
        list[str] | None,
        typer.Option(metavar="BONE=MM", help="Give the length of the finger's own bone, measured alike; repeatable."),
    ] = None,
    protocol: Annotated[
        str | None, typer.Option(metavar="PROTOCOL", help="Hang what this file or shipped protocol says.")
    ] = None,
    loads: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Hang this instead: lines such as 'FDP 950, hook, tip'.")
    ] = None,
    posture: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME: ANGLES", help="Set a posture, such as 'hook: MCP 0 PIP 65 DIP 50'; repeatable."),
    ] = None,
    only: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Keep this posture of the protocol; repeatable.")
    ] = None,
    title: Annotated[str | None, typer.Option(help="Write this above the sheet; by default the folder's name.")] = None,
    json: Json = None,
) -> None:
    """Plan a bench day: scale a finger, choose postures and loads, write the sheet to tick (asks for what it lacks)."""
    from server.commands.plan import PlanOptions, plan_bench

    options = PlanOptions(
        out=out,
        finger=finger,
        bones=bone or [],
        moment_arms=moment_arm or [],
        references=reference or [],
        protocol=protocol,
        loads=loads,
        postures=posture or [],
        only=only or [],
        title=title,
    )
    plan_bench(options, json)


@app.command(rich_help_panel=STUDY)
def species(
    of: Annotated[
        str | None,
        typer.Option(
            "--of",
            metavar="FINGER",
            help="Hold against this finger, file or revision; by default the published human, or the session's own.",
        ),
    ] = None,
    other: Annotated[
        str | None,
        typer.Option("--with", metavar="FINGER", help="Compare this one; by default the bonobo, or the session's own."),
    ] = None,
    of_session: Annotated[
        str | None,
        typer.Option(
            metavar="SESSION", help="Take measured forces, loads and postures of the first finger from this session."
        ),
    ] = None,
    with_session: Annotated[
        str | None,
        typer.Option(
            metavar="SESSION", help="Take measured forces, loads and postures of the second finger from this session."
        ),
    ] = None,
    figures: Figures = None,
    json: Json = None,
) -> None:
    """Set two fingers side by side, human and bonobo or any: bones, moment arms, forces per tendon tension."""
    from server.commands.species import compare_fingers

    compare_fingers(of, other, of_session, with_session, figures, json)
