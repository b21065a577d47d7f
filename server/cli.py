"""The `fingertwin` command. Exit 0 on success, 2 on bad input with one line on stderr, 1 on a failure of ours."""

from __future__ import annotations

import sys
from io import TextIOWrapper
from pathlib import Path
from typing import Annotated, Literal

import typer
from typer.exceptions import TyperException

from daq.errors import InputError

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


@app.command()
def check(session: Session, json: Json = None) -> None:
    """Validate a session: format, windows, plateaus, drift, saturation, gaps."""
    from server.commands.bench import check_session

    raise typer.Exit(check_session(session, json))


@app.command()
def friction(sessions: Annotated[list[str], typer.Argument(help="One or more sessions.")], json: Json = None) -> None:
    """Find the friction factor by force balance (Synek 2019 Eq 1): per case, specimen and pooled."""
    from server.commands.bench import friction_of

    friction_of(sessions, json)


@app.command()
def compare(
    session: Session, model: ModelOption = None, effect: EffectFiles = None, figures: Figures = None, json: Json = None
) -> None:
    """Compare predicted with measured forces, per load case and summarised."""
    from server.commands.twin import compare_session

    compare_session(session, model, effect or [], figures, json)


@app.command()
def refit(
    session: Session,
    method: Annotated[
        Literal["map", "slsqp"],
        typer.Option(help="map: all parameters at once with priors; slsqp: the three published problems of Eq 5."),
    ] = "map",
    model: ModelOption = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="MODEL", help="Where to write the revision; by default models/SESSION-rN.json."),
    ] = None,
    plane: Annotated[
        Literal["sagittal", "space"] | None,
        typer.Option(help="Force components to fit; by default what the finger's axes can predict."),
    ] = None,
    effect: EffectFiles = None,
    figures: Figures = None,
    json: Json = None,
) -> None:
    """Identify the parameters from the identification cases; validation cases are never fitted."""
    from server.commands.twin import refit_session

    refit_session(session, method, model, out, plane, effect or [], figures, json)


@app.command()
def diagnose(
    sessions: Annotated[list[str], typer.Argument(help="One session, or several: then pooled as well.")],
    model: ModelOption = None,
    thorough: Annotated[bool, typer.Option(help="More starts and more pairs; may take a minute.")] = False,
    effect: EffectFiles = None,
    frozen: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE", help="Predictions of `next --freeze` to hold against; by default those in models."
        ),
    ] = None,
    figures: Figures = None,
    json: Json = None,
) -> None:
    """Find where the model fails and which physical effect is missing, or that the data cannot say."""
    if len(sessions) > 1:
        from server.commands.pooling import diagnose_sessions

        diagnose_sessions(sessions, model, thorough, effect or [], figures, json)
        return
    from server.commands.diagnosis import diagnose_session

    diagnose_session(sessions[0], model, thorough, effect or [], frozen, figures, json)


@app.command("next")
def next_load_cases(
    session: Session,
    model: ModelOption = None,
    effect: EffectFiles = None,
    freeze: Annotated[
        bool, typer.Option(help="Write the explanations' predictions down before they are measured.")
    ] = False,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Where to freeze; by default models/SESSION-frozen-….json.")
    ] = None,
    json: Json = None,
) -> None:
    """Find the load cases that would best tell the remaining explanations apart."""
    from server.commands.planning import next_cases

    next_cases(session, model, effect or [], freeze, out, json)


@app.command()
def add(
    names: Annotated[list[str], typer.Argument(metavar="EFFECT... SESSION", help="Effects, then the session.")],
    without: Annotated[
        list[str] | None, typer.Option(metavar="EFFECT", help="An effect to take out of the model; repeatable.")
    ] = None,
    model: ModelOption = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="MODEL", help="Where to write the revision; by default models/SESSION-rN.json."),
    ] = None,
    figures: Figures = None,
    json: Json = None,
) -> None:
    """Add effects to the model, refit, and report the fall of the error on cases that were never fitted."""
    from server.commands.additions import add_to_session

    add_to_session(names, without or [], model, out, figures, json)


@app.command()
def effects(
    name: Annotated[str | None, typer.Argument(help="One effect; all by default.")] = None, json: Json = None
) -> None:
    """Show the catalogue: formula, parameters, units, ranges, source."""
    from server.commands.additions import show_effects

    show_effects(name, json)


@app.command()
def reproduce(
    study: Annotated[str, typer.Argument(help="Published study: synek2019.")],
    figures: Figures = None,
    json: Json = None,
) -> None:
    """Set a published study's numbers beside ours, and our own fit beside the published model."""
    from server.commands.published import reproduce_study

    reproduce_study(study, figures, json)


@app.command()
def export(
    source: Annotated[str, typer.Argument(help="A session, or a model revision.")],
    file_format: Annotated[
        Literal["csv", "parquet", "hdf5", "c3d", "mat", "supplement"],
        typer.Option("--format", help="What to write; supplement: one archive for a paper, without private names."),
    ] = "csv",
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="By default NAME with the format's ending, in this folder.")
    ] = None,
    model: ModelOption = None,
    json: Json = None,
) -> None:
    """Export a session's load cases (measured and predicted), its readings, or a model's parameters."""
    from server.commands.files import export_source

    export_source(source, file_format, out, model, json)


@app.command()
def simulate(
    protocol: Annotated[str, typer.Argument(help="Protocol file, or a shipped one: synek2019, levels.")],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder of the new session.")],
    model: Annotated[
        str, typer.Option("--model", metavar="FILE", help="The finger of the rig: a revision, finger file or name.")
    ] = "an1979_middle",
    rate_hz: Annotated[float, typer.Option(help="Sampling rate [Hz].")] = 100.0,
    noise: Annotated[float, typer.Option("--noise-N", help="Noise of one force reading [N].")] = 0.03,
    repeats: Annotated[int, typer.Option(help="How often the protocol is run.")] = 1,
    seed: Annotated[int, typer.Option(help="Of the noise.")] = 0,
    json: Json = None,
) -> None:
    """Write the session that a simulated rig would record: to plan an experiment, or to try everything."""
    from server.commands.files import simulate_rig

    simulate_rig(protocol, out, model, rate_hz, noise, repeats, seed, json)


@app.command()
def log(
    driver: Annotated[str, typer.Option(metavar="NAME", help="A driver, or 'list'.")],
    port: Annotated[
        str | None, typer.Option(help="Serial port, host, or file, by the driver: COM3, 192.168.1.1, readings.csv.gz.")
    ] = None,
    baud: Annotated[int | None, typer.Option(help="Of the serial port; by default the device's.")] = None,
    setting: Annotated[
        list[str] | None, typer.Option("--set", metavar="NAME=VALUE", help="A setting of the driver; repeatable.")
    ] = None,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder of the log.")] = None,
    seconds: Annotated[float | None, typer.Option(help="End after so long; by default on Ctrl-C.")] = None,
    cell: Annotated[str | None, typer.Option(help="Model of the load cell, such as 'ATI Nano17-E SI-25-0.25'.")] = None,
    serial: Annotated[str | None, typer.Option(help="Its serial number.")] = None,
    calibration: Annotated[str | None, typer.Option(help="Its calibration: certificate's number, or file.")] = None,
    protocol: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Follow a protocol: a shipped one (levels, synek2019), or a file."),
    ] = None,
    setup: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Specimen, finger, mounts and known weight (bench-setup/1).")
    ] = None,
    model: ModelOption = None,
    to: ServiceOption = None,
    session: Annotated[str | None, typer.Option(help="Its session there; by default the folder's name.")] = None,
    json: Json = None,
) -> None:
    """Log a load cell into a journal that survives a pulled plug; with --protocol a whole bench session."""
    from server.commands.log import LogOptions, list_drivers, log_cell

    if driver == "list":
        list_drivers(json)
        return
    about = {"model": cell, "serial": serial, "calibration": calibration}
    given = {key: value for key, value in about.items() if value is not None}
    settings = tuple(setting or ())
    log_cell(LogOptions(driver, port, baud, settings, out, seconds, given, protocol, setup, model, to, session), json)


@app.command()
def replay(
    recording: Annotated[str, typer.Argument(help="A session, a readings file, or a journal.")],
    to: ServiceOption = None,
    session: Annotated[str | None, typer.Option(help="Its session there; by default the recording's name.")] = None,
    speed: Annotated[str, typer.Option(metavar="N|max", help="Times real time, or as fast as it goes.")] = "max",
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Keep the journal there.")] = None,
    json: Json = None,
) -> None:
    """Stream a recorded session to a service, through the same decoder and journal as a load cell."""
    from server.commands.log import replay_session

    replay_session(recording, to, session, speed, out, json)


@app.command("simulate-cell")
def simulate_cell(
    device: Annotated[str, typer.Argument(help="A driver's name, or 'list'.")],
    play: Annotated[
        str, typer.Option(metavar="WHAT", help="A session, a readings file, or a protocol for a simulated rig.")
    ] = "synek2019",
    wire: Annotated[Literal["pty", "tcp", "udp"] | None, typer.Option(help="By default what fits.")] = None,
    port: Annotated[int, typer.Option(help="Of TCP or UDP; 0 is any free one.")] = 0,
    link: Annotated[str | None, typer.Option(metavar="PATH", help="A name of its own for the pseudo-terminal.")] = None,
    rate_hz: Annotated[float, typer.Option(help="Of a simulated rig [Hz].")] = 100.0,
    seconds: Annotated[float | None, typer.Option(help="End after so long.")] = None,
    seed: Annotated[int, typer.Option(help="Of noise and faults.")] = 0,
    drop: Annotated[float, typer.Option("--drop-per-s", help="Bytes lost a second.")] = 0.0,
    flip: Annotated[float, typer.Option("--flip-per-s", help="Bits turned a second.")] = 0.0,
    lose: Annotated[float, typer.Option("--lose-per-s", help="Whole records lost a second.")] = 0.0,
    burst_s: Annotated[float, typer.Option(help="Bytes are held back so long and come together [s].")] = 0.0,
    pull_every_s: Annotated[float, typer.Option(help="The cable is pulled so often [s].")] = 0.0,
    pull_for_s: Annotated[float, typer.Option(help="And stays out so long [s].")] = 2.0,
    wrong_baud: Annotated[bool, typer.Option(help="Bytes are read at the wrong rate.")] = False,
    count_from: Annotated[int, typer.Option(help="Where the device's count begins, so that it wraps soon.")] = 0,
    saturate_every_s: Annotated[float, typer.Option(help="The load leaves the range for a second so often [s].")] = 0.0,
    json: Json = None,
) -> None:
    """Behave as a load cell of a maker does, on a port of this machine, with faults on request."""
    from server.commands.simulate_cell import Options, list_devices
    from server.commands.simulate_cell import simulate_cell as run

    if device == "list":
        list_devices(json)
        return
    faults: dict[str, float | bool | int] = {
        "dropped_per_s": drop,
        "flipped_per_s": flip,
        "lost_per_s": lose,
        "burst_s": burst_s,
        "pulled_every_s": pull_every_s,
        "pulled_for_s": pull_for_s,
        "wrong_baud": wrong_baud,
        "first_count": count_from,
        "saturated_every_s": saturate_every_s,
    }
    run(Options(device, wire, port, link, play, rate_hz, seconds, seed), faults, json)


journal_app = typer.Typer(
    help="The bench's log: check it, recover what is sound, export a stream.", no_args_is_help=True
)
app.add_typer(journal_app, name="journal")
JournalPath = Annotated[Path, typer.Argument(metavar="JOURNAL", help="The journal's file.")]


@journal_app.command("check")
def journal_check(journal: JournalPath, json: Json = None) -> None:
    """Read a whole journal and say whether it is as it was written."""
    from server.commands.journal import journal_check as run

    raise typer.Exit(run(journal, json))


@journal_app.command("recover")
def journal_recover(
    journal: JournalPath,
    out: Annotated[Path, typer.Option(metavar="FILE", help="The new journal.")],
    json: Json = None,
) -> None:
    """Write a new journal with all that is sound, and list what is lost."""
    from server.commands.journal import journal_recover as run

    run(journal, out, json)


@journal_app.command("export")
def journal_export(
    journal: JournalPath,
    out: Annotated[Path | None, typer.Option(metavar="FILE", help="By default JOURNAL.FORMAT in this folder.")] = None,
    stream: Annotated[str | None, typer.Option(help="Its id, or the beginning of it, where there are several.")] = None,
    file_format: Annotated[Literal["csv", "parquet"], typer.Option("--format", help="What to write.")] = "csv",
    json: Json = None,
) -> None:
    """Write a stream as a readings file, and its events as JSON beside it."""
    from server.commands.journal import journal_export as run

    run(journal, out, stream, file_format, json)


@app.command("import")
def import_recording(
    recording: Annotated[Path, typer.Argument(help="A TDMS or LVM file.")],
    mapping: Annotated[
        Path | None,
        typer.Option("--map", metavar="FILE", help="Which channel is which; by default RECORDING.map.yaml."),
    ] = None,
    calibration: Annotated[
        str | None, typer.Option(metavar="FILE", help="The cell's .cal file, where the channels are gauge volts.")
    ] = None,
    out: Annotated[Path | None, typer.Option(metavar="FILE", help="By default NAME.parquet in this folder.")] = None,
    json: Json = None,
) -> None:
    """Make a readings file of a lab's TDMS or LVM recording; proposes which channel is which, and asks."""
    from server.commands.lab_files import import_recording as run

    run(recording, mapping, calibration, out, json)


@app.command()
def demo(
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for the report.")] = Path("demo-output"),
) -> None:
    """Run the main job on shipped data: replay, check, compare, refit, and the falling error."""
    from server.commands.demo import run_demo

    run_demo(out)


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


def main() -> None:
    """Run the command line."""
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # where an encoding lacks a letter, a ? does
    try:
        code = app(sys.argv[1:] or ["--help"], standalone_mode=False)
    except InputError as error:
        _fail(str(error), 2)
    except TyperException as error:
        text = error.format_message() if hasattr(error, "format_message") else str(error)
        text = " ".join(text.replace("Value error, ", "").split()).rstrip(".")
        _fail(f"{text}. Try 'fingertwin --help'.", 2)
    except (KeyboardInterrupt, typer.Abort):
        _fail("Interrupted; nothing that was already written is lost.", 130)
    except BrokenPipeError:
        # The reader of our output has gone: nothing is wrong, and nothing more can be said.
        sys.stderr.close()
        raise SystemExit(0) from None
    except OSError as error:
        where = f": {error.filename}" if error.filename else ""
        _fail(f"{error.strerror or error}{where}. Check the path, its rights and the space left.", 2)
    if code == 130:  # Typer makes Ctrl-C within a command an exit code
        _fail("Interrupted; nothing that was already written is lost.", 130)
    raise SystemExit(code if isinstance(code, int) else 0)


def _fail(text: str, code: int) -> None:
    sys.stderr.write(f"fingertwin: {text}\n")
    raise SystemExit(code)


if __name__ == "__main__":
    main()
