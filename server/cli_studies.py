"""Commands of studies beside a bench session: inversion, published studies, movement, activation, simulation."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from server.cli_options import STUDY, Figures, Json, ModelOption, Session, app


@app.command(rich_help_panel=STUDY)
def invert(
    session: Session,
    closure: Annotated[
        Literal["minimal", "chao", "least_squares"],
        typer.Option(
            help="Settle which tendon pulls: by four muscles without a hood, by the hood's laws, or by least stress."
        ),
    ] = "chao",
    model: ModelOption = None,
    figures: Figures = None,
    json: Json = None,
) -> None:
    """Find the muscle and joint forces behind the measured tip forces, beside the weights that really hung."""
    from server.commands.inversion import invert_session

    invert_session(session, closure, model, figures, json)


@app.command(rich_help_panel=STUDY)
def reproduce(
    study: Annotated[str, typer.Argument(help="Name a published study; a name that is none lists them.")],
    figures: Figures = None,
    json: Json = None,
) -> None:
    """Set every number of a published study beside ours."""
    from server.commands.published import reproduce_study

    reproduce_study(study, figures, json)


@app.command(rich_help_panel=STUDY)
def move(
    motion: Annotated[
        str, typer.Argument(help="Name a movement file (motion/1), or a shipped movement.")
    ] = "wu2008_tap",
    finger: Annotated[
        str,
        typer.Option(metavar="FINGER", help="Name a finger file or a shipped finger, with the inertia of its bones."),
    ] = "wu2008_index",
    muscles: Annotated[
        str, typer.Option(metavar="MUSCLES", help="Name a muscle file (muscles/1), or a shipped set.")
    ] = "wu2008",
    steps: Annotated[int, typer.Option(help="Compute so many instants over the movement.")] = 200,
    out: Annotated[Path | None, typer.Option(metavar="CSV", help="Write the time courses there.")] = None,
    figures: Figures = None,
    json: Json = None,
) -> None:
    """Find the joint torques and muscle forces of a recorded movement."""
    from server.commands.movement import move_finger

    move_finger(motion, finger, muscles, steps, out, figures, json)


@app.command("activate", rich_help_panel=STUDY)
def activate_muscles(
    finger: Annotated[str, typer.Argument(help="Name a finger file or a shipped finger.")] = "barry2018_index",
    muscles: Annotated[
        str | None,
        typer.Option(
            metavar="MUSCLES", help="Name a muscle file (muscles/1) or a shipped set; by default the finger's own."
        ),
    ] = None,
    posture: Annotated[
        list[str] | None, typer.Option(metavar="ANGLE=DEG", help="Set an angle of the posture; repeatable.")
    ] = None,
    activation: Annotated[
        list[str] | None,
        typer.Option(
            metavar="MUSCLE=PERCENT",
            help="Set a muscle's baseline activation; the others rest. By default all are fully active.",
        ),
    ] = None,
    force: Annotated[
        list[str] | None,
        typer.Option(
            metavar="DIRECTION=N",
            help="Set the baseline by its tip force: palmar, dorsal, radial, ulnar, proximal, distal; repeatable.",
        ),
    ] = None,
    deficit: Annotated[
        list[str] | None,
        typer.Option(metavar="MUSCLE=PERCENT", help="Say what a muscle loses of its activation; several act together."),
    ] = None,
    out: Annotated[Path | None, typer.Option(metavar="CSV", help="Write every muscle's deficits there.")] = None,
    figures: Figures = None,
    json: Json = None,
) -> None:
    """Find the tip force of each muscle of a held finger, and what a loss of its activation changes."""
    from server.commands.activation import activate_finger

    activate_finger(finger, muscles, posture or [], activation or [], force or [], deficit or [], out, figures, json)


@app.command(rich_help_panel=STUDY)
def simulate(
    protocol: Annotated[
        str, typer.Argument(help="Name a protocol file, or a shipped protocol: synek2019, levels, friction.")
    ],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Write the new session in this folder.")],
    model: Annotated[
        str,
        typer.Option(
            "--model",
            metavar="FILE",
            help="Use this model in the rig: a revision with its effects, a finger file or a shipped finger.",
        ),
    ] = "an1979_middle",
    effect: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME.PARAM=VALUE",
            help="Let an effect act, in the unit that 'fingertwin effects NAME' tells: hanger_mass.m0=30; repeatable.",
        ),
    ] = None,
    rate_hz: Annotated[float, typer.Option(help="Sample at this rate [Hz].")] = 100.0,
    noise: Annotated[float, typer.Option("--noise-N", help="Set the noise's sd in one force reading [N].")] = 0.03,
    repeats: Annotated[int, typer.Option(help="Run the protocol so often.")] = 1,
    seed: Annotated[int, typer.Option(help="Begin the noise's random numbers with this seed.")] = 0,
    json: Json = None,
) -> None:
    """Write the session that a simulated rig would record: to plan an experiment, or to try everything."""
    from server.commands.files import simulate_rig

    simulate_rig(protocol, out, model, effect or [], rate_hz, noise, repeats, seed, json)
