"""Kill a journal's writer again and again, and damage copies of what it leaves: what is lost, and what is not found.

    python -m benchmarks.journal_damage [--kills 200] [--seed 0] [--out FILE]

A writer of chunks that only their number decides is killed with -9 at a random moment, and its journal compared with
what it had said it keeps; for some the disk is full meanwhile. Then each of its files (the journal, its log, the log's
index, the mark) is damaged in a copy of all of them, which is checked, read and recovered. Nothing that is read or
recovered may differ from what was written.
"""

from __future__ import annotations

import argparse
import datetime as dt
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.machine import commit, publish
from benchmarks.recovery import wilson
from benchmarks.uplink_parts import surroundings
from daq.acquisition.blocks import Chunk
from daq.errors import JournalError
from daq.journal.check import check, recover
from daq.journal.lock import lock_file
from daq.journal.mark import mark_file
from daq.journal.wal import log_file, read_log
from daq.journal.writer import Event, Journal, JournalReader
from tests.daq.journal_writer import made_chunk, made_count

HERE = Path(__file__).parent
# Sessions in one journal, before a new one is begun.
SESSIONS = 4
MOST_CHUNKS = 40
# Pages that a full disk still has room for.
FEW_PAGES = 40
WITHIN_S = 0.02
# As a disk loses them; heads of a write-ahead log and of each of its frames.
BLOCK, LOG_HEAD, FRAME_HEAD = 4096, 32, 24

Content = dict[str, list[int]]


def write(path: Path, pages: int) -> None:
    """The writer's process: append, send some of it, and say what is acknowledged, until it is killed."""
    with Journal.open(path, 0) as journal:
        stream = journal.add_stream("made", {"rate_hz": 7000.0}, {"serial": "1"})
        print(stream, flush=True)
        if pages:
            most = journal._connection.execute("PRAGMA page_count").fetchone()[0] + pages
            journal._connection.execute(f"PRAGMA max_page_count={most}")
        seq = 0
        for i in range(1_000_000):
            events = [Event("mark", seq / 7000.0, {"seq": seq})] if i % 3 == 0 else []
            chunk = made_chunk(seq, made_count(seq))
            try:
                after = journal.append(stream, chunk, events)
            except JournalError:
                print("full", flush=True)
                journal._connection.execute("PRAGMA max_page_count=1073741823")
                continue
            if i % 2:
                journal.acknowledged(stream, seq)
            seq = after
            print(seq, flush=True)


def kill(path: Path, draw: random.Random, full: bool) -> tuple[str, int, bool]:
    """Start a writer and kill it; return its stream, what it acknowledged, and whether its disk was ever full."""
    pages = draw.randint(1, FEW_PAGES) if full else 0
    command = [sys.executable, "-m", "benchmarks.journal_damage", "--write", str(path), "--pages", str(pages)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, bufsize=1) as child:
        assert child.stdout is not None
        stream = child.stdout.readline().strip()
        said = [child.stdout.readline() for _ in range(draw.randrange(MOST_CHUNKS))]
        time.sleep(draw.uniform(0.0, WITHIN_S))
        child.kill()
        # What it said before it died counts too; a line that was cut short does not.
        said += [line for line in child.stdout.read().splitlines(keepends=True) if line.endswith("\n")]
    words = [line.strip() for line in said]
    return stream, max((int(w) for w in words if w != "full"), default=0), "full" in words


def same(chunk: Chunk) -> bool:
    """Whether a chunk is the one that was written."""
    wanted = made_chunk(chunk.first_seq, made_count(chunk.first_seq))
    return chunk.to_bytes() == wanted.to_bytes()


@dataclass
class Seen:
    """What a journal gave.

    Attributes:
        content: first numbers of the chunks of each stream.
        events: their number.
        wrong: samples that were read and never written so.
        refused: whether reading ended with an error that says so.
    """

    content: Content = field(default_factory=dict)
    events: int = 0
    wrong: int = 0
    refused: bool = False


def seen_in(path: Path) -> Seen:
    """Read all that a reader gives."""
    seen = Seen()
    try:
        with JournalReader.open(path) as journal:
            for stream in journal.streams():
                seen.content[stream.id] = []
                for chunk in journal.read(stream.id):
                    seen.content[stream.id].append(chunk.first_seq)
                    seen.wrong += 0 if same(chunk) else len(chunk)
            seen.events = sum(e.kind == "mark" for e in journal.events())
    except JournalError:
        seen.refused = True
    return seen


def whole(stream: list[int]) -> tuple[int, int]:
    """Samples that a stream holds in order from 0 on, and chunks that are lost or doubled in it."""
    at = wrong = 0
    for first in stream:
        wrong += first != at
        at = first + made_count(first)
    return at, wrong


def used(path: Path) -> int:
    """Bytes of a write-ahead log that matter: what is older lies behind them."""
    log = read_log(path)
    if log is None or not log.current.any():
        return 0
    return LOG_HEAD + (int(np.flatnonzero(log.current)[-1]) + 1) * (FRAME_HEAD + log.page_bytes)


def torn(path: Path) -> bool:
    """Whether the log ends within a transaction."""
    log, end = read_log(path), used(path)
    if log is None or not end:
        return False
    last = end - FRAME_HEAD - log.page_bytes
    return not any(log.data[last + 4 : last + 8])


def flipped(path: Path, end: int, draw: random.Random) -> None:
    """Flip a bit."""
    at = draw.randrange(end)
    with path.open("r+b") as file:
        file.seek(at)
        octet = file.read(1)[0]
        file.seek(at)
        file.write(bytes([octet ^ 1 << draw.randrange(8)]))


def zeroed(path: Path, end: int, draw: random.Random) -> None:
    """Fill 4 KiB with zeros, as a lost block of a disk."""
    at = BLOCK * draw.randrange(max(end // BLOCK, 1))
    with path.open("r+b") as file:
        file.seek(at)
        file.write(bytes(BLOCK))


def beheaded(path: Path, end: int, draw: random.Random) -> None:
    """Fill the first 4 KiB with zeros: head and first frame."""
    with path.open("r+b") as file:
        file.write(bytes(min(BLOCK, end)))


def cut(path: Path, end: int, draw: random.Random) -> None:
    """Cut the end off."""
    with path.open("r+b") as file:
        file.truncate(end - draw.randint(1, max(end // 2, 1)))


def gone(path: Path, end: int, draw: random.Random) -> None:
    """Delete it."""
    path.unlink()


def index_file(path: Path) -> Path:
    """Where the index of a journal's write-ahead log lies."""
    return path.with_name(path.name + "-shm")


FILES: dict[str, tuple[Callable[[Path], Path], bool]] = {
    # Where it lies, and whether it tells what the journal holds.
    "the file": (lambda path: path, True),
    "the write-ahead log": (log_file, True),
    "the log's index": (index_file, False),
    "the mark": (mark_file, False),
}
DAMAGES: dict[tuple[str, str], Callable[[Path, int, random.Random], None]] = {
    ("a bit flipped", "the file"): flipped,
    ("4 KiB of zeros", "the file"): zeroed,
    ("cut short", "the file"): cut,
    ("a bit flipped", "the write-ahead log"): flipped,
    ("4 KiB of zeros", "the write-ahead log"): zeroed,
    ("zeros in its first 4 KiB", "the write-ahead log"): beheaded,
    ("cut short", "the write-ahead log"): cut,
    ("deleted", "the write-ahead log"): gone,
    **{(damage, file): do for file in ("the log's index", "the mark") for damage, do in (
        ("a bit flipped", flipped), ("4 KiB of zeros", zeroed), ("cut short", cut), ("deleted", gone))},
}  # fmt: skip


def shortened(seen: Seen, true: Seen) -> int:
    """How many transactions are gone from the end, where nothing else differs; 0 where something does."""
    gone = 0
    for name, chunks in true.content.items():
        left = seen.content.get(name, [])
        if chunks[: len(left)] != left:
            return 0
        gone += len(chunks) - len(left)
    # Each chunk is a transaction, and noting what was sent, or a stream, is one.
    return max(gone, 1)


@dataclass
class Row:
    """What came of one kind of damage."""

    tried: int = 0
    harmless: int = 0
    found: int = 0
    false: int = 0
    last: int = 0
    undetected: int = 0
    wrong: int = 0
    chunks: int = 0
    recovered: int = 0


def damaged(path: Path, true: Seen, name: tuple[str, str], draw: random.Random, row: Row) -> None:
    """Damage a file in a copy of all of a journal's, and see what check, a reader and recovery make of it."""
    damage, (where, tells) = DAMAGES[name], FILES[name[1]]
    copy, out = path.with_name("copy.journal"), path.with_name("out.journal")
    places = (*(place for place, _ in FILES.values()), lock_file)
    for place in places:
        place(copy).unlink(missing_ok=True)
        if place(path).exists():
            shutil.copyfile(place(path), place(copy))
    out.unlink(missing_ok=True)
    target = where(copy)
    if not target.exists():
        return
    end = used(copy) if name[1] == "the write-ahead log" else target.stat().st_size
    if not end:
        return
    damage(target, end, draw)
    row.tried += 1
    row.chunks += sum(map(len, true.content.values()))
    found = True
    with suppress(JournalError):  # which says so
        found = bool(check(copy).faults)
    seen = seen_in(copy)
    row.wrong += seen.wrong
    if found:
        row.found += 1
        row.false += not tells
    elif (seen.content, seen.events) == (true.content, true.events):
        row.harmless += 1
    elif name[1] == "the write-ahead log" and shortened(seen, true) == 1:
        row.last += 1
    else:
        row.undetected += 1
    with suppress(JournalError):  # where not even its head can be read
        recover(copy, out)
        again = seen_in(out)
        row.wrong += again.wrong + sum(made_count(f) for s in again.content.values() for f in s if s.count(f) > 1)
        row.recovered += sum(map(len, again.content.values()))
        row.undetected += bool(check(out).faults)


@dataclass
class Tally:
    """Of all kills."""

    kept: int = 0
    acknowledged: int = 0
    lost: int = 0
    losing: int = 0
    doubled: int = 0
    wrong: int = 0
    faults: int = 0
    full: int = 0
    torn: int = 0


def killed(kills: int, seed: int, folder: Path) -> tuple[Tally, dict[tuple[str, str], Row]]:
    """Kill and damage."""
    draw, tally, rows = random.Random(seed), Tally(), {name: Row() for name in DAMAGES}
    path, said = folder / "bench.journal", dict[str, int]()
    for k in range(kills):
        if k % SESSIONS == 0:
            path, said = folder / str(k) / "bench.journal", {}
            Journal.create(path, "kills", 0).close()
        stream, acknowledged, full = kill(path, draw, k % 5 == 2)
        said[stream] = acknowledged
        tally.full += full
        tally.torn += torn(path)
        tally.faults += len(check(path).faults)
        seen = seen_in(path)
        tally.wrong += seen.wrong
        for name, number in said.items():
            kept, wrong = whole(seen.content.get(name, []))
            tally.doubled += wrong
            tally.lost += max(number - kept, 0)
            tally.losing += number > kept
            if name == stream:
                tally.kept += kept
                tally.acknowledged += number
        for file in FILES:
            kinds = [name for name in DAMAGES if name[1] == file]
            damage = kinds[k % len(kinds)]
            damaged(path, seen, damage, draw, rows[damage])
        if k % SESSIONS == SESSIONS - 1:
            shutil.rmtree(path.parent)
    return tally, rows


def share(failures: int, trials: int) -> str:
    """How many of so many fail, with Wilson's interval."""
    low, high = wilson(failures, trials)
    return f"{failures} did (Wilson's 95 % interval of the rate: {100 * low:.2f} to {100 * high:.2f} %)"


def main() -> None:
    """Run and write; or write until killed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=HERE / "journal_damage.md")
    parser.add_argument("--write", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--pages", type=int, default=0, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.write:
        write(given.write, given.pages)
        return
    where, began = surroundings(), time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        tally, rows = killed(given.kills, given.seed, Path(folder))
    tried, missed = sum(r.tried for r in rows.values()), sum(r.undetected + (r.wrong > 0) for r in rows.values())
    lines = [
        "# Killing a journal's writer, and damaging what it leaves",
        "",
        f"Made by `python -m benchmarks.journal_damage --kills {given.kills} --seed {given.seed}`",
        f"on {dt.datetime.now(dt.UTC).date()}, commit {commit()}, in {time.monotonic() - began:.0f} s. {where}",
        "",
        "| killed with -9 | value | aim |",
        "|---|---|---|",
        f"| writers | {given.kills} | |",
        f"| of these, with a transaction torn off | {tally.torn} | |",
        f"| with a full disk before | {tally.full} | |",
        f"| readings acknowledged | {tally.acknowledged} | |",
        f"| readings kept | {tally.kept} | at least as many |",
        f"| acknowledged and lost | {tally.lost} | 0 |",
        f"| chunks doubled or out of order | {tally.doubled} | 0 |",
        f"| readings that differ from what was written | {tally.wrong} | 0 |",
        f"| faults that `check` finds | {tally.faults} | 0 |",
        "",
        f"Of {given.kills} kills none may lose what was acknowledged: {share(tally.losing, given.kills)}.",
        "",
        "| damage | of | tried | no effect | found | false alarm | the last alone | not found "
        "| readings made up | chunks there before | recovered |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
        *(
            f"| {damage} | {file} | {r.tried} | {r.harmless} | {r.found} | {r.false} | {r.last} | {r.undetected} "
            f"| {r.wrong} | {r.chunks} | {r.recovered} |"
            for (damage, file), r in rows.items()
        ),
        "",
        f"Of {tried} damages none may be missed or make a reading up: {share(missed, tried)}.",
        "",
        "No effect: all is read as it was written. False alarm: a fault that is found where only what tells nothing of",
        "the readings is damaged. The last alone: only the log's last transaction is unreadable, and the mark does not",
        "know it, which a kill within a commit leaves as well. Not found: anything else that is missing or differs",
        "while `check` finds no fault, or a fault in what was recovered. Readings made up: read or recovered without",
        "an error and never written so, zeros among them.",
        "",
    ]
    publish(given.out, lines)


if __name__ == "__main__":
    main()
