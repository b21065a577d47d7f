"""A bench to be watched in a browser: a stand-in load cell on a pseudo-terminal, and `fingertwin log` that reads it.

The rig is a simulated finger with a secret: every hanger weighs something that nobody told the software. What hangs is
chosen while it runs, so that no test has to keep time with a recording. As a program it is the load cell's process:

    python -m tests.browser.bench_story CELL.json

with lines on standard input: hang NAME, off, pull, plug, mute, speak, end.
"""

from __future__ import annotations

import json
import os
import select
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from daq.recordings.readings import ReadingBlock
from daq.sessions.protocols import Protocol
from daq.standins import stand_in
from daq.standins.run import TICK_S, Player
from daq.standins.wires import PtyWire

DEVICE, RATE_HZ, BLOCK_S = "gauge-volts", 200.0, 0.04
NOISE = np.array([0.01, 0.01, 0.01, 0.1, 0.1, 0.1])
REST = np.array([0.6, -0.3, 0.2, 4.0, -2.0, 1.0])
HANGER_G = 45.0
HOOK: list[dict[str, float]] = [
    {"FDP": 900.0},
    {"FDP": 150.0},
    {"FDS": 900.0},
    {"FDS": 150.0},
    {"EDC": 400.0},
    {"EDC": 80.0},
]
BLIND = {"FDP": 500.0}
PROTOCOL: dict[str, Any] = {
    "format": "protocol/1",
    "id": "story",
    "postures_deg": {
        "hook": {"MCP": 0, "PIP": 65, "DIP": 50, "abduction": 0},
        "relaxed": {"MCP": 20, "PIP": 30, "DIP": 15, "abduction": 0},
    },
    "timing": {"tare_s": 2.0, "load_s": 2.2, "settle_s": 0.5, "guard_s": 0.1},
    "blocks": [
        {"role": "identification", "location": "tip", "postures": ["hook"], "masses_g": HOOK},
        {"role": "validation", "location": "tip", "postures": ["relaxed"], "masses_g": [BLIND]},
    ],
}
SETUP: dict[str, Any] = {
    "format": "bench-setup/1",
    "specimen": {"id": "P1", "species": "human", "digit": "third", "side": "left"},
    "finger": "an1979_middle",
    "load_cell": {
        "model": "ATI Nano17-E SI-25-0.25", "serial": "STAND-IN", "calibration": "stand-in.cal",
        "mounts": {"tip": {"frame": "distal_phalanx"}, "bone": {"frame": "metacarpal"}},
    },
    "tension_factor": 0.835,
}  # fmt: skip


# What a command is answered reaches the page only when it is let through.
HOLD_ANSWERS = """() => {
  const fetched = window.fetch;
  const held = new Promise((resolve) => { window.answer = () => { window.fetch = fetched; resolve(); }; });
  window.fetch = async (...asked) => {
    const answer = await fetched(...asked);
    if (String(asked[0]).endsWith("/bench/commands")) await held;
    return answer;
  };
}"""


def cases() -> dict[str, tuple[str, dict[str, float]]]:
    """Posture and weights of each case, as the protocol has them."""
    loads = [("hook", masses) for masses in HOOK] + [("relaxed", BLIND)]
    return {f"c{k + 1:03d}": load for k, load in enumerate(loads)}


def wrenches(folder: Path) -> dict[str, list[float]]:
    """What the simulated finger does to the cell in each case, its hangers counted."""
    from fingermodel.fingers.files import read_finger
    from fingermodel.rig import simulate_session

    heavier = [{k: [{m: g + HANGER_G for m, g in hung.items()} for hung in v] if k == "masses_g" else v
                for k, v in block.items()} for block in PROTOCOL["blocks"]]  # fmt: skip
    protocol = Protocol.model_validate(PROTOCOL | {"blocks": heavier})
    _, found = simulate_session(read_finger("an1979_middle"), protocol, folder)
    return {name: wrench.tolist() for name, wrench in found.items()}


def play(cell: Path) -> None:
    """Be the load cell, and do with the rig what the lines say."""
    told = json.loads(cell.read_text(encoding="utf-8"))
    rests, rng = np.zeros(6), np.random.default_rng(1)

    def blocks() -> Iterator[ReadingBlock]:
        n, first = round(BLOCK_S * RATE_HZ), 0
        while True:
            t_s = (first + np.arange(n)) / RATE_HZ
            yield ReadingBlock(t_s, REST + rests + NOISE * rng.normal(size=(n, 6)))
            first += n

    device, wire = stand_in(DEVICE)(), PtyWire(told["link"])
    player = Player(device, wire, blocks(), rate_hz=RATE_HZ)
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    out = mute = False
    while True:
        if select.select([sys.stdin], [], [], 0.0)[0]:
            word, _, name = sys.stdin.readline().strip().partition(" ")
            if word in ("", "end"):
                wire.close()
                return
            if word == "hang":
                rests = np.array(told["wrenches"][name])
            elif word == "off":
                rests = np.zeros(6)
            elif word == "pull":
                wire.pull()
                out = True
            elif word == "plug":
                wire.plug_in()
                out = False
            elif word in ("mute", "speak"):
                mute = word == "mute"
        if not (out or mute):
            player.turn()
        time.sleep(TICK_S)


@dataclass
class Story:
    """A bench that runs.

    Attributes:
        session: its id at the service.
        log: process of `fingertwin log`.
        said: what it printed.
    """

    session: str
    log: subprocess.Popen[str]
    said: list[str]
    _cell: subprocess.Popen[str]

    def rig(self, line: str) -> None:
        """Do something with the rig: hang NAME, off, pull, plug, mute, speak."""
        assert self._cell.stdin is not None
        self._cell.stdin.write(line + "\n")
        self._cell.stdin.flush()

    def press(self, line: str) -> None:
        """Give a command at the bench itself."""
        assert self.log.stdin is not None
        self.log.stdin.write(line + "\n")
        self.log.stdin.flush()

    def count(self, text: str) -> int:
        """How many lines that the bench has printed have a text."""
        return sum(text in line for line in list(self.said))

    def wait_for(self, text: str, count: int = 1, patience_s: float = 60.0) -> str:
        """Wait until the bench has printed a text so often; return the last line that has it."""
        end = time.monotonic() + patience_s
        while time.monotonic() < end:
            found = [line for line in list(self.said) if text in line]
            if len(found) >= count:
                return found[count - 1]
            assert self.log.poll() is None, "".join(self.said[-20:])
            time.sleep(0.05)
        raise AssertionError(f"the bench never printed {text!r}: {''.join(self.said[-20:])}")


@contextmanager
def bench(
    folder: Path, url: str, session: str = "story", wrench: dict[str, list[float]] | None = None
) -> Iterator[Story]:
    """A bench that logs to a service; it and its load cell end with the block."""
    folder.mkdir(parents=True, exist_ok=True)
    cell, link = folder / "cell.json", folder / "cell"
    told = {"link": str(link), "wrenches": wrench or wrenches(folder / "rig")}
    cell.write_text(json.dumps(told), encoding="utf-8")
    (folder / "protocol.yaml").write_text(yaml.safe_dump(PROTOCOL), encoding="utf-8")
    (folder / "setup.yaml").write_text(yaml.safe_dump(SETUP | {"id": session}), encoding="utf-8")
    environment = os.environ | {"PYTHONUNBUFFERED": "1"}
    pipes: dict[str, Any] = {
        "stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True,
        "env": environment,
    }  # fmt: skip
    player = subprocess.Popen([sys.executable, "-m", "tests.browser.bench_story", str(cell)], **pipes)  # noqa: S603
    log = None
    try:
        assert player.stdout is not None
        assert player.stdout.readline() == "ready\n"
        words = ["log", "--driver", DEVICE, "--port", str(link), "--out", str(folder / "out")]
        settings = [word for k, v in stand_in(DEVICE)().driver_settings.items() for word in ("--set", f"{k}={v}")]
        follows = ["--protocol", str(folder / "protocol.yaml"), "--setup", str(folder / "setup.yaml")]
        command = [sys.executable, "-m", "server.cli", *words, *settings, *follows, "--to", url, "--session", session]
        log = subprocess.Popen(command, **pipes)  # noqa: S603
        said: list[str] = []
        reader = threading.Thread(target=_read, args=(log, said), daemon=True)
        reader.start()
        yield Story(session, log, said, player)
    finally:
        for process in filter(None, (log, player)):
            process.kill()
            process.wait(30)
            for pipe in filter(None, (process.stdin, process.stdout)):
                pipe.close()


def _read(process: subprocess.Popen[str], said: list[str]) -> None:
    assert process.stdout is not None
    try:
        for line in process.stdout:
            said += [line]
    except ValueError:
        pass  # closed with the block


if __name__ == "__main__":
    play(Path(sys.argv[1]))
