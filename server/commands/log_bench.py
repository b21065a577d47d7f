"""`fingertwin log --protocol`: a bench session, case by case, at a terminal or by lines on standard input."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import closing, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from daq.bench.record import BenchSetup
from daq.bench.result import write_bench_session
from daq.bench.resume import BrokenOff, broken_off
from daq.bench.run import BenchRun
from daq.errors import InputError, SessionError
from daq.journal.reader import JournalReader
from daq.journal.rows import Event
from daq.journal.writer import Journal
from daq.quoting import counted, quoted
from daq.sessions import JOURNAL_FILE, own_finger, read_yaml
from daq.sessions.protocols import read_protocol
from server.application.bench_prediction import predictor
from server.bench.keys import KeyInput, terminal_keys, typed_lines
from server.bench.loop import BenchLoop, from_keys, from_lines
from server.bench.meter import StreamMeter
from server.bench.remote import Remote, joined
from server.bench.view import LineView, LiveView
from server.commands.console import answer, at_terminal, progress, say
from server.commands.forwarding import Delivery, forwarding, sending
from server.commands.log_parts import LogOptions, about_cell, acquiring

if TYPE_CHECKING:
    from daq.acquisition.acquire import Acquisition
    from daq.drivers.base import LoadCell
    from daq.sessions.models import Session
    from server.commands.closing_copy import Closed

FORMAT = "bench-setup/1"
REQUIRED = ("specimen", "finger", "tension_factor")
KNOWN = (
    *REQUIRED,
    "format",
    "id",
    "load_cell",
    "gravity_m_s2",
    "known_weight",
    "unloaded_state",
    "environment",
    "budget",
)


def log_bench(
    options: LogOptions, cell: LoadCell, acquisition: Acquisition, closed: Closed, json: str | None
) -> Delivery:
    """Follow a protocol, and write the session that comes of it, also from where one broke off; return what was sent.

    Of a session that is over, what the service does not have yet is sent: the load cell is not asked for.

    Raises:
        InputError: the setup, the protocol, the device or the journal cannot be used, or no case was completed.
        KeyboardInterrupt: it broke off before the session was closed; nothing is written, so that it can go on.
    """
    setup, out = bench_setup(options, cell), options.out
    if out is None:
        raise InputError("no --out", "the folder that the session goes to")
    over = (out / "session.yaml").exists()
    if over and not (options.resume and options.to):
        found = f"{out.name} has a session already" + ", so nothing broke off" * options.resume
        raise SessionError(found, "a new folder for each session", "Choose another --out")
    setup.require_sound()
    about = about_cell(cell, {k: str(v) for k, v in setup.load_cell.items() if isinstance(v, str)})
    before, delivery = _broken_off(out, options.resume), Delivery(options.to, "The same command with --resume")
    if before is not None:
        cell.go_on(before.stream.settings)
        told = {"driver": cell.name, "settings": dict(cell.values), "cell": about, "clock": cell.clock}
        before.require_same(setup, told)
    if before is not None and (over or before.record.closed):
        closed.path, stream, cases, left = out / JOURNAL_FILE, before.stream.id, len(before.record.cases), ""
        with closing(Journal.open(closed.path)) as journal:
            if not over:
                write_bench_session(journal, out, stream)
            with sending(delivery, options.session_name, journal, say, bench=True):
                pass
    else:
        by_keys = at_terminal(json)
        stream, session, left = _follow(options, setup, acquisition, closed, about, before, delivery, by_keys=by_keys)
        cases = len(session.cases)
    body = {"session": str(out), "cases": cases, "journal": str(closed.path), "stream": stream}
    if not answer("log", body, json):
        where = quoted(out)
        done = f"{counted(cases, 'load case')}{left}"
        say(f"{done}: {out}   (fingertwin check {where}, fingertwin compare {where})")
    return delivery


def _broken_off(out: Path, resume: bool) -> BrokenOff | None:
    """Return the session that the folder's journal holds and that goes on, None for a new one.

    Raises:
        SessionError: there is one and nobody asked for it, or the other way round.
    """
    found: BrokenOff | None = None
    if (out / JOURNAL_FILE).exists():
        with JournalReader.open(out / JOURNAL_FILE) as journal:
            found = broken_off(journal)
    # Closed without a case it left nothing to be written.
    if found is None or (found.record.closed and not found.record.cases):
        if resume:
            raise SessionError(
                f"{out.name} holds no unfinished bench session",
                "the folder of one that broke off",
                "Leave out --resume to begin one",
            )
        return None
    if not resume:
        what = "was closed and never written" if found.record.closed else "is not finished"
        raise SessionError(
            f"the journal in {out.name} holds session {found.record.setup.id}, which {what}",
            "--resume to go on with it, or a new folder",
            "Add --resume, or choose another --out",
        )
    return found


def _follow(
    options: LogOptions,
    setup: BenchSetup,
    acquisition: Acquisition,
    closed: Closed,
    about: dict[str, str],
    before: BrokenOff | None,
    delivery: Delivery,
    *,
    by_keys: bool,
) -> tuple[str, Session, str]:
    """Log until the session is over; return its stream, the session that was written, and what is not done in words."""
    out, cell = options.out or Path(), acquisition.cell
    predict = predictor(setup, options.model)
    run: BenchRun | None = None
    from_s = 0.0
    if before is not None:
        with JournalReader.open(out / JOURNAL_FILE) as kept, progress("Reading"):
            plateaus = before.plateaus(kept)
        run, from_s = BenchRun(before.record.setup, predict, before.stream.id), before.from_s()
        run.resume(before.events, plateaus, before.last_s, from_s)
        acquisition.go_on_from(before.next_seq, before.last_s, from_s)
    with acquiring(acquisition, out, options.seconds, closed) as journal:
        if run is None or before is None:
            stream = journal.add_stream(cell.name, cell.values, about, cell.clock)
            run = BenchRun(setup, predict, stream)
        else:
            stream = before.stream.id
            # As after a pulled cable: what the bytes before were the beginning of never came.
            journal.event(Event("reconnected", from_s, {"away_s": round(from_s - before.last_s, 3)}, stream))
        meter = StreamMeter(run.full_scale)
        try:
            with forwarding(delivery, options.session_name, journal, stream, acquisition, say, bench=True) as tail:
                remote = None if tail is None else Remote(tail, run)
                _loop((acquisition, journal, stream, run, meter), remote, by_keys=by_keys)
        except KeyboardInterrupt:
            with suppress(OSError):  # the terminal may be gone
                say(f"{_not_done(run)}; the same command with --resume goes on.")
            raise
        left = "" if run.record.closed else f", {_not_done(run)}"
        return stream, write_bench_session(journal, out, stream), left


def _not_done(run: BenchRun) -> str:
    states = [state for _, _, state in run.status().checklist]
    return f"{len(states) - states.count('done')} of {len(states)} steps not done"


def _loop(
    parts: tuple[Acquisition, Journal, str, BenchRun, StreamMeter], remote: Remote | None, *, by_keys: bool
) -> None:
    """Go on until the session is over: by keys on a redrawn screen, or by lines of text; from elsewhere too."""
    if not by_keys:
        shown = joined(remote, LineView(), from_lines(typed_lines()))
        BenchLoop(*parts, *shown, ends_when_closed=True).go_on()
        return
    keys, run = KeyInput(), parts[3]
    with terminal_keys() as read, LiveView(run, parts[4], keys) as view:
        BenchLoop(*parts, *joined(remote, view, from_keys(keys, read, run))).go_on()


def bench_setup(options: LogOptions, cell: LoadCell) -> BenchSetup:
    """Return everything known before the first reading, from the setup file and the command.

    Raises:
        SessionError: the file lacks something, or has what it should not.
    """
    if options.setup is None and options.protocol is None:
        raise InputError("--resume alone", "the --protocol and --setup that the session began with")
    if options.setup is None:
        raise InputError("--protocol without --setup", f"a {FORMAT} file: specimen, finger, tension_factor, mounts …")
    if options.protocol is None:
        raise InputError("--setup without --protocol", "the protocol that is to be followed")
    given = read_yaml(options.setup)
    if not isinstance(given, Mapping) or given.get("format") != FORMAT:
        raise SessionError(f"{options.setup.name} is not a setup", f"format: {FORMAT}")
    unknown, lacks = [k for k in given if k not in KNOWN], [k for k in REQUIRED if k not in given]
    if unknown or lacks:
        found = f"{unknown[0]!r} is not known" if unknown else f"{lacks[0]} lacks"
        raise SessionError(f"{options.setup.name}: {found}", f"of {' '.join(KNOWN)}")
    load_cell: dict[str, Any] = dict(given.get("load_cell") or {}) | options.cell
    if cell.rate_hz is not None:
        load_cell.setdefault("rate_hz", cell.rate_hz)
    rest = {k: v for k, v in given.items() if k not in ("format", "id", "load_cell")}
    return BenchSetup(
        finger_document=own_finger(str(given["finger"])),
        # By its folder, not by the setup: that is written once for a specimen and serves several days.
        id=options.session_name,
        load_cell=load_cell,
        protocol=read_protocol(options.protocol, options.setup.parent),
        protocol_name=options.protocol,
        **rest,
    )
