"""Kill the receiver again and again while a bench logs and forwards, and see what arrives.

    python -m benchmarks.uplink_kills [--kills 100] [--seed 0] [--out FILE]

`fingertwin log --to` forwards a simulated cell of 7000 readings a second. The receiver (the tests' small one, a process
of its own) is killed with -9 at a random moment within an exchange and started anew on its file. Mixed in: its disk is
full for a while; its file is put back to an earlier copy; bits are flipped on the way to it. At the end its file is
compared with the journal, byte for byte.
"""

from __future__ import annotations

import argparse
import datetime as dt
import os
import random
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import Pipe, get_context
from multiprocessing.connection import Connection
from multiprocessing.sharedctypes import Synchronized
from pathlib import Path
from typing import Any

import httpx

from benchmarks.machine import commit, publish, use_all_cores
from benchmarks.uplink import command, events_of
from benchmarks.uplink_parts import CATCH_UP_S, Compared, caught_up, compared, play, started, surroundings
from tests.contracts.ingest import ProblemError, SmallReceiver, serving

RATE_HZ = 7000.0
HERE = Path(__file__).parent
STAGES = ("before the transaction", "within it", "committed, nothing answered", "about to answer, or later")
# Each of those takes less than that: the kill falls where it was meant to, or a little later.
WITHIN_S = 0.0003
# A life without a kill that is due is over all the same.
MOST_LIFE_S = 30.0
ROOM_AFTER = 3


@dataclass(frozen=True)
class Life:
    """What is to happen to one receiver.

    Attributes:
        chunks: that it is sent before it is killed; 0 for none.
        stage: of the last exchange at which the kill is called for, an index of STAGES.
        delay_s: from then to the kill; 0 is just there, anything else a little later.
        full: whether its disk is full for the first exchanges.
        flip: whether a bit of its first chunk is flipped on the way.
    """

    chunks: int = 0
    stage: int = 0
    delay_s: float = 0.0
    full: bool = False
    flip: bool = False


class Mortal(SmallReceiver):
    """A receiver that is killed as it is told to, and notes how far it had come.

    Args:
        path: of its file.
        life: what is to happen.
        stage: where an exchange stands, an index of STAGES, in shared memory.
    """

    def __init__(self, path: Path, life: Life, stage: Synchronized[int]) -> None:
        super().__init__(path)
        self._life, self._stage = life, stage
        self._chunks = self._refused = 0
        self._flipped, self._doomed = not life.flip, False
        if life.full:
            pages = self._connection.execute("PRAGMA page_count").fetchone()[0]
            self._connection.execute(f"PRAGMA max_page_count={pages}")

    def _chunk(self, session: str, stream: str, number: str, body: bytes, headers: httpx.Headers) -> Any:
        self._chunks += 1
        self._enter(0)
        if not self._flipped:
            self._flipped = True
            at = len(body) // 3
            body = body[:at] + bytes([body[at] ^ 4]) + body[at + 1 :]
        try:
            answer = super()._chunk(session, stream, number, body, headers)
        except sqlite3.OperationalError as error:
            self._refused += 1
            if self._refused == ROOM_AFTER:
                self._connection.execute("PRAGMA max_page_count=1073741823")
            raise ProblemError(507, str(error)) from error
        self._enter(3)
        return answer

    @contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        with super()._transaction() as connection:
            self._enter(1)
            yield connection
        self._enter(2)

    def _enter(self, stage: int) -> None:
        self._stage.value = stage
        if not self._doomed and 0 < self._life.chunks <= self._chunks and stage == self._life.stage:
            self._doomed = True
            if not self._life.delay_s:
                self._die()
            threading.Thread(target=self._die, daemon=True).start()

    def _die(self) -> None:
        time.sleep(self._life.delay_s)
        os.kill(os.getpid(), signal.SIGKILL)


def live(end: Connection, path: Path, port: int, life: Life, stage: Synchronized[int]) -> None:
    """The receiver's process."""
    # So that the thread that kills does not wait for the one that answers.
    sys.setswitchinterval(2e-5)
    receiver = Mortal(path, life, stage)
    with serving(receiver.handle, port) as url:
        end.send(url)
        end.recv()
    receiver.close()


def lived(path: Path, url: str, life: Life) -> tuple[str, int]:
    """Let a receiver live until it is killed; return its address and the stage at which that was."""
    ours, theirs = Pipe()
    context = get_context("spawn")
    stage = context.Value("i", 0)
    port = int(url.rpartition(":")[2] or 0)
    process = context.Process(target=live, args=(theirs, path, port, life, stage), daemon=True)
    process.start()
    theirs.close()
    url = ours.recv()
    process.join(MOST_LIFE_S)
    if process.is_alive():
        process.kill()
        process.join()
    ours.close()
    return url, int(stage.value)


@dataclass
class Tally:
    """What was done, and what came of it."""

    stages: Counter[int]
    full: int = 0
    put_back: int = 0
    flipped: int = 0
    afterwards: bool = False
    aside: int = 0
    result: Compared | None = None


def killed(kills: int, seed: int, folder: Path) -> Tally:
    """Kill as many receivers, one after the other, and compare."""
    draw = random.Random(seed)
    path, early = folder / "received.sqlite", folder / "early.sqlite"
    with closing(SmallReceiver(path)) as receiver:
        session = receiver.new_session()
    tally = Tally(Counter())
    journal = folder / "log" / "journal.sqlite3"
    with ExitStack() as held:
        _, _, (address, _) = held.enter_context(started(play, RATE_HZ, 20.0 * kills + 120.0))
        # The logger finds nobody there at first.
        url = free_address(path, draw)
        line = command(address, RATE_HZ, journal.parent, url, session, None)
        logger = held.enter_context(subprocess.Popen(line, stdout=subprocess.PIPE, text=True))
        held.callback(logger.kill)
        for k in range(kills):
            full, flip = k % 12 == 5, k % 20 == 9
            chunks = draw.randint(1, 6) + 4 * full
            delay_s = draw.choice((0.0, draw.uniform(0.0, WITHIN_S)))
            life = Life(chunks, draw.randrange(len(STAGES)), delay_s, full, flip)
            url, stage = lived(path, url, life)
            tally.stages[stage] += 1
            tally.full += full
            tally.flipped += flip
            if k % 15 == 4:
                copied(path, early)
            if k % 15 == 11:
                put_back(early, path)
                tally.put_back += 1
            if logger.poll() is not None:
                raise RuntimeError(f"the logger ended with {logger.returncode}")
        with serving_again(path, url):
            time.sleep(2.0)
            logger.send_signal(signal.SIGINT)
            logger.communicate(timeout=CATCH_UP_S)
            tally.result = compared(journal, path, session)
            tally.aside = events_of(journal).get("quarantined", 0)
            if not tally.result.sound:
                tally.afterwards = True
                caught_up(journal, url, session)
                tally.result = compared(journal, path, session)
    return tally


def free_address(path: Path, draw: random.Random) -> str:
    """An address for the receiver, of a port that the system gives to nobody else while the receiver is dead."""
    while True:
        with (
            suppress(OSError),
            closing(SmallReceiver(path)) as receiver,
            serving(receiver.handle, draw.randint(20_000, 30_000)) as url,
        ):
            return url


@contextmanager
def serving_again(path: Path, url: str) -> Iterator[None]:
    """A receiver that nothing happens to."""
    with closing(SmallReceiver(path)) as receiver, serving(receiver.handle, int(url.rpartition(":")[2])):
        yield


def copied(path: Path, early: Path) -> None:
    """Keep a copy of the receiver's file, as a backup does."""
    with closing(sqlite3.connect(path)) as source, closing(sqlite3.connect(early)) as target:
        source.backup(target)


def put_back(early: Path, path: Path) -> None:
    """Put the receiver's file back to an earlier state: what came since is gone."""
    path.with_name(path.name + "-journal").unlink(missing_ok=True)
    shutil.copyfile(early, path)


def main() -> None:
    """Run and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=HERE / "uplink_kills.md")
    given = parser.parse_args()
    use_all_cores()
    # In the background of a shell it is ignored, by the logger too, which is to end by it.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    where, began = surroundings(), time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        tally = killed(given.kills, given.seed, Path(folder))
    assert tally.result is not None
    result = tally.result
    stages = "; ".join(f"{name}: {tally.stages[k]}" for k, name in enumerate(STAGES))
    rows = [
        ("receivers killed with -9", f"{given.kills}", ""),
        ("the last exchange was then", stages, ""),
        ("with a full disk for a while", f"{tally.full}", ""),
        ("put back to an earlier copy of its file", f"{tally.put_back}", ""),
        ("bits flipped on the way", f"{tally.flipped}", ""),
        ("readings in the journal", f"{result.kept}", ""),
        ("readings at the receiver", f"{result.arrived}", "the same"),
        ("lost", f"{result.lost}", "0"),
        ("there twice", f"{result.doubled}", "0"),
        ("chunks that are not there as they were kept", f"{result.different}", "0"),
        ("chunks set aside with an alarm", f"{tally.aside}", "0"),
        ("events lost, there twice", f"{result.events_lost}, {result.events_doubled}", "0, 0"),
    ]
    lines = [
        "# Killing the receiver while a bench forwards",
        "",
        f"Made by `python -m benchmarks.uplink_kills --kills {given.kills} --seed {given.seed}`",
        f"on {dt.datetime.now(dt.UTC).date()}, commit {commit()}, in {time.monotonic() - began:.0f} s. {where}",
        "",
        "| figure | value | aim |",
        "|---|---|---|",
        *(f"| {what} | {value} | {aim} |" for what, value, aim in rows),
        "",
        "All was there once the log had ended."
        if not tally.afterwards
        else "The log had ended before all was there; the rest was sent when its journal was opened again.",
        "The logger went on throughout, at 7000 readings a second. A reading is there twice where two chunks hold it.",
        "A chunk with a bit that was flipped on the way is refused by its SHA-256."
        + (" Those set aside are in the journal, and are what is lost here." if tally.aside and result.lost else ""),
        "",
    ]
    publish(given.out, lines)


if __name__ == "__main__":
    main()
