"""`fingertwin log --protocol`: a bench session, case by case, at a terminal or by lines on standard input."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from daq.errors import InputError, SessionError
from daq.sessions import read_yaml
from server.commands.log import JOURNAL, LogOptions, about_cell, acquiring
from server.console import answer, say

if TYPE_CHECKING:
    from daq.acquire import Acquisition
    from daq.bench.record import BenchSetup
    from daq.bench.run import BenchRun
    from daq.drivers.base import LoadCell
    from daq.journal.writer import Journal
    from server.bench.meter import StreamMeter

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


def log_bench(options: LogOptions, cell: LoadCell, acquisition: Acquisition, json: str | None) -> None:
    """Follow a protocol, and write the session that comes of it.

    Raises:
        InputError: the setup, the protocol, the device or the journal cannot be used, or no case was completed.
    """
    from daq.bench.result import write_bench_session
    from daq.bench.run import BenchRun
    from server.bench.meter import StreamMeter
    from server.bench.prediction import predictor
    from server.commands.forwarding import forwarding

    setup, out = bench_setup(options, cell), options.out
    if out is None:
        raise InputError("no --out", "the folder that the session goes to")
    if (out / "session.yaml").exists():
        raise SessionError(f"{out.name} has a session already", "a new folder for each session", "Choose another --out")
    setup.require_sound()
    predict = predictor(setup, options.model)
    with acquiring(acquisition, out, options.seconds) as journal:
        about = about_cell(cell, {k: str(v) for k, v in setup.load_cell.items() if isinstance(v, str)})
        stream = journal.add_stream(cell.name, cell.values, about, cell.clock)
        run = BenchRun(setup, predict, stream)
        meter = StreamMeter(run.full_scale)
        with forwarding(options.to, options.session_name, journal, stream, acquisition, say):
            _follow((acquisition, journal, stream, run, meter), by_keys=_at_terminal(json))
        session = write_bench_session(journal, out, stream)
    body = {"session": str(out), "cases": len(session.cases), "journal": str(out / JOURNAL), "stream": stream}
    if not answer("log", body, json):
        say(f"{len(session.cases)} load cases: {out}   (fingertwin check {out}, fingertwin compare {out})")


def _at_terminal(json: str | None) -> bool:
    return sys.stdin.isatty() and sys.stdout.isatty() and json != "-"


def _follow(parts: tuple[Acquisition, Journal, str, BenchRun, StreamMeter], *, by_keys: bool) -> None:
    """Go on until the session is over: by keys on a redrawn screen, or by lines of text."""
    from server.bench.keys import KeyInput, terminal_keys, typed_lines
    from server.bench.loop import BenchLoop, from_keys, from_lines
    from server.bench.view import LineView, LiveView

    if not by_keys:
        with LineView() as lines:
            BenchLoop(*parts, lines, from_lines(typed_lines()), ends_when_closed=True).go_on()
        return
    keys, run = KeyInput(), parts[3]
    with terminal_keys() as read, LiveView(run, parts[4], keys) as view:
        BenchLoop(*parts, view, from_keys(keys, read, run)).go_on()


def bench_setup(options: LogOptions, cell: LoadCell) -> BenchSetup:
    """What is known before the first reading, of the setup file and of the command.

    Raises:
        SessionError: the file lacks something, or has what it should not.
    """
    from daq.bench.record import BenchSetup
    from daq.protocols import read_protocol

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
    out = options.out or Path()
    rest = {k: v for k, v in given.items() if k not in ("format", "id", "load_cell")}
    return BenchSetup(
        id=str(given.get("id") or out.resolve().name),
        load_cell=load_cell,
        protocol=read_protocol(options.protocol, options.setup.parent),
        protocol_name=options.protocol,
        **rest,
    )
