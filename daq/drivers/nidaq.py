"""Six gauge voltages on analogue inputs of NI-DAQmx, turned into a wrench by the cell's calibration file.

NI's package is optional and imported only when a task begins. The inputs are read in this process, so their voltages
are written as frames of little-endian float64 here: then the raw bytes of a log decode again without any hardware.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Mapping
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.drivers.base import LoadCell, Samples, Setting, Transport
from daq.drivers.frames import FrameStream
from daq.drivers.gauge_lines import CALIBRATION, LIMIT, MOST_V, ZERO, Gauges
from daq.errors import DriverError, LinkLostError

Floats = NDArray[np.float64]

# Nine float64: a mark, the count of readings since the task began, six voltages [V], the sum of the 32-bit words of
# these eight.
LENGTH = 72
# A NaN that no arithmetic makes.
MARK = bytes.fromhex("4654444100f8ff7f")
START, STOP = b"start\n", b"stop\n"
# The converter's own memory, and how often it is asked while nothing has come.
BUFFER_S, POLL_S = 10.0, 0.002
MOST_AT_ONCE = 4096
ANSWER_S = 2.0
# The converter divides its clock; a rate that it cannot make would make every time wrong.
SAME_RATE = 1e-3

_WIRINGS = {"differential": ("DIFF", "DIFFERENTIAL"), "rse": ("RSE",), "nrse": ("NRSE",)}


def frames(volts: Floats, first: int) -> bytes:
    """Write readings (n, 6) [V] as frames, counted on from the first."""
    body = np.empty((len(volts), 9), dtype="<f8")
    # As octets, since a NaN that is handled as a number may change its bits.
    body.view(np.uint8)[:, :8] = np.frombuffer(MARK, np.uint8)
    body[:, 1] = first + np.arange(len(volts))
    body[:, 2:8] = volts
    body[:, 8] = _sums(body[:, :8])
    return body.tobytes()


def _sums(words: NDArray[Any]) -> Floats:
    return np.ascontiguousarray(words).view("<u4").astype(np.int64).sum(axis=1).astype(np.float64)


def _valid(octets: NDArray[np.uint8]) -> NDArray[np.bool_]:
    numbers = np.ascontiguousarray(octets).view("<f8").reshape(-1, 9)
    count, volts = numbers[:, 1], numbers[:, 2:8]
    whole = (count >= 0.0) & (count < 2.0**53) & (count == np.floor(count))
    return np.asarray(whole & (np.abs(volts) <= MOST_V).all(axis=1) & (numbers[:, 8] == _sums(numbers[:, :8])))


class NiDaqDecoder:
    """Frames of voltages to wrenches."""

    def __init__(self, gauges: Gauges) -> None:
        self._gauges = gauges
        self._stream = FrameStream(LENGTH, MARK, _valid)

    def feed(self, data: bytes) -> Samples:
        """Take bytes and return the readings that they complete."""
        found = self._stream.feed(data)
        numbers = np.ascontiguousarray(found.frames).view("<f8").reshape(-1, 9).astype(np.float64)
        return self._gauges.samples(numbers[:, 2:8], numbers[:, 1].astype(np.int64), found.rejected, found.skipped)


class NiDaqTransport:
    """A task of NI-DAQmx that begins when it hears START.

    Args:
        channels: as NI names them, such as `Dev1/ai0:5`.
        rate_hz: of the readings.
        range_V: the inputs span ± this.
        wiring: one of differential, rse, nrse.
    """

    def __init__(self, channels: str, rate_hz: float, range_V: float, wiring: str) -> None:
        self._channels, self._rate_hz, self._range_V, self._wiring = channels, rate_hz, range_V, wiring
        self._task: Any = None
        self._lost: type[Exception] = OSError
        self._count = 0

    def write(self, data: bytes) -> None:
        """Begin the task on START, end it on STOP."""
        if data == STOP:
            self.close()
        elif data == START and self._task is None:
            self._begin()

    def read(self, timeout_s: float) -> bytes:
        """Return the frames of what was read, as soon as anything was."""
        until_s = time.monotonic() + timeout_s
        while self._task is not None:
            try:
                ready = min(int(self._task.in_stream.avail_samp_per_chan), MOST_AT_ONCE)
                if ready:
                    volts = np.asarray(self._task.read(ready), dtype=np.float64).reshape(6, ready).T
                    self._count += ready
                    return frames(volts, self._count - ready)
            except self._lost as error:
                # Its memory overran, or the device is unplugged: what is missing is a gap, never passed over.
                raise LinkLostError(f"NI-DAQmx stopped ({_line(error)})") from error
            if time.monotonic() >= until_s:
                break
            time.sleep(min(POLL_S, max(until_s - time.monotonic(), 0.0)))
        return b""

    def close(self) -> None:
        """End the task; one that has gone is ended already."""
        task, self._task = self._task, None
        if task is not None:
            with contextlib.suppress(self._lost):
                task.close()

    def _begin(self) -> None:
        try:
            ni, constants = import_module("nidaqmx"), import_module("nidaqmx.constants")
        except ImportError as error:
            raise DriverError(
                "the package nidaqmx is not here", "NI's own for Python", 'Run pip install "fingertwin[ni]"'
            ) from error
        self._lost = getattr(import_module("nidaqmx.errors"), "Error", OSError)
        kinds = constants.TerminalConfiguration
        # It was renamed once.
        wiring = next(getattr(kinds, n) for n in _WIRINGS[self._wiring] if hasattr(kinds, n))
        try:
            self._task = ni.Task()
            self._task.ai_channels.add_ai_voltage_chan(
                self._channels, terminal_config=wiring, min_val=-self._range_V, max_val=self._range_V
            )
            self._task.timing.cfg_samp_clk_timing(
                self._rate_hz,
                sample_mode=constants.AcquisitionType.CONTINUOUS,
                samps_per_chan=max(1000, int(BUFFER_S * self._rate_hz)),
            )
            inputs = len(self._task.ai_channels.channel_names)
            rate_hz = float(self._task.timing.samp_clk_rate)
            fault = self._fault(inputs, rate_hz)
            if fault is None:
                self._task.start()
        except self._lost as error:
            self.close()
            raise DriverError(
                f"NI-DAQmx refuses {self._channels} ({_line(error)})",
                "six analogue inputs",
                "Look in NI MAX: is the driver installed and the device there, under this name?",
            ) from error
        if fault is not None:
            self.close()
            raise fault
        self._count = 0

    def _fault(self, inputs: int, rate_hz: float) -> DriverError | None:
        if inputs != 6:
            return DriverError(f"{self._channels} is {inputs} inputs", "six, such as Dev1/ai0:5")
        if abs(rate_hz - self._rate_hz) > SAME_RATE * self._rate_hz:
            return DriverError(
                f"the device samples at {rate_hz:.6g} Hz instead of {self._rate_hz:.6g} Hz",
                "a rate that it can make",
                f"Use --set sample_rate_hz={rate_hz:.6g}",
            )
        return None


class NiDaq(LoadCell):
    """Any ATI DAQ cell on six inputs of an NI board; the board's clock spaces the readings."""

    name = "ni-daqmx"
    title = "six gauge voltages on NI-DAQmx inputs, for cells with an ATI calibration file"
    link = "none"
    settings = (
        CALIBRATION,
        Setting("channels", "six analogue inputs in the order of the gauges, such as Dev1/ai0:5", kind="text"),
        Setting("sample_rate_hz", "readings a second", 1000.0, "number", 0.0),
        Setting("wiring", "how the inputs are wired", "differential", tuple(_WIRINGS)),
        LIMIT,
        ZERO,
    )
    example = "fingertwin log --driver ni-daqmx --set calibration=FT.cal --set channels=Dev1/ai0:5 --out DIR"
    source = "NI's package as documented, not tried on a board; calibration as in the maker's file"
    checksum = True
    clock = "counter"

    def __init__(self, given: Mapping[str, Any] | None = None) -> None:
        super().__init__(given)
        self.gauges = Gauges(self)

    @property
    def rate_hz(self) -> float:
        """Sampling rate that was asked for [Hz]."""
        return self.number("sample_rate_hz")

    def decoder(self) -> NiDaqDecoder:
        """Return a fresh decoder."""
        return NiDaqDecoder(self.gauges)

    def own_transport(self, port: str = "") -> NiDaqTransport:
        """Return a task that has not begun; NI names the device among the channels."""
        if port:
            raise DriverError(
                f"{self.name} has no port ({port})", "the device in its channels", "Use --set channels=Dev1/ai0:5"
            )
        range_V = self.gauges.calibration.range_V or self.gauges.limit_V
        return NiDaqTransport(self.text("channels"), self.rate_hz, range_V, self.text("wiring"))

    def start(self, transport: Transport) -> None:
        """Begin the task and see its first readings."""
        transport.write(START)
        if not transport.read(ANSWER_S):
            raise DriverError("the NI task gives no readings", "some within two seconds", "Does its sample clock run?")

    def stop(self, transport: Transport) -> None:
        """End the task."""
        transport.write(STOP)


def _line(error: Exception) -> str:
    return " ".join(str(error).split())[:160].rstrip(".")
