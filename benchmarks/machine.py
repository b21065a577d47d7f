"""One core, a quiet machine, repeated timings, and small tables of what came out."""

from __future__ import annotations

import argparse
import os
import platform
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

_THREADS = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMEXPR_NUM_THREADS",
)
_XLA = "--xla_cpu_multi_thread_eigen=false"
# Below this share of the core, something else was running: the figure is of the machine, not of the program.
OWN_SHARE = 0.97


def use_one_core() -> None:
    """Keep this process and its children to one core; to be called before NumPy or JAX are imported."""
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    if _XLA not in os.environ.get("XLA_FLAGS", ""):
        os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {_XLA}".strip()
    if sys.platform == "linux":
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})


def use_all_cores() -> None:
    """Undo that: where several processes share the machine, as on a bench's PC."""
    if sys.platform == "linux":
        os.sched_setaffinity(0, range(os.cpu_count() or 1))


@dataclass(frozen=True)
class Timing:
    """Repetitions of one thing.

    Attributes:
        seconds: of each repetition, by the wall clock.
        share: of the core that this process and its children had, of each repetition.
    """

    seconds: tuple[float, ...]
    share: tuple[float, ...]

    @property
    def least(self) -> float:
        """Seconds of the fastest repetition."""
        return min(self.seconds)

    @property
    def median(self) -> float:
        """Median of the seconds."""
        return statistics.median(self.seconds)

    @property
    def own_share(self) -> float:
        """Share of the core during the fastest repetition."""
        return self.share[self.seconds.index(self.least)]


def sessions_parser(doc: str | None, each: int, of: str, file: str) -> argparse.ArgumentParser:
    """Options that benchmarks on drawn sessions share.

    Args:
        doc: of the benchmark.
        each: how many sessions by default.
        of: what each so many are of, in words.
        file: of the benchmark; its figures lie beside it.
    """
    parser = argparse.ArgumentParser(description=doc)
    parser.add_argument("--each", type=int, default=each, help=f"sessions of each {of}")
    parser.add_argument("--seed-from", default=None, metavar="COMMIT")
    parser.add_argument("--out", type=Path, default=Path(file).with_suffix(".md"))
    return parser


def repeat(work: Callable[[], object], times: int, patience_s: float = 20.0) -> Timing:
    """Time something that has been warmed up; repetitions that were disturbed are made anew while patience lasts."""
    kept: list[tuple[float, float]] = []
    spoilt: list[tuple[float, float]] = []
    began = time.perf_counter()
    while len(kept) < times:
        wall, own = time.perf_counter(), _own_seconds()
        work()
        own, wall = _own_seconds() - own, time.perf_counter() - wall
        (kept if own > OWN_SHARE * wall else spoilt).append((wall, min(own / wall, 1.0)))
        if time.perf_counter() - began > patience_s and len(kept) + len(spoilt) >= times:
            break
    seconds, share = zip(*(kept + sorted(spoilt))[:times], strict=True)
    return Timing(seconds, share)


def _own_seconds() -> float:
    """Processor time of this process and of its children that have ended."""
    children = os.times()
    return time.process_time() + children.children_user + children.children_system


def wait_until_quiet(patience_s: float = 15.0) -> None:
    """Wait until the cores are all but idle, and say so where they never are."""
    began = time.perf_counter()
    while (busy := _busy_cores()) > 0.3:
        if time.perf_counter() - began > patience_s:
            sys.stderr.write(f"benchmarks: other programs keep {busy:.1f} cores busy; the figures suffer\n")
            return


def _busy_cores(over_s: float = 1.0) -> float:
    """Cores that are at work now, over a second in which this process sleeps; 0 where the system does not tell."""
    before = _ticks()
    time.sleep(over_s)
    after = _ticks()
    return (after - before) / os.sysconf("SC_CLK_TCK") / over_s if before else 0.0


def _ticks() -> int:
    try:
        fields = [int(x) for x in Path("/proc/stat").read_text(encoding="ascii").split("\n", 1)[0].split()[1:9]]
    except OSError:
        return 0
    idle = fields[3] + fields[4]
    return sum(fields) - idle


def most_memory_bytes() -> float:
    """Most memory that this process ever held."""
    status = Path("/proc/self/status")
    if status.exists():
        # getrusage would count what the parent held when it started this process.
        line = next(x for x in status.read_text(encoding="ascii").splitlines() if x.startswith("VmHWM"))
        return 1024.0 * float(line.split()[1])
    import resource

    return float(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)


def describe_machine() -> str:
    """Processor and number of cores."""
    model = platform.processor() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        model = next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        pass
    return f"{model}, {os.cpu_count()} cores, of which one is used; {platform.system()} {platform.release()}"


def table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]], note: str = "") -> None:
    """Print a table as Markdown, padded so that it reads as plain text too."""
    widths = [max(len(row[i]) for row in [columns, *rows]) for i in range(len(columns))]
    print(f"## {title}\n")
    for row in (columns, ["-" * w for w in widths], *rows):
        print("| " + " | ".join(x.ljust(w) for x, w in zip(row, widths, strict=True)) + " |")
    print(f"\n{note}\n" if note else "")


def publish(file: Path, lines: Sequence[str]) -> None:
    """Write a page of figures, and show it."""
    text = "\n".join(lines)
    file.write_text(text, encoding="utf-8")
    print(text)


@cache
def commit() -> str:
    """The commit that is measured, and whether files differ from it."""
    try:
        return _git("rev-parse", "--short", "HEAD") + (" with changes" if _git("status", "--porcelain", "-uno") else "")
    except (OSError, subprocess.CalledProcessError):
        return "none yet"


def _git(*arguments: str) -> str:
    answer = subprocess.run(["git", *arguments], cwd=Path(__file__).parent, check=True, capture_output=True, text=True)
    return answer.stdout.strip()
