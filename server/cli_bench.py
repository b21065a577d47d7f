"""Commands of the bench: `log`, `replay`, `simulate-cell`, `import`, `journal`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from daq.errors import InputError
from server.cli_options import BENCH, Json, ModelOption, ServiceOption, app
from server.commands.console import refuse_useless


@app.command(rich_help_panel=BENCH)
def log(
    driver: Annotated[str, typer.Option(metavar="NAME", help="Name a driver; 'list' shows them all.")],
    port: Annotated[
        str | None,
        typer.Option(
            help="Name the serial port, host or file, as the driver needs: COM3, 192.168.1.1, readings.csv.gz."
        ),
    ] = None,
    baud: Annotated[int | None, typer.Option(help="Set the serial port's rate; by default the device's.")] = None,
    setting: Annotated[
        list[str] | None, typer.Option("--set", metavar="NAME=VALUE", help="Set something of the driver; repeatable.")
    ] = None,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Write the log in this folder.")] = None,
    copy_to: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write a checked copy of the journal there at the end.")
    ] = None,
    seconds: Annotated[float | None, typer.Option(help="End after so many seconds; by default on Ctrl-C.")] = None,
    cell: Annotated[
        str | None, typer.Option(help="State the load cell's model, such as 'ATI Nano17-E SI-25-0.25'.")
    ] = None,
    serial: Annotated[str | None, typer.Option(help="State the load cell's serial number.")] = None,
    calibration: Annotated[
        str | None, typer.Option(help="State the load cell's calibration: the certificate's number, or its file.")
    ] = None,
    protocol: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Follow a protocol: a shipped one (levels, friction, …), or a file."),
    ] = None,
    setup: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Read specimen, finger, mounts and known weight from this file (bench-setup/1)."
        ),
    ] = None,
    resume: Annotated[
        bool,
        typer.Option(
            "--resume", help="Go on with a bench session that broke off, or send (--to) the rest of one that ended."
        ),
    ] = False,
    model: ModelOption = None,
    to: ServiceOption = None,
    session: Annotated[
        str | None, typer.Option(help="Name the session at the service; by default as the folder.")
    ] = None,
    json: Json = None,
) -> None:
    """Log a load cell into a journal that survives a pulled plug; with --protocol a whole bench session."""
    from server.commands.log import list_drivers, log_cell
    from server.commands.log_parts import LogOptions

    if driver == "list":
        list_drivers(json)
        return
    about = {"model": cell, "serial": serial, "calibration": calibration}
    given = {key: value for key, value in about.items() if value is not None}
    if to is None:
        refuse_useless("without --to", "--to URL beside it", session=session)
    if protocol is None:
        refuse_useless("without --protocol", "--protocol beside it", model=model)
    settings = tuple(setting or ())
    options = LogOptions(
        driver, port, baud, settings, out, seconds, given, protocol, setup, model, to, session, resume, copy_to
    )
    log_cell(options, json).require_whole()


@app.command(rich_help_panel=BENCH)
def replay(
    recording: Annotated[str, typer.Argument(help="Name a session, a readings file, or a journal.")],
    to: ServiceOption = None,
    session: Annotated[
        str | None, typer.Option(help="Name the session at the service; by default as the recording.")
    ] = None,
    speed: Annotated[
        str,
        typer.Option(
            metavar="N|max", help="Play so many times faster than it was recorded; max, or 0, is as fast as possible."
        ),
    ] = "max",
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Keep the journal in this folder.")] = None,
    json: Json = None,
) -> None:
    """Stream a recorded session to a service, through the same decoder and journal as a load cell."""
    from server.commands.log import replay_session

    if to is None:
        refuse_useless("without --to", "--to URL beside it", session=session)
    replay_session(recording, to, session, speed, out, json)


@app.command("simulate-cell", rich_help_panel=BENCH)
def simulate_cell(
    device: Annotated[str, typer.Argument(help="Name a driver; 'list' shows them all.")],
    play: Annotated[
        str,
        typer.Option(
            metavar="WHAT", help="Play a session, a readings file, or a protocol that a simulated rig follows."
        ),
    ] = "synek2019",
    wire: Annotated[
        Literal["pty", "tcp", "udp"] | None,
        typer.Option(help="Choose the connection; by default what fits the device."),
    ] = None,
    port: Annotated[int, typer.Option(help="Listen on this TCP or UDP port; 0 takes any free one.")] = 0,
    link: Annotated[str | None, typer.Option(metavar="PATH", help="Give the pseudo-terminal this name.")] = None,
    setting: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="NAME=VALUE", help="Set something of the gauge-volts driver; repeatable."),
    ] = None,
    rate_hz: Annotated[float, typer.Option(help="Sample a simulated rig at this rate [Hz].")] = 100.0,
    seconds: Annotated[float | None, typer.Option(help="End after so many seconds.")] = None,
    seed: Annotated[int, typer.Option(help="Begin the random numbers of noise and faults with this seed.")] = 0,
    noise_N: Annotated[float, typer.Option("--noise-N", help="Add noise of this sd to each force [N].")] = 0.0,
    noise_Nmm: Annotated[float, typer.Option("--noise-Nmm", help="Add noise of this sd to each torque [N mm].")] = 0.0,
    noise_correlation: Annotated[
        float, typer.Option(help="Correlate the noise with the next reading's; 0 is white noise.")
    ] = 0.0,
    drift_N: Annotated[float, typer.Option("--drift-N-per-min", help="Let each force's zero drift [N/min].")] = 0.0,
    drift_Nmm: Annotated[
        float, typer.Option("--drift-Nmm-per-min", help="Let each torque's zero drift [N mm/min].")
    ] = 0.0,
    drop: Annotated[float, typer.Option("--drop-per-s", help="Lose so many bytes a second.")] = 0.0,
    flip: Annotated[float, typer.Option("--flip-per-s", help="Flip so many bits a second.")] = 0.0,
    lose: Annotated[float, typer.Option("--lose-per-s", help="Lose so many whole records a second.")] = 0.0,
    burst_s: Annotated[float, typer.Option(help="Hold bytes back so long and send them together [s].")] = 0.0,
    pull_every_s: Annotated[float, typer.Option(help="Pull the cable once in so long [s].")] = 0.0,
    pull_for_s: Annotated[float, typer.Option(help="Leave the pulled cable out so long [s].")] = 2.0,
    wrong_baud: Annotated[bool, typer.Option(help="Send bytes as if they were read at a wrong rate.")] = False,
    count_from: Annotated[int, typer.Option(help="Begin the device's count there, so that it wraps soon.")] = 0,
    saturate_every_s: Annotated[
        float, typer.Option(help="Let the load leave the range for a second, once in so long [s].")
    ] = 0.0,
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
    disturbed = {
        "noise_N": noise_N,
        "noise_Nmm": noise_Nmm,
        "noise_correlation": noise_correlation,
        "drift_N_per_min": drift_N,
        "drift_Nmm_per_min": drift_Nmm,
    }
    run(Options(device, wire, port, link, play, rate_hz, seconds, seed, tuple(setting or ())), faults, disturbed, json)


journal_app = typer.Typer(
    help="Check a log, recover what is sound, export a stream, or send again what was refused.",
    no_args_is_help=True,
)
app.add_typer(journal_app, name="journal", rich_help_panel=BENCH)
JournalPath = Annotated[Path, typer.Argument(metavar="JOURNAL", help="Name the journal's file.")]


@journal_app.command("check")
def journal_check(journal: JournalPath, json: Json = None) -> None:
    """Read a whole journal and say whether it is as it was written."""
    from server.commands.journal import journal_check as run

    run(journal, json)


@journal_app.command("recover")
def journal_recover(
    journal: JournalPath,
    out: Annotated[Path, typer.Option(metavar="FILE", help="Write the new journal there.")],
    json: Json = None,
) -> None:
    """Write a new journal with all that is sound, and list what is lost."""
    from server.commands.journal import journal_recover as run

    run(journal, out, json)


@journal_app.command("requeue")
def journal_requeue(journal: JournalPath, json: Json = None) -> None:
    """Send again what a service refused, once it was mended: back into the outbox with it."""
    from server.commands.journal import journal_requeue as run

    run(journal, json)


@journal_app.command("export")
def journal_export(
    journal: JournalPath,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write this file; by default JOURNAL.FORMAT in this folder.")
    ] = None,
    stream: Annotated[
        str | None, typer.Option(help="Name the stream by the beginning of its id, where there are several.")
    ] = None,
    file_format: Annotated[Literal["csv", "parquet"], typer.Option("--format", help="Choose the file format.")] = "csv",
    json: Json = None,
) -> None:
    """Write a stream as a readings file, and its events as JSON beside it."""
    from server.commands.journal import journal_export as run

    run(journal, out, stream, file_format, json)


@app.command("import", rich_help_panel=BENCH)
def import_recording(
    recording: Annotated[
        Path,
        typer.Argument(
            help="Name a TDMS, LVM, CSV, Excel, Parquet, HDF5 or C3D file, or an OpenSim (.osim) or MJCF (.xml) finger."
        ),
    ],
    mapping: Annotated[
        Path | None,
        typer.Option(
            "--map",
            metavar="FILE",
            help="Read from this file which channel is which; by default from RECORDING.map.yaml.",
        ),
    ] = None,
    calibration: Annotated[
        str | None, typer.Option(metavar="FILE", help="Name the cell's .cal file, where the channels are gauge volts.")
    ] = None,
    load_point: Annotated[
        str | None,
        typer.Option(
            metavar="'X Y Z'", help="Say where the clamp holds a finger's last body [mm], if the file does not."
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Write this file; by default NAME.parquet, or NAME.yaml for a finger, in this folder."
        ),
    ] = None,
    json: Json = None,
) -> None:
    """Make a readings file of a lab's recording (asks which channel is which), or a finger file."""
    from server.application.exchange import READABLE

    if recording.suffix.lower() in READABLE:
        from server.commands.exchange import import_finger

        if mapping is not None or calibration is not None:
            raise InputError("--map or --calibration with a finger", "neither: it has no channels", "Leave them out")
        import_finger(recording, load_point, out, json)
        return
    if load_point is not None:
        raise InputError(f"--load-point with {recording.name}", "an .osim or MJCF .xml file", "Leave it out")
    from server.commands.lab_files import import_recording as run

    run(recording, mapping, calibration, out, json)


@app.command("plot", rich_help_panel=BENCH)
def plot_recording(
    recording: Annotated[
        Path, typer.Argument(help="Name a TDMS, LVM, CSV, Excel, Parquet, HDF5 or C3D file, or a journal.")
    ],
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write this .html, .png or .svg; by default RECORDING.html in this folder."),
    ] = None,
    json: Json = None,
) -> None:
    """Draw what is in a recording, with units and plateaus, before anything is mapped."""
    from server.commands.plot import plot_recording as run

    run(recording, out, json)


@app.command("new", rich_help_panel=BENCH)
def new_session(
    recordings: Annotated[
        list[Path], typer.Argument(metavar="RECORDING…", help="Name recordings in the order in which they were made.")
    ],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Write the session there.")],
    notes: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Read the notebook: lines such as 'FDP 950, hook, tip', or CSV; - for stdin."
        ),
    ] = None,
    setup: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Read specimen, finger and mounts from this (bench-setup/1).")
    ] = None,
    like: Annotated[
        Path | None, typer.Option(metavar="SESSION", help="Take rig, postures and mapping of this earlier session.")
    ] = None,
    mapping: Annotated[
        Path | None, typer.Option("--map", metavar="FILE", help="Say which channel is which (lab-file-map/1).")
    ] = None,
    posture: Annotated[
        list[str] | None,
        typer.Option(metavar="'NAME: ANGLES'", help="Give a posture, 'hook: MCP 0 PIP 65 DIP 50' [deg]; repeatable."),
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Take all proposals and ask nothing.")] = False,
    json: Json = None,
) -> None:
    """Make a session of a lab's recordings and notebook: plateaus, tares and load cases are proposed."""
    from server.commands.new import NewOptions
    from server.commands.new import new_session as run

    run(NewOptions(tuple(recordings), out, notes, setup, like, mapping, tuple(posture or ()), yes), json)
