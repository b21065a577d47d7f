"""A bench that follows a script: what rests on the cell, what the user presses, and when; journalled as a real one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from daq.acquisition.blocks import Chunk
from daq.bench.commands import perform
from daq.bench.forces import Predict
from daq.bench.record import BenchSetup
from daq.bench.resume import broken_off
from daq.bench.run import BenchRun
from daq.journal.reader import JournalReader
from daq.journal.rows import Event
from daq.journal.writer import Journal
from daq.sessions.models import LoadCase
from daq.sessions.protocols import Protocol
from daq.standins.simulated import LoadStep, SimulatedCell, readings

Floats = NDArray[np.float64]

RATE_HZ = 100.0
BLOCK_S = 0.1
# Each chunk is a request to a service, which costs more than what is in it.
LONG_BLOCK_S = 0.5
REST = np.array([0.8, -0.4, 0.3, 5.0, -3.0, 2.0])
NOTHING = np.zeros(6)
# Force on the cell for each gram, tip and bone, of the finger that these tests embody.
PER_G = {
    ("tip", "FDP"): np.array([-0.9, -2.1, 0.1, 1.0, -0.7, 9.0]) / 950.0,
    ("tip", "FDS"): np.array([-0.4, -1.2, 0.2, 0.5, -0.2, 4.0]) / 950.0,
    ("bone", "FDP"): np.array([8.0, 0.3, 0.2, 3.0, 2.0, 9.0]) / 950.0,
    ("bone", "FDS"): np.array([8.0, 0.2, 0.1, 2.0, 3.0, 5.0]) / 950.0,
}
WEIGHT = np.array([0.0, -4.905, 0.0, 0.0, 0.0, 0.0])
PROTOCOL = {
    "format": "protocol/1",
    "id": "small",
    "postures_deg": {
        "hook": {"MCP": 0, "PIP": 65, "DIP": 50, "abduction": 0},
        "relaxed": {"MCP": 20, "PIP": 30, "DIP": 15, "abduction": 0},
    },
    "timing": {"tare_s": 4.0, "load_s": 5.0, "settle_s": 1.5, "guard_s": 0.3},
    "blocks": [
        {"role": "identification", "location": "tip", "postures": ["hook"], "masses_g": [{"FDP": 950}, {"FDS": 950}]},
        {"role": "validation", "location": "tip", "postures": ["relaxed"], "masses_g": [{"FDP": 500, "FDS": 500}]},
        {"role": "identification", "location": "bone", "postures": ["relaxed"], "masses_g": [{"FDP": 950}]},
    ],
}
QUIET = SimulatedCell(rate_hz=RATE_HZ, drift_per_sqrt_hour=(0.0,) * 6)

Line = str | tuple[str, Any]


def setup(**changes: Any) -> BenchSetup:
    given: dict[str, Any] = {
        "id": "S1",
        "specimen": {"id": "P1", "species": "human", "digit": "third", "side": "left"},
        "finger": "an1979_middle",
        "protocol": Protocol.model_validate(PROTOCOL),
        "load_cell": {
            "model": "ATI Nano17-E SI-25-0.25", "serial": "FT1", "calibration": "SI-25-0.25", "rate_hz": RATE_HZ,
            "mounts": {"tip": {}, "bone": {}},
        },
        "tension_factor": 0.835,
        "known_weight": {"mass_g": 500.0, "direction": [0.0, -1.0, 0.0]},
    }  # fmt: skip
    return BenchSetup(**(given | changes))


def truth(location: str, masses_g: dict[str, float]) -> Floats:
    return np.sum([PER_G[location, tendon] * mass for tendon, mass in masses_g.items()], axis=0)


def predicted(case: LoadCase) -> tuple[Floats, Floats]:
    return truth(case.location, case.masses_g)[:3], np.full(3, 0.5)


def load(wrench: Floats) -> Line:
    """From now on this rests on the cell, on top of the clamped finger."""
    return "load", wrench


def wait(seconds: float) -> Line:
    return "wait", seconds


def tared() -> list[Line]:
    return [load(NOTHING), wait(0.3), "tare", wait(5.0)]


def hung(wrench: Floats) -> list[Line]:
    """Hang, mark, wait until a plateau is there, and confirm it."""
    return [load(wrench), wait(0.3), "loaded", wait(5.0), "confirm"]


def case(location: str, **masses_g: float) -> list[Line]:
    return hung(truth(location, masses_g))


def whole() -> list[Line]:
    """The whole protocol, with a tare after each load."""
    weight = [*tared(), *hung(WEIGHT)]
    return [
        *weight, "next", *tared(), *case("tip", FDP=950), *tared(), "next", *case("tip", FDS=950), *tared(), "next",
        "posture_set", *tared(), *case("tip", FDP=500, FDS=500), *tared(), "next",
        "cell_moved", *tared(), *case("bone", FDP=950), *tared(), "next",
        *weight, "next", "close",
    ]  # fmt: skip


class Bench:
    """Plays a script, and keeps what the run said."""

    def __init__(
        self, run: BenchRun, journal: Journal | None = None, stream: str = "", now_s: float = 0.0, first: int = 0
    ) -> None:
        self.run, self.journal, self.stream = run, journal, stream
        self.said: list[Event] = []
        self._now_s, self._first, self._rests = now_s, first, REST
        self._keep(run.start())

    def play(
        self, script: Sequence[Line], cell: SimulatedCell = QUIET, seed: int = 1, block_s: float = BLOCK_S
    ) -> Self:
        """Play on; readings come in chunks of `block_s`, and waits last until the end of one where these are long."""
        steps, pressed, end_s = [LoadStep(0.0, self._rests)], [], 0.0
        for line in script:
            if isinstance(line, str):
                pressed.append((self._now_s + end_s, line))
            elif line[0] == "wait":
                whole_blocks = block_s * float(np.ceil(line[1] / block_s))
                end_s += line[1] if block_s == BLOCK_S else whole_blocks
            else:
                steps.append(LoadStep(end_s, REST + line[1]))
        for chunk in chunks(cell, steps, end_s, seed, self._now_s, self._first, block_s):
            while pressed and pressed[0][0] <= chunk.t_s[0]:
                self.press(pressed.pop(0)[1])
            if self.journal is not None:
                self.journal.append(self.stream, chunk)
            self._keep(self.run.take(chunk))
            self._first = chunk.next_seq
        self._now_s, self._rests = self._now_s + end_s, steps[-1].wrench
        for _, line in pressed:
            self.press(line)
        return self

    def press(self, line: str) -> None:
        command, _, argument = line.partition(" ")
        self._keep(perform(self.run, command, argument))

    def kinds(self) -> list[str]:
        return [e.kind for e in self.said]

    def values(self, kind: str) -> list[dict[str, Any]]:
        return [dict(e.value) for e in self.said if e.kind == kind]

    def warnings(self) -> str:
        return " | ".join(v["text"] for v in self.values("warning"))

    def _keep(self, events: Sequence[Event]) -> None:
        self.said += events
        if self.journal is not None and events:
            self.journal.event(*events)


def chunks(
    cell: SimulatedCell,
    steps: Sequence[LoadStep],
    end_s: float,
    seed: int,
    start_s: float = 0.0,
    first: int = 0,
    block_s: float = BLOCK_S,
) -> Iterator[Chunk]:
    for block in readings(cell, steps, end_s, seed, block_s=block_s):
        n = len(block)
        over = np.asarray((np.abs(block.wrench) >= np.array(cell.full_scale)).any(axis=1))
        yield Chunk(first, start_s + block.t_s, block.wrench, np.zeros(n, np.int64), over, b"", (), 0.0)
        first += n


def journalled(folder: Path, run_setup: BenchSetup | None = None) -> Bench:
    """A bench whose journal is in a folder."""
    journal = Journal.create(folder / "bench.ftj", "bench 1", reserve_bytes=0)
    stream = journal.add_stream("simulated", {}, {"serial": "FT1"}, "device")
    return Bench(BenchRun(run_setup or setup(), predicted, stream), journal, stream)


def gone_on(folder: Path, away_s: float, predict: Predict = predicted) -> Bench:
    """The bench of a folder's journal, which nobody writes any more, so much later by the wall clock."""
    path = folder / "bench.ftj"
    with JournalReader.open(path) as kept:
        before = broken_off(kept)
        assert before is not None
        run = BenchRun(before.record.setup, predict, before.stream.id)
        # These chunks were closed at 0 by the wall clock.
        from_s = before.from_s(lambda: away_s)
        run.resume(before.events, before.plateaus(kept), before.last_s, from_s)
    return Bench(run, Journal.open(path, reserve_bytes=0), before.stream.id, from_s, before.next_seq)
