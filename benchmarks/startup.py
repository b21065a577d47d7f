"""How long a user waits for a command: cold processes, with and without compiled models in the cache."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from benchmarks.machine import Timing, repeat, table, wait_until_quiet

HELP = ["--help"]
COMPARE = ["compare", "synek2019_H01"]


def main() -> None:
    """Time them and print the table."""
    with tempfile.TemporaryDirectory() as folder:
        # Where platformdirs looks on Linux; elsewhere the user's own cache is used, and the cold figure means nothing.
        environment = {k: v for k, v in os.environ.items() if k != "JAX_COMPILATION_CACHE_DIR"}
        environment["XDG_CACHE_HOME"] = folder
        wait_until_quiet()
        python = _time([sys.executable, "-c", "pass"], environment, 5)
        numpy = _time([sys.executable, "-c", "import numpy"], environment, 5)
        jax = _time([sys.executable, "-c", "import jax"], environment, 3)
        help_text = _time(_command(HELP), environment, 7)
        cold = _time(_command(COMPARE), environment, 1)
        warm = _time(_command(COMPARE), environment, 5)
        cached = sum(f.stat().st_size for f in Path(folder).rglob("*") if f.is_file())
    table(
        "Start-up: whole processes, seconds of the wall clock",
        ["", "best [s]", "median [s]", "target [s]", "of the core"],
        [
            _row("fingertwin --help", help_text, "0.5"),
            _row("fingertwin compare synek2019_H01", warm, "2"),
            _row("the same with an empty cache", cold, ""),
            _row("for scale: python -c pass", python, ""),
            _row("for scale: import numpy", numpy, ""),
            _row("for scale: import jax", jax, ""),
        ],
        f"The files themselves are in the system's cache. Compiled models take {cached / 1e6:.1f} MB on disk.",
    )


def _command(arguments: list[str]) -> list[str]:
    script = Path(sys.executable).with_name("fingertwin")
    program = [str(script)] if script.exists() else [sys.executable, "-m", "server.cli"]
    return [*program, *arguments]


def _time(command: list[str], environment: dict[str, str], times: int) -> Timing:
    # What cannot be done twice is done once, however busy the machine is.
    patience_s = 10.0 if times > 1 else 0.0
    return repeat(
        lambda: subprocess.run(command, env=environment, check=True, stdout=subprocess.DEVNULL), times, patience_s
    )


def _row(name: str, timing: Timing, target: str) -> list[str]:
    return [name, f"{timing.least:.2f}", f"{timing.median:.2f}", target, f"{timing.own_share:.0%}"]


if __name__ == "__main__":
    main()
