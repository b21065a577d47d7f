"""`fingertwin journal check`, `recover`, `export` and `requeue`."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from daq.errors import InputError, JournalError
from daq.journal.check import Report, check, recover
from daq.journal.export import export
from daq.journal.writer import Journal
from daq.quoting import counted, quoted
from server.commands.console import answer, progress, say


def journal_check(path: Path, json: str | None) -> None:
    """Read a whole journal, and show whether it is as it was written.

    Raises:
        JournalError: it is not; the answer has been given.
    """
    with progress("Reading"):
        report = check(path)
    if not answer("journal-check", {"journal": str(path), "ok": not report.faults, **asdict(report)}, json):
        _say_report(report)
        if not report.faults:
            say(f"{path}: sound")
    if report.faults:
        first = f"{path}: damaged; {counted(len(report.faults), 'fault')}, the first: {report.faults[0].text}"
        raise JournalError(first, "", f"fingertwin journal recover {quoted(path)} --out NEW keeps what is sound")


def journal_recover(path: Path, out: Path, json: str | None) -> None:
    """Write a new journal with all that is sound, and list what is lost.

    Raises:
        JournalError: anything is; the new journal is written, and the answer has been given.
    """
    with progress("Reading and writing"):
        report = recover(path, out)
    lost = len(report.losses)
    losses = counted(lost, "loss") if lost else "no losses"
    body: dict[str, Any] = {"journal": str(path), "out": str(out), "lost": lost, **asdict(report)}
    if not answer("journal-recover", body, json):
        _say_report(report)
        say(f"{out}: {counted(sum(report.chunks.values()), 'chunk')} recovered; {losses}")
    if lost:
        missing = f": {report.missing}" if report.missing else ""
        raise JournalError(f"{path}: {losses}{missing}", "", f"{out} has all that is sound")


def journal_export(path: Path, out: Path | None, stream: str | None, file_format: str, json: str | None) -> None:
    """Write a stream as a readings file, and its events as JSON."""
    target = out or Path(f"{path.stem}.{file_format}")
    if not target.name.lower().endswith((f".{file_format}", f".{file_format}.gz")):
        raise InputError(f"--format {file_format} and {target.name}", "one of the two", "Let name and format agree")
    with progress("Reading and writing"):
        done = export(path, target, stream)
    body = {"journal": str(path), "stream": done.stream, "samples": done.samples}
    body |= {"readings": str(done.readings), "events": str(done.events)}
    if not answer("journal-export", body, json):
        say(f"{done.samples} samples: {done.readings}; events: {done.events}")


def journal_requeue(path: Path, json: str | None) -> None:
    """Put what a service refused into the outbox again, to be sent by the next log into that folder.

    Raises:
        JournalError: it cannot be written; or, once that is done, readings were lost from it.
    """
    with Journal.open(path) as journal:
        count = journal.requeue()
    if not answer("journal-requeue", {"journal": str(path), "chunks": count}, json):
        many = "1 chunk is" if count == 1 else f"{count} chunks are"
        next_log = f"{many} to be sent again; the next fingertwin log --to with --out {quoted(path.parent)} does so"
        say(f"{path}: {next_log if count else 'nothing was set aside'}")
    if journal.lost is not None:
        raise journal.lost


def _say_report(report: Report) -> None:
    for fault in report.faults:
        say(f"{fault.kind:8} {f'stream {fault.stream[:12]}: ' if fault.stream else ''}{fault.text}")
    for stream, chunks in report.chunks.items():
        say(f"stream {stream[:12]}: {counted(report.samples[stream], 'sample')} in {counted(chunks, 'sound chunk')}")
    if report.undecoded_bytes:
        say(f"{counted(report.undecoded_bytes, 'byte')} that made no reading")
    known = f", {counted(report.known_gaps, 'loss')} noted by an earlier recovery" if report.known_gaps else ""
    aside = f", {report.set_aside} that the service refused are set aside" if report.set_aside else ""
    waiting = f"{counted(report.pending, 'chunk')} {'waits' if report.pending == 1 else 'wait'} to be sent"
    say(f"{counted(report.events, 'event')}, {waiting}{aside}{known}")
