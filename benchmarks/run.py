"""Time everything and write the figures to RESULTS.md: `python -m benchmarks.run`."""

from __future__ import annotations

import datetime as dt
import platform
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

from benchmarks.machine import commit, describe_machine

BENCHMARKS = ("predictions", "refits", "diagnosis", "startup", "corrections")
BENCH = (
    "acquisition",
    "uplink",
    "uplink_service",
    "uplink_4",
    "uplink_latency",
    "uplink_kills",
    "journal",
    "journal_damage",
    "replay",
    "plateaus",
    "driver_fuzz",
)
SYSTEMS = ("tapping", "hood_network")
PACKAGES = ("fingertwin", "numpy", "scipy", "jax", "jaxlib", "mujoco", "pyarrow")
HERE = Path(__file__).parent


def main() -> None:
    """Run every benchmark in a process of its own, so that none warms up or fills the memory of another."""
    parts = []
    for name in BENCHMARKS:
        answer = subprocess.run([sys.executable, "-m", f"benchmarks.{name}"], check=True, stdout=subprocess.PIPE)
        text = answer.stdout.decode("utf-8").strip()
        print(text, end="\n\n", flush=True)
        parts.append(text)
    (HERE / "RESULTS.md").write_text("\n\n".join([_heading(), *parts]) + "\n", encoding="utf-8")


def _heading() -> str:
    versions = ", ".join(f"{name} {version(name)}" for name in PACKAGES)
    lines = [
        "# Figures of the last run",
        "",
        'Written by `python -m benchmarks.run`. "Of the core": how much of it the benchmark had in its best run.',
        "",
        f"- Date: {dt.datetime.now(tz=dt.UTC):%Y-%m-%d %H:%M} UTC",
        f"- Commit: {commit()}",
        f"- Machine: {describe_machine()}",
        f"- Versions: Python {platform.python_version()}, {versions}",
        f"- The bench's figures, each with its command: {_linked(BENCH)}",
        f"- Those of movement and of the elastic hood: {_linked(SYSTEMS)}",
    ]
    return "\n".join(lines)


def _linked(names: tuple[str, ...]) -> str:
    return ", ".join(f"[{name}]({name}.md)" for name in names)


if __name__ == "__main__":
    main()
