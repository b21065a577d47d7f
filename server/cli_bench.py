"""Commands of the bench: `log`, `replay`, `simulate-cell`, `import`, `journal`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from daq.errors import InputError
from server.cli_options import Json, ModelOption, ServiceOption, app


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
    copy_to: Annotated[
        Path | None, typer.Option(metavar="DIR", help="A checked copy of the journal goes there at the end.")
    ] = None,
    seconds: Annotated[float | None, typer.Option(help="End after so long; by default on Ctrl-C.")] = None,
    cell: Annotated[str | None, typer.Option(help="Model of the load cell, such as 'ATI Nano17-E SI-25-0.25'.")] = None,
    serial: Annotated[str | None, typer.Option(help="Its serial number.")] = None,
    calibration: Annotated[str | None, typer.Option(help="Its calibration: certificate's number, or file.")] = None,
    protocol: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Follow a protocol: a shipped one (levels, friction, …), or a file."),
    ] = None,
    setup: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Specimen, finger, mounts and known weight (bench-setup/1).")
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with a bench session that broke off.")] = False,
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
    options = LogOptions(
        driver, port, baud, settings, out, seconds, given, protocol, setup, model, to, session, resume, copy_to
    )
    log_cell(options, json)


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
    setting: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="NAME=VALUE", help="Of gauge-volts: a setting of its driver; repeatable."),
    ] = None,
    rate_hz: Annotated[float, typer.Option(help="Of a simulated rig [Hz].")] = 100.0,
    seconds: Annotated[float | None, typer.Option(help="End after so long.")] = None,
    seed: Annotated[int, typer.Option(help="Of noise and faults.")] = 0,
    noise_N: Annotated[float, typer.Option("--noise-N", help="Noise on top: its sd in each force [N].")] = 0.0,
    noise_Nmm: Annotated[float, typer.Option("--noise-Nmm", help="Its sd in each torque [N mm].")] = 0.0,
    noise_correlation: Annotated[float, typer.Option(help="With the next reading's noise; 0 is white.")] = 0.0,
    drift_N: Annotated[float, typer.Option("--drift-N-per-min", help="Of each force's zero [N/min].")] = 0.0,
    drift_Nmm: Annotated[float, typer.Option("--drift-Nmm-per-min", help="Of each torque's [N mm/min].")] = 0.0,
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
    disturbed = {
        "noise_N": noise_N,
        "noise_Nmm": noise_Nmm,
        "noise_correlation": noise_correlation,
        "drift_N_per_min": drift_N,
        "drift_Nmm_per_min": drift_Nmm,
    }
    run(Options(device, wire, port, link, play, rate_hz, seconds, seed, tuple(setting or ())), faults, disturbed, json)


journal_app = typer.Typer(
    help="The bench's log: check it, recover what is sound, export a stream, send again what was refused.",
    no_args_is_help=True,
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


@journal_app.command("requeue")
def journal_requeue(journal: JournalPath, json: Json = None) -> None:
    """Send again what a service refused, once it was mended: back into the outbox with it."""
    from server.commands.journal import journal_requeue as run

    run(journal, json)


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
    recording: Annotated[
        Path, typer.Argument(help="A TDMS or LVM file; or a finger as OpenSim (.osim) or MJCF (.xml) file.")
    ],
    mapping: Annotated[
        Path | None,
        typer.Option("--map", metavar="FILE", help="Which channel is which; by default RECORDING.map.yaml."),
    ] = None,
    calibration: Annotated[
        str | None, typer.Option(metavar="FILE", help="The cell's .cal file, where the channels are gauge volts.")
    ] = None,
    load_point: Annotated[
        str | None,
        typer.Option(
            metavar="'X Y Z'", help="Of a finger: where the clamp holds its last body [mm], if the file does not say."
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="By default NAME.parquet, a finger NAME.yaml, in this folder.")
    ] = None,
    json: Json = None,
) -> None:
    """Make a readings file of a lab's TDMS or LVM recording (asks which channel is which), or a finger file."""
    from server.exchange import READABLE

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
