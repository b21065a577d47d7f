"""`fingertwin log`: a load cell, or a recording, into a bench's journal."""

from __future__ import annotations

import shutil
import sys
import tempfile
from collections import Counter
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from daq.acquisition.acquire import Acquisition
from daq.acquisition.records import Record, StreamEvent
from daq.acquisition.transports import connect
from daq.drivers import driver, drivers
from daq.drivers.looks import looks_like
from daq.errors import DriverError, InputError, JournalError
from daq.journal.replay import JournalReplay, is_journal
from daq.private import close_to_others, privately
from daq.quoting import quoted
from daq.sessions import find_session, read_session, whole_document
from daq.uplink.link import address_of
from daq.uplink.wire import require_session_id
from server.bench.ending import Told, ended_by_signals
from server.commands.closing_copy import Closed, copied_at_end
from server.commands.console import answer, refuse_useless, say, table
from server.commands.entries import once, pair
from server.commands.forwarding import Delivery, forwarding
from server.commands.log_bench import log_bench
from server.commands.log_parts import LogOptions, about_cell, acquiring

if TYPE_CHECKING:
    from daq.drivers.base import LoadCell
    from daq.journal.writer import Journal

# What is said when the disk has no more than so many seconds left at the present rate.
WARNED_S = 600.0


def list_drivers(json: str | None) -> None:
    """Show the drivers with their settings and an example line each."""
    rows: list[dict[str, Any]] = [
        {
            "name": d.name,
            "title": d.title,
            "link": d.link,
            "checksum": d.checksum,
            "clock": d.clock,
            "settings": [
                {"name": s.name, "text": s.text, "default": s.default, "required": s.default is None}
                for s in d.settings
            ],
            "example": d.example,
            "source": d.source,
        }
        for d in drivers()
    ]
    if answer("log", {"drivers": rows}, json):
        return
    table(
        "Drivers",
        ["driver", "load cell", "link", "checksum", "time from"],
        [[r["name"], r["title"], r["link"], "yes" if r["checksum"] else "no", r["clock"]] for r in rows],
    )
    for row in rows:
        say(f"\n{row['name']}\n  {row['example']}")
        for s in row["settings"]:
            default = "required" if s["required"] else f"default {s['default']}"
            say(f"  --set {s['name']}=  {s['text']} ({default})")


@privately
def log_cell(options: LogOptions, json: str | None, command: str = "log") -> Delivery:
    """Log until the end is asked for, the time is over, or the recording is; return what became of what was sent.

    Args:
        options: of the log.
        json: file of the answer.
        command: that answers, a log or a replay.

    Raises:
        InputError: a setting, the port, the device or the journal cannot be used; what was logged is kept.
    """
    cell = _cell(options)
    if cell.link != "serial":
        refuse_useless(f"with --driver {options.driver}", "a driver of a serial port", baud=options.baud)
    if options.out is None:
        raise InputError("no --out", "the folder that the log goes to")
    if options.seconds is not None and options.seconds <= 0:
        raise InputError(f"--seconds {options.seconds:g}", "a time above 0")
    if options.to is not None:
        address_of(options.to)  # before a folder is made
        require_session_id(options.session_name, "Give --session NAME")
    if options.out.is_dir() and not any(options.out.iterdir()):
        close_to_others(options.out)  # made for this log; what holds other things already is left as it is
    acquisition = Acquisition(cell, lambda: connect(cell, options.port, options.baud))
    with copied_at_end(options.copy_to, quiet=json == "-") as closed:
        if options.protocol is not None or options.setup is not None or options.resume:
            return log_bench(options, cell, acquisition, closed, json)
        return _log_alone(options, options.out, acquisition, closed, json, command)


def _log_alone(
    options: LogOptions, out: Path, acquisition: Acquisition, closed: Closed, json: str | None, command: str
) -> Delivery:
    """Log readings without a protocol, and answer as a command; return what became of what was sent."""
    cell = acquisition.cell
    about = about_cell(cell, options.cell)
    if cell.link in ("serial", "udp") and not {"serial", "calibration"} <= set(about):
        raise DriverError(
            "the cell's serial number or calibration is not stated",
            "--serial and --calibration, as on its certificate: readings without them cannot be checked or published",
        )
    with acquiring(acquisition, out, options.seconds, closed) as journal:
        logging, delivery = Logging(journal, cell, about, quiet=json == "-"), Delivery(options.to)
        if command == "log":
            delivery.again = f"The next log into {quoted(out)} with --to"
        with forwarding(
            delivery, options.session_name, journal, logging.stream, acquisition, logging.say, options.document
        ):
            told = logging.run(acquisition, to_its_end=command == "replay")
    # A journal that only passes through lies elsewhere, or nowhere, once this has ended.
    body = {"driver": cell.name, "journal": None if options.passing else str(journal.path), **told}
    if not answer(command, body, json):
        where = f"{journal.path}   (fingertwin journal check {quoted(journal.path)})"
        if options.passing:
            where = f"{options.to} as session {options.session_name}" if delivery.whole else "not all sent"
        say(f"{told['samples']} readings in {told['seconds']:.1f} s: {where}")
    logging.require_readings(cell)
    return delivery


def _cell(options: LogOptions) -> LoadCell:
    """Return the driver with its settings; a replay of a journal is by the driver that read it."""
    settings = given_settings(options.settings)
    if options.driver != "replay" or options.port is None or not is_journal(options.port):
        return driver(options.driver)(settings)
    unknown = set(settings) - {"speed", "stream"}
    if unknown:
        raise InputError(f"--set {unknown.pop()} for a journal's replay", "speed or stream")
    try:
        speed = float(settings.get("speed", 1.0))
    except ValueError:
        raise InputError(f"--set speed={settings['speed']}", "a number") from None
    return JournalReplay(options.port, settings.get("stream"), speed)


class Logging:
    """Writes what the sampling thread hands on into a journal, and tells what happens.

    Args:
        journal: that is written.
        cell: that is read.
        about: model, serial number and calibration of the load cell.
        quiet: say nothing of what happens.
    """

    def __init__(
        self,
        journal: Journal,
        cell: LoadCell,
        about: dict[str, str],
        quiet: bool = False,
    ) -> None:
        self.stream = journal.add_stream(cell.name, cell.values, about, cell.clock)
        self._journal, self._quiet, self._told = journal, quiet, Told()
        self._kinds: Counter[str] = Counter()
        self._samples, self._first_s, self._last_s = 0, 0.0, 0.0
        # Bytes that made no reading: how many, and the first of them.
        self._undecoded_bytes, self._undecoded = 0, b""
        self._warned = False

    def run(self, acquisition: Acquisition, *, to_its_end: bool = False) -> dict[str, Any]:
        """Write until the stream ends; Ctrl-C or another such signal ends it, and what was read until then is written.

        Args:
            acquisition: that is started.
            to_its_end: whether a signal breaks it off instead: then nothing says that the stream has ended.

        Raises:
            JournalError: the disk is full; all that was acknowledged is kept.
            KeyboardInterrupt: it was broken off, or Ctrl-C was pressed again before that was done.
        """
        with ended_by_signals(acquisition.stop) as self._told:
            try:
                for record in acquisition.records():
                    if to_its_end and self._told.come:
                        raise KeyboardInterrupt
                    self._keep(record)
            except JournalError:
                acquisition.stop()
                raise
            finally:
                self._warn()
        seconds = self._last_s - self._first_s
        return {
            "stream": self.stream,
            "samples": self._samples,
            "seconds": seconds,
            "rate_hz": (self._samples - 1) / seconds if seconds > 0 else None,
            "undecoded_bytes": self._undecoded_bytes,
            "events": dict(self._kinds),
        }

    def require_readings(self, cell: LoadCell) -> None:
        """Make sure that there are readings of a device, or of what it sent.

        Raises:
            DriverError: there are none; says what came instead.
        """
        if self._samples or not (self._undecoded_bytes or cell.link in ("serial", "udp")):
            return
        if not self._undecoded_bytes:
            raise DriverError("nothing came, so there are no readings", f"records of {cell.name}", "Is it streaming?")
        raise DriverError(
            f"{self._undecoded_bytes} bytes came and made no reading: {looks_like(self._undecoded)}",
            f"records of {cell.name}",
            f"Check --driver, --baud and the settings; the bytes are kept in {self._journal.path}",
        )

    def say(self, text: str) -> None:
        """Tell what happens; where the terminal was closed, nobody."""
        try:
            if not self._quiet:
                say(text)
        except OSError:
            if not self._told.come:
                raise

    def _keep(self, record: Record) -> None:
        self._journal.keep(self.stream, record.chunk, record.events)
        self._warn()
        if record.chunk is not None and len(record.chunk):
            times = record.chunk.t_s
            self._first_s = float(times[0]) if self._samples == 0 else self._first_s
            self._samples, self._last_s = self._samples + len(times), float(times[-1])
        elif record.chunk is not None:
            self._undecoded_bytes += len(record.chunk.raw)
            self._undecoded = self._undecoded or record.chunk.raw
        self._kinds.update(e.kind for e in record.events)
        self._watch(record)
        for event in record.events:
            self.say(worded(event))

    def _warn(self) -> None:
        """Say what the journal has to say."""
        while not self._journal.alarms.empty():
            _, text = self._journal.alarms.get()
            self.say(f"WARNING: {text}")

    def _watch(self, record: Record) -> None:
        """Warn before the disk is full."""
        if record.chunk is None or self._warned or not len(record.chunk):
            return
        per_s = record.chunk.packed_bytes / max(float(record.chunk.t_s[-1] - record.chunk.t_s[0]), 1e-3)
        left_s = self._journal.space_left() / per_s
        if left_s < WARNED_S:
            self.say(f"The disk has room for {left_s / 60.0:.0f} more minutes; then logging stops cleanly.")
            self._warned = True


def worded(event: StreamEvent) -> str:
    """Return an event in one line."""
    value = ", ".join(f"{k} {v}" for k, v in event.value.items())
    return f"{event.at_s:10.2f} s  {event.kind.replace('_', ' ')}" + (f": {value}" if value else "")


def given_settings(given: tuple[str, ...]) -> dict[str, str]:
    """Return settings of `name=value`.

    Raises:
        InputError: one is not of that form, or is given twice.
    """
    expected = "NAME=VALUE, such as --set counts_per_N=1000000"
    return once((pair(one, "--set", expected) for one in given), "--set")


def replay_session(
    recording: str, to: str | None, session: str | None, speed: str, out: Path | None, json: str | None
) -> None:
    """Log a recording, or a journal, as if it were read now, and send it to a service.

    Raises:
        InputError: the recording, the speed or the address cannot be used.
        KeyboardInterrupt: it was broken off; the session at the service waits for the rest.
    """
    port, document = recording, None
    name = session or Path(recording).stem
    if not Path(recording).is_file() and not is_journal(recording):
        port = str(find_session(recording).parent)
        described = read_session(port)
        # As its description says, whatever the folder is called.
        name = session or described.id
        document = whole_document(described, name) if to is not None else None
    settings = (f"speed={'0' if speed == 'max' else speed}",)
    if document is not None and to is not None and document.get("readings") is None:
        from fingertwin.client import Client

        with Client(to) as twin:
            twin.upload(port, session)
        if not answer("replay", {"session": name, "samples": 0}, json):
            say(f"{name} has averaged forces and no readings: its description is at {to}")
        return
    with tempfile.TemporaryDirectory() as folder:
        # What goes to a service needs no folder of its own.
        target = out or (_free_folder(name) if to is None else Path(folder) / "replay")
        options = LogOptions("replay", port, None, settings, target, None, to=to, session=name, document=document)
        try:
            delivery = log_cell(replace(options, passing=out is None and to is not None), json, "replay")
        except KeyboardInterrupt:
            with suppress(OSError):  # the terminal may be gone
                sys.stderr.write(f"fingertwin: not all of {name} was replayed; the same command replays all of it\n")
            raise
        if delivery.whole:
            return
        kept = target if out is not None else _kept(target, name)
        # By the recording's own name: with a session's readings goes its description.
        again = f"fingertwin replay {quoted(recording)} --to {to} --session"
        again += " NAME sends all under another name" if delivery.barred else f" {name} sends all again"
        raise InputError(
            f"not all of {name} is at {to}",
            "a service that answers and takes it",
            f"The readings are in {kept}; {again}",
        )


def _kept(folder: Path, name: str) -> Path:
    """Copy a log's folder to where it stays."""
    kept = _free_folder(name)
    shutil.copytree(folder, kept)
    return kept


def _free_folder(name: str) -> Path:
    """Return a folder for a replay that is not there yet, where the command was run."""
    number = 1
    while (free := Path(f"{name}-replay" + (f"-{number}" if number > 1 else ""))).exists():
        number += 1
    return free
