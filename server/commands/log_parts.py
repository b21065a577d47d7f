"""Parts of every log, with or without a protocol: options, load cell, open journal."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from daq.acquisition.acquire import Acquisition
from daq.drivers.base import LoadCell
from daq.journal.writer import Journal
from daq.memory import keep_flat
from daq.sessions import JOURNAL_FILE
from daq.signals.gauges import read_calibration
from server.commands.closing_copy import Closed


@dataclass(frozen=True)
class LogOptions:
    """Options of `fingertwin log`."""

    driver: str  # its name, or `list`
    port: str | None  # what it hangs on
    baud: int | None  # of a serial port
    settings: tuple[str, ...]  # `name=value`, as they were given
    out: Path | None  # folder of the log
    seconds: float | None  # after which it ends; None goes on until Ctrl-C or the recording is over
    # Model, serial number and calibration of the load cell, as far as given.
    cell: dict[str, str] = field(default_factory=dict)
    protocol: str | None = None  # that a bench session follows, by name or file
    setup: Path | None = None  # file of what is known before the first reading
    model: str | None = None  # that predictions are made with; by default the setup's finger
    to: str | None = None  # address of a service that the log goes to
    session: str | None = None  # there; by default the folder's name
    resume: bool = False  # whether a bench session that broke off goes on
    copy_to: Path | None = None  # folder of a closing copy, on another disk or share
    document: Mapping[str, Any] | None = None  # of a recorded session that is replayed
    passing: bool = False

    @property
    def session_name(self) -> str:
        """Name of the session at the service."""
        return self.session or (self.out or Path()).resolve().name


def about_cell(cell: LoadCell, given: dict[str, str]) -> dict[str, str]:
    """Return the description of the load cell; a calibration file is included, so that raw bytes can be decoded.

    Such a file also says of what model and serial number the cell is, where nobody else does.
    """
    path = Path(str(cell.values.get("calibration", "")))
    if not path.name or not path.is_file():
        return given
    found = read_calibration(path)
    stated = {"model": found.model, "serial": found.serial, "calibration": path.name}
    text = path.read_text(encoding="utf-8", errors="replace")
    return {**{k: v for k, v in stated.items() if v}, **given, "calibration_text": text}


@contextmanager
def acquiring(acquisition: Acquisition, folder: Path, seconds: float | None, closed: Closed) -> Iterator[Journal]:
    """Start a load cell and open its folder's journal; stop and close both, and the cell after so long.

    The device first: one that is not there leaves no empty journal. What it says meanwhile waits.

    Args:
        acquisition: not started yet.
        folder: of the log.
        seconds: after which the cell is stopped; None for never.
        closed: takes the journal once it is closed.
    """
    keep_flat()
    acquisition.start()
    stop = threading.Timer(seconds or 0.0, acquisition.stop)
    try:
        with closing(_journal(folder)) as journal:
            if journal.lost is not None:
                sys.stderr.write(f"fingertwin: WARNING: {journal.lost}\n")
            if seconds is not None:
                stop.start()
            try:
                yield journal
            finally:
                # Before the journal: what the cell still says has nowhere to go afterwards.
                acquisition.stop()
                journal.stay()
                closed.path, closed.displaced, closed.lost = journal.path, journal.displaced, journal.lost
    finally:
        stop.cancel()
        acquisition.stop()


def _journal(folder: Path) -> Journal:
    """Open the folder's journal, a new one where there is none."""
    path = folder / JOURNAL_FILE
    return Journal.open(path) if path.exists() else Journal.create(path, folder.resolve().name)
