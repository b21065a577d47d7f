"""From a sample to a screen elsewhere, and to acknowledged storage: how long it takes.

    python -m benchmarks.uplink_latency [--seconds 60] [--to URL --sessions A,B] [--out FILE]

A stand-in for a Net F/T box writes into Fx the moment at which each reading is due; a logger, put together as
`fingertwin log --to` does, and a receiver are processes of their own on the same machine and clock. A reading's age
begins when the cell takes it, so that the box's own gathering (4 ms here) counts.

Live view: until the receiver has read the envelope that shows the reading, and until the logger has its answer.
Storage: until the journal has a chunk's acknowledgement on the disk, which is after the receiver's commit. What a
screen needs to draw is not in it.
"""

from __future__ import annotations

import argparse
import datetime as dt
import multiprocessing
import tempfile
import time
from contextlib import ExitStack, closing
from multiprocessing.connection import Connection
from pathlib import Path
from threading import Timer
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import commit, publish, use_all_cores
from benchmarks.uplink_parts import SETTINGS, play, receive, started, surroundings

Floats = NDArray[np.float64]

RATES_HZ = (7000.0, 1000.0)
HERE = Path(__file__).parent
# Of each run, before which nothing is counted.
WARM_S = 3.0
FLUSH_S = 15.0
LIVE_AIM_MS, STORED_AIM_MS = 60.0, 600.0


def log(end: Connection, address: str, rate_hz: float, seconds: float, url: str, session: str, folder: Path) -> None:
    """The logger's process: sends (moment, Fx of the first, of the last, number) of what was shown and acknowledged."""
    from daq.acquisition.acquire import Acquisition
    from daq.acquisition.blocks import Chunk
    from daq.acquisition.transports import connect
    from daq.drivers import driver
    from daq.journal.writer import Journal
    from daq.uplink.live_tail import LiveTail
    from daq.uplink.thread import Uplink
    from server.commands.log import Logging

    shown: list[tuple[float, float, float, int]] = []
    stored: list[tuple[float, float, float, int]] = []
    kept: list[tuple[float, float, float, int]] = []

    class Noted(Journal):
        """Notes when a chunk is kept and when it is acknowledged."""

        def __init__(self, *given: Any) -> None:
            super().__init__(*given)
            self.ages: dict[tuple[str, int], tuple[float, float, int]] = {}

        def append(self, stream: str, chunk: Chunk, events: Any = ()) -> int:
            after = super().append(stream, chunk, events)
            age = (float(chunk.wrench[0, 0]), float(chunk.wrench[-1, 0]), len(chunk))
            kept.append((time.monotonic(), *age))
            self.ages[stream, chunk.first_seq] = age
            return after

        def acknowledged(self, stream: str, first_seq: int) -> None:
            super().acknowledged(stream, first_seq)
            stored.append((time.monotonic(), *self.ages.pop((stream, first_seq))))

    class Answered(LiveTail):
        """Notes when the answer to an envelope is there."""

        def post(self, windows: Any) -> bool:
            taken = super().post(windows)
            now = time.monotonic()
            told = [w.message() for w in windows] if taken else []
            shown.extend((now, m["least"][0], m["latest"][0], m["count"]) for m in told)
            return taken

    end.send("ready")
    cell = driver("ati-netft")({**SETTINGS, "rate_hz": rate_hz})
    run = Acquisition(cell, lambda: connect(cell, address))
    run.start()
    with closing(Noted.create(folder / "journal.sqlite3", "benchmark")) as journal:
        logging = Logging(journal, cell, {}, quiet=True)
        uplink, tail = Uplink(journal, url, session), Answered(url, session)
        run.live = lambda t_s, samples: tail.offer(logging.stream, t_s, samples.wrench, samples.overload)
        uplink.start()
        tail.start()
        timer = Timer(seconds, run.stop)
        timer.start()
        told = logging.run(run)
        timer.join()
        run.live = None
        tail.stop()
        whole = uplink.flush(FLUSH_S)
        uplink.stop()
    end.send({"shown": shown, "stored": stored, "kept": kept, "whole": whole, "dropped": tail.dropped, **told})


def ages(seen: list[tuple[float, float, float, int]], first_s: float) -> Floats:
    """Age of every reading [ms]; those of an envelope or chunk are spread evenly between its first and last."""
    parts = [
        1e3 * (now - first_s - np.linspace(oldest, newest, count))
        for now, oldest, newest, count in seen
        if oldest > WARM_S
    ]
    return np.concatenate(parts)


def measured(rate_hz: float, seconds: float, to: str | None, session: str) -> dict[str, Any]:
    """Log and forward for so long; return ages [ms]."""
    with tempfile.TemporaryDirectory() as name, ExitStack() as held:
        folder = Path(name)
        url, receiver = to or "", None
        if to is None:
            process, receiver, (url, (session,)) = held.enter_context(started(receive, folder / "received", 1, 0))
        _, _, (address, first_s) = held.enter_context(started(play, rate_hz, seconds + 30.0))
        _, logger, _ = held.enter_context(started(log, address, rate_hz, seconds, url, session, folder))
        if not logger.poll(seconds + 60.0):
            raise multiprocessing.TimeoutError("the logger does not end")
        told = logger.recv()
        out = {
            "at the journal": ages(told["kept"], first_s),
            "live: at the receiver": None,
            "live: answered": ages(told["shown"], first_s),
            "stored and acknowledged": ages(told["stored"], first_s),
        }
        if receiver is not None:
            receiver.send("end")
            out["live: at the receiver"] = ages(receiver.recv(), first_s)
            process.join(10.0)
        return {"ages": out, "whole": told["whole"], "dropped": told["dropped"], "samples": told["samples"]}


AIMS = {"live: at the receiver": LIVE_AIM_MS, "live: answered": LIVE_AIM_MS, "stored and acknowledged": STORED_AIM_MS}


def main() -> None:
    """Run and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--to", help="address of a service; by default the tests' small receiver")
    parser.add_argument("--sessions", help="two there, separated by a comma, for the two rates")
    parser.add_argument("--out", type=Path, default=HERE / "uplink_latency.md")
    given = parser.parse_args()
    sessions = (given.sessions or ",").split(",")
    if len(sessions) != len(RATES_HZ) or (given.to and not all(sessions)):
        parser.error("--to needs --sessions, two of them")
    use_all_cores()
    where, table, notes = surroundings(), [], []
    for rate_hz, session in zip(RATES_HZ, sessions, strict=True):
        seen = measured(rate_hz, given.seconds, given.to, session)
        for what, age in seen["ages"].items():
            if age is not None:
                p50, p99, most = np.quantile(age, 0.5), np.quantile(age, 0.99), age.max()
                aim = f"{AIMS[what]:g}" if what in AIMS else ""
                table.append(f"| {rate_hz:g} Hz | {what} | {len(age)} | {p50:.0f} | {p99:.0f} | {most:.0f} | {aim} |")
        whole = "all" if seen["whole"] else "not all"
        notes.append(
            f"{rate_hz:g} Hz: {seen['dropped']} envelopes dropped, {whole} of {seen['samples']} readings stored."
        )
    lines = [
        "# From a sample to the live view and to acknowledged storage",
        "",
        f"Made by `python -m benchmarks.uplink_latency --seconds {given.seconds:g}`",
        f"on {dt.datetime.now(dt.UTC).date()}, commit {commit()}. {where}",
        "",
        "| rate | until | readings | median [ms] | 99 % [ms] | longest [ms] | aim for 99 % |",
        "|---|---|---|---|---|---|---|",
        *table,
        "",
        *notes,
        "",
        "A reading's age counts from the moment at which the simulated cell takes it (its Fx is that moment), through",
        "the box's gathering for up to 4 ms, the network, decoding, and an envelope of 20 ms or a chunk of 100 ms.",
        "Live, at the receiver: its thread has read the envelope; answered: the logger has its answer. Stored and",
        "acknowledged: the receiver has committed the chunk, and the journal has noted so on the disk. Drawing on a",
        "screen, and a network between two computers, are not in it.",
        "",
    ]
    publish(given.out, lines)


if __name__ == "__main__":
    main()
