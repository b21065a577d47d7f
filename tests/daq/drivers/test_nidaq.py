"""NI-DAQmx: a fake package in place of NI's, and the frames that its voltages are written as."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass, field
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from daq.acquisition.acquire import Acquisition
from daq.acquisition.blocks import Chunk
from daq.acquisition.records import StreamEvent
from daq.drivers.nidaq import LENGTH, MARK, START, STOP, NiDaq, frames
from daq.errors import DriverError, LinkLostError
from tests.daq.cal_files import nano17
from tests.daq.drivers.scripted import Scripted

VOLTS = np.array([[1.0, 0.0, 0.0, 0.0, 0.0, -2.0], [0.0, 10.0, 0.0, 0.0, 0.0, 0.0]])
WRENCH = [-13.2648, 7.30188, 7.69369, 43.59016, 33.16228, -56.50161]


class FakeError(Exception):
    """As nidaqmx.errors.Error."""


@dataclass
class FakeBoard:
    """What the fake package does, and what was asked of it; after a fault it refuses so many tasks."""

    portions: list[list[list[float]] | Exception] = field(default_factory=list)
    inputs: int = 6
    rate_hz: float = 1000.0
    refusals: int = 0
    refusals_then: int = 0
    refusal: str = "Device identifier is invalid.\n\nDevice Specified: Dev9"
    asked: list[Any] = field(default_factory=list)

    def task(self) -> Any:
        if self.refusals:
            self.refusals -= 1
            raise FakeError(self.refusal)
        board = self

        class Stream:
            @property
            def avail_samp_per_chan(self) -> int:
                if not board.portions:
                    return 0
                first = board.portions[0]
                if isinstance(first, Exception):
                    board.portions.pop(0)
                    board.refusals = board.refusals_then
                    raise first
                return len(first[0])

        def read(count: int) -> list[list[float]]:
            portion = board.portions.pop(0)
            assert not isinstance(portion, Exception)
            assert len(portion[0]) == count
            return portion

        channels = SimpleNamespace(
            add_ai_voltage_chan=lambda *a, **k: board.asked.append(("channels", a, k)),
            channel_names=["ai"] * self.inputs,
        )
        timing = SimpleNamespace(
            cfg_samp_clk_timing=lambda *a, **k: board.asked.append(("clock", a, k)), samp_clk_rate=self.rate_hz
        )
        return SimpleNamespace(
            ai_channels=channels,
            timing=timing,
            in_stream=Stream(),
            read=read,
            start=lambda: board.asked.append("started"),
            close=lambda: board.asked.append("closed"),
        )


@pytest.fixture
def board(monkeypatch: pytest.MonkeyPatch) -> FakeBoard:
    fake = FakeBoard()
    parts: dict[str, dict[str, Any]] = {
        "nidaqmx": {"Task": fake.task},
        "nidaqmx.constants": {
            "TerminalConfiguration": SimpleNamespace(DIFF="DIFF", RSE="RSE", NRSE="NRSE"),
            "AcquisitionType": SimpleNamespace(CONTINUOUS="CONTINUOUS"),
        },
        "nidaqmx.errors": {"Error": FakeError},
    }
    for name, content in parts.items():
        module = ModuleType(name)
        module.__dict__.update(content)
        monkeypatch.setitem(sys.modules, name, module)
    return fake


@pytest.fixture(scope="module")
def cal(tmp_path_factory: pytest.TempPathFactory) -> str:
    return str(nano17(tmp_path_factory.mktemp("cal")))


def cell(cal: str, **more: float | str) -> NiDaq:
    return NiDaq({"calibration": cal, "channels": "Dev1/ai0:5", **more})


def test_voltages_come_as_wrenches_with_a_count(cal: str, board: FakeBoard) -> None:
    board.portions = [VOLTS.T.tolist(), VOLTS[:1].T.tolist()]
    driver = cell(cal)
    link = driver.own_transport()
    link.write(START)
    raw = [link.read(0.1), link.read(0.1), link.read(0.0)]
    driver.stop(link)
    assert [len(r) for r in raw] == [2 * LENGTH, LENGTH, 0]
    decoder = driver.decoder()
    got = [decoder.feed(r) for r in raw]
    assert [len(s) for s in got] == [2, 1, 0]
    assert got[0].wrench[0] == pytest.approx(WRENCH)
    assert got[0].overload.tolist() == [False, True]
    assert got[0].status.tolist() == [0, 2]
    assert [s.sequence.tolist() for s in got if s.sequence is not None] == [[0, 1], [2], []]
    assert board.asked[-1] == "closed"


def test_the_task_is_asked_for_what_was_set(cal: str, board: FakeBoard) -> None:
    board.rate_hz = 7000.07
    board.portions = [VOLTS.T.tolist()]
    driver = cell(cal, sample_rate_hz=7000.0, wiring="nrse")
    link = driver.own_transport()
    driver.start(link)
    link.close()
    assert board.asked == [
        ("channels", ("Dev1/ai0:5",), {"terminal_config": "NRSE", "min_val": -10.0, "max_val": 10.0}),
        ("clock", (7000.0,), {"sample_mode": "CONTINUOUS", "samps_per_chan": 70000}),
        "started",
        "closed",
    ]
    assert driver.rate_hz == 7000.0


def test_the_conversation_is_two_words(cal: str) -> None:
    link = Scripted([(START, frames(VOLTS, 0)), (STOP, b"")])
    driver = cell(cal)
    driver.start(link)
    driver.stop(link)
    link.close()


def test_without_the_package_the_remedy_is_said(cal: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "nidaqmx", None)
    driver = cell(cal)
    with pytest.raises(DriverError, match=r'Run pip install "fingertwin\[ni\]"'):
        driver.start(driver.own_transport())


def test_importing_the_driver_imports_no_package_of_ni() -> None:
    code = "import sys, daq.drivers.nidaq; print([m for m in sys.modules if m.startswith('nidaqmx')])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)  # noqa: S603
    assert done.stdout.strip() == "[]"


def test_what_the_board_refuses_is_one_line(cal: str, board: FakeBoard) -> None:
    board.refusals = 1
    with pytest.raises(DriverError, match="Dev1/ai0:5") as fault:
        cell(cal).own_transport().write(START)
    assert "\n" not in str(fault.value)
    board.inputs = 1
    with pytest.raises(DriverError, match="is 1 inputs"):
        cell(cal).own_transport().write(START)
    board.inputs, board.rate_hz = 6, 800.0
    with pytest.raises(DriverError, match=r"samples at 800 Hz.*sample_rate_hz=800"):
        cell(cal).own_transport().write(START)
    assert board.asked.count("closed") == 2
    assert "started" not in board.asked


def test_a_board_that_overran_or_went_is_a_lost_link(cal: str, board: FakeBoard) -> None:
    board.portions = [VOLTS.T.tolist(), FakeError("Samples are no longer available.\nStatus Code: -200279")]
    driver = cell(cal)
    link = driver.own_transport()
    driver.start(link)
    with pytest.raises(LinkLostError, match="no longer available"):
        link.read(0.1)


GONE = FakeError("Device cannot be accessed. Possible causes:\n- Device is no longer present.\nStatus Code: -201003")
OVERRAN = FakeError("The application is not able to keep up.\nStatus Code: -50352")
OVERWRITTEN = FakeError("Attempted to read samples that are no longer available.\nStatus Code: -200279")


@pytest.mark.parametrize("fault", [GONE, OVERRAN, OVERWRITTEN])
def test_a_log_goes_on_after_a_lost_board_and_says_what_happened(
    cal: str, board: FakeBoard, monkeypatch: pytest.MonkeyPatch, fault: FakeError
) -> None:
    monkeypatch.setattr("daq.acquisition.acquire.BACK_OFF_S", (0.01,))
    portion = np.repeat(VOLTS[:1], 50, axis=0).T.tolist()
    # While it is away NI does not know it; then it is there again, with a task that counts from the start.
    board.portions, board.refusals_then = [portion, portion, fault, portion, portion], 2
    driver = cell(cal)
    chunks: list[Chunk] = []
    events: list[StreamEvent] = []
    run = Acquisition(driver, driver.own_transport)
    run.start()
    for record in run.records():
        events += record.events
        chunks += [] if record.chunk is None else [record.chunk]
        kinds = [e.kind for e in events]
        if "reconnected" in kinds and not board.portions:
            run.stop()
    assert [k for k in kinds if k != "stale"] == ["started", "disconnected", "reconnected", "ended"]
    why, back = (next(e.value for e in events if e.kind == k) for k in ("disconnected", "reconnected"))
    assert str(fault).split("Status Code: ")[1] in why["why"]
    assert "\n" not in why["why"]
    assert back["tries"] == 3
    # What was read before the fault is kept, and what came after it, with the portion that shows that a task began.
    assert sum(len(c) for c in chunks) == 200
    wrench = np.concatenate([c.wrench for c in chunks])
    assert wrench == pytest.approx(np.tile(WRENCH, (200, 1)))
    # Each task that was made was closed.
    assert board.asked.count("started") == 2
    assert board.asked.count("closed") == 2


def test_without_the_driver_of_ni_its_package_says_so_in_one_line(cal: str, board: FakeBoard) -> None:
    board.refusals, board.refusal = 1, "Could not find an installation of NI-DAQmx.\nPlease ensure that it is there."
    with pytest.raises(DriverError, match=r"Could not find an installation.*is the driver installed") as fault:
        cell(cal).own_transport().write(START)
    assert "\n" not in str(fault.value)


def test_the_driver_starts_stops_and_starts_again(cal: str, board: FakeBoard) -> None:
    driver = cell(cal)
    link = driver.own_transport()
    for _ in range(2):
        board.portions = [VOLTS.T.tolist(), VOLTS.T.tolist()]
        driver.start(link)
        got = driver.decoder().feed(link.read(0.1))
        # Counted from the start of each task.
        assert got.sequence is not None
        assert got.sequence.tolist() == [2, 3]
        driver.stop(link)
        assert link.read(0.0) == b""
    assert [a for a in board.asked if isinstance(a, str)] == ["started", "closed"] * 2


def test_a_board_without_a_clock_is_said(cal: str, board: FakeBoard, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("daq.drivers.nidaq.ANSWER_S", 0.01)
    driver = cell(cal)
    with pytest.raises(DriverError, match="gives no readings"):
        driver.start(driver.own_transport())


def test_a_port_is_of_no_use(cal: str) -> None:
    with pytest.raises(DriverError, match="has no port"):
        cell(cal).own_transport("COM3")


def test_golden_bytes() -> None:
    frame = frames(VOLTS[:1], 5)
    assert frame[:64].hex() == ("4654444100f8ff7f0000000000001440000000000000f03f" + "00" * 32 + "00000000000000c0")
    words = np.frombuffer(frame[:64], "<u4").astype(int).sum()
    assert np.frombuffer(frame[64:], "<f8")[0] == words
    assert frame.startswith(MARK)


def test_portions_change_nothing_and_damage_is_counted(cal: str) -> None:
    rng = np.random.default_rng(4)
    volts = rng.uniform(-9.0, 9.0, (40, 6))
    stream = bytearray(frames(volts, 100))
    whole = cell(cal).decoder().feed(bytes(stream))
    parted = cell(cal).decoder()
    parts = [parted.feed(bytes(stream[i : i + 50])) for i in range(0, len(stream), 50)]
    assert (np.concatenate([p.wrench for p in parts]) == whole.wrench).all()
    assert len(whole) == 40
    stream[10 * LENGTH + 30] ^= 0x10
    del stream[20 * LENGTH + 5]
    hurt = cell(cal).decoder().feed(bytes(stream))
    assert hurt.rejected == 2
    assert hurt.sequence is not None
    assert [k for k in range(100, 140) if k not in hurt.sequence] == [110, 120]


def test_no_voltage_is_made_up(cal: str) -> None:
    volts = np.zeros((6, 6))
    volts[2, 3], volts[3, 0], volts[4, 1] = np.nan, np.inf, 1e9
    got = cell(cal).decoder().feed(frames(volts, 0))
    assert got.sequence is not None
    assert got.sequence.tolist() == [0, 1]
    assert np.isfinite(got.wrench).all()
    assert got.rejected == 1
