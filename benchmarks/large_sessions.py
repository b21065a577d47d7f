"""Time sessions of many load cases, long recordings, and a long list of sessions.

    python -m benchmarks.large_sessions [--cases 5000] [--rows 3600000] [--sessions 200] [--out FILE]

Processor seconds, not those of a clock, so that figures of a busy machine hold too; compiled programs are at hand.
"""

from __future__ import annotations

import argparse
import contextlib
import datetime as dt
import gc
import io
import multiprocessing
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from benchmarks.machine import commit, most_memory_bytes
from benchmarks.uplink_parts import surroundings
from tests.daq.benches import averaged_of_many

RATE_HZ, RECORDED = 1000.0, 665
# A shipped session of 96 load cases: what a command needs without a long recording.
SHORT = "DEV-01"
Row = tuple[str, float, float]


def record(folder: Path, rows: int, ending: str) -> Path:
    """A recording of a tare and a load for each of many cases."""
    from daq.recordings.readings import ReadingBlock, write_readings

    rng, span = np.random.default_rng(0), rows / RATE_HZ / RECORDED
    data = averaged_of_many("LONG", RECORDED)
    for i, case in enumerate(data["cases"]):
        del case["force_N"], case["force_sd_N"]
        begin = round(i * span, 3)
        case["unloaded_s"] = [begin + 0.04 * span, begin + 0.22 * span]
        case["loaded_s"] = [begin + 0.37 * span, begin + 0.92 * span]
    data["load_cell"]["rate_hz"], data["readings"] = RATE_HZ, f"readings.{ending}"

    def blocks() -> Any:
        for first in range(0, rows, 100_000):
            t = np.arange(first, min(first + 100_000, rows)) / RATE_HZ
            wrench = 0.01 * rng.normal(size=(len(t), 6))
            wrench[:, 1] -= np.where((t % span > 0.28 * span) & (t % span < 0.96 * span), 2.0, 0.0)
            yield ReadingBlock(np.round(t, 6), np.round(wrench, 5))

    out = folder / ending
    out.mkdir()
    write_readings(out / data["readings"], blocks())
    (out / "session.yaml").write_text(yaml.safe_dump(data, sort_keys=False), encoding="utf-8")
    return out


def _cost(act: Callable[[], object]) -> tuple[float, float]:
    """Processor time of this thread [s] and added memory [MB]."""
    before, began = most_memory_bytes(), time.thread_time()
    act()
    return time.thread_time() - began, max(most_memory_bytes() - before, 0.0) / 1e6


def service(folder: Path, cases: int, sessions: int) -> list[Row]:
    from server.service.exports.exporting import session_export
    from server.service.exports.reports import checked, report_page
    from server.service.models.case_updates import case_bodies
    from tests.server.service.running import ServiceReceiver

    receiver = ServiceReceiver(folder)
    parts, client = receiver.parts, receiver.client()
    try:
        for name, count in (("warm", cases), ("S1", cases)):
            gc.freeze()  # as the service does once it is ready
            out: list[Row] = []

            def step(what: str, act: Callable[[], object], into: list[Row] = out) -> None:
                into.append((what, *_cost(act)))

            def cases_of(session: str = name) -> object:
                return case_bodies(parts.measuring.of(session), parts.models)

            step("begin it", partial(parts.sessions.create, name, averaged_of_many(name, count)))
            step("`GET …/cases`, nothing known", cases_of)
            step("`GET …/cases` again", cases_of)
            step("an edit", partial(parts.sessions.edit, name, "exclude", "c00001", {"reason": "slipped"}))
            step("`GET …/cases` after it", cases_of)
            step("`GET …/comparison`", partial(parts.models.comparison, name))
            step("`GET …/check`", partial(checked, parts, name))
            step("`GET …/report`", partial(report_page, parts, name, None, None))
            for kind in ("csv", "parquet", "xlsx", "hdf5", "mat", "folder", "supplement"):
                write = session_export(parts, name, kind, None)
                step(f"export {kind}", partial(write, Path(tempfile.mkdtemp(dir=folder))))
            parts.case_updates.settle(600.0)
        for k in range(sessions):
            parts.sessions.create(f"L{k:03d}", averaged_of_many(f"L{k:03d}", 60))
        parts.case_updates.settle(600.0)
        listing = [_listed(client, sessions) for _ in range(5)]
        return [*out, (f"`GET /sessions`, {sessions} of them", min(listing), 0.0)]
    finally:
        receiver.close()


def _listed(client: Any, sessions: int) -> float:
    began = time.process_time()
    assert len(client.get("/api/v1/sessions", params={"limit": sessions}).json()["sessions"]) == sessions
    return time.process_time() - began


def command(name: str, session: str, what: str, answer: Path) -> list[Row]:
    """A command on a session, in this process."""
    from server.cli import app

    began = time.process_time()
    with contextlib.redirect_stdout(io.StringIO()):
        assert app([name, session, "--json", str(answer)], standalone_mode=False) in (0, None)
    return [(f"`fingertwin {name}`, {what}", time.process_time() - began, most_memory_bytes() / 1e6)]


def _apart(work: Callable[..., list[Row]], *given: object) -> list[Row]:
    """Run in a process of its own."""
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe(duplex=False)
    process = context.Process(target=_send, args=(there, work, given))
    process.start()
    there.close()
    out: list[Row] = here.recv()
    process.join()
    return out


def _send(pipe: Any, work: Callable[..., list[Row]], given: tuple[Any, ...]) -> None:
    pipe.send(work(*given))
    pipe.close()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=5000)
    parser.add_argument("--rows", type=int, default=3_600_000)
    parser.add_argument("--sessions", type=int, default=200)
    parser.add_argument("--out", type=Path, default=Path(__file__).with_suffix(".md"))
    given = parser.parse_args()
    where = surroundings()
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        rows = _apart(service, folder / "service", given.cases, given.sessions)
        long: list[Row] = []
        for what in (SHORT, "csv", "parquet"):
            session = what if what == SHORT else str(record(folder, given.rows, what))
            for name in ("check", "compare"):
                long += _apart(command, name, session, what, folder / "answer.json")
    lines = [
        "# Sessions of many load cases, and long recordings",
        "",
        f"Made by `python -m benchmarks.large_sessions --cases {given.cases} --rows {given.rows} --sessions "
        f"{given.sessions}`",
        f"on {dt.datetime.now(dt.UTC).date()}, commit {commit()}. {where}",
        "",
        f"A session of {given.cases} averaged load cases at the service; aims: 1 s and 300 MB, the list in 0.05 s.",
        "",
        "| step | processor time [s] | added memory [MB] |",
        "|---|---|---|",
        *(f"| {what} | {seconds:.2f} | {memory:.0f} |" for what, seconds, memory in rows),
        "",
        "Most of `folder`, and a third of `supplement`, is writing the session's YAML; most of `xlsx` is XlsxWriter's.",
        "",
        f"A recording of {given.rows} rows with {RECORDED} load cases, one fresh process each; aims: 10 s and 400 MB.",
        f"The first two rows are of the shipped session {SHORT}: what the program itself needs.",
        "",
        "| command | processor time [s] | most memory [MB] |",
        "|---|---|---|",
        *(f"| {what} | {seconds:.1f} | {memory:.0f} |" for what, seconds, memory in long),
    ]
    text = "\n".join(lines) + "\n"
    given.out.write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
