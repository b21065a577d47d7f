"""Interface of load-cell drivers: a pure decoder of bytes, and the conversation that starts and stops them.

A driver is one file. Its decoder turns bytes into `Samples` and nothing else, so that a log's raw bytes give the same
readings again; its `start` and `stop` talk over a `Transport`, which tests script.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from daq.errors import DriverError
from daq.vocabulary import LARGEST

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Flags = NDArray[np.bool_]
# A device may start up when its port is opened, or have been switched on just now.
BOOT_S = 12.0
Link = Literal["serial", "udp", "file", "none"]


class Transport(Protocol):
    """Bytes to and from a device."""

    def write(self, data: bytes) -> None:
        """Send bytes.

        Raises:
            LinkLostError: the device has gone.
        """

    def read(self, timeout_s: float) -> bytes:
        """Return what has come, as soon as anything has; nothing after the time is out. One datagram at a time.

        Raises:
            LinkLostError: the device has gone.
        """

    def close(self) -> None:
        """Let go of the port."""


@runtime_checkable
class Recorded(Protocol):
    """A transport whose bytes arrived long ago.

    Attributes:
        arrival_s: when the last read was, in its own stream's time [s].
    """

    arrival_s: float


@dataclass(frozen=True, eq=False)
class Samples:
    """Samples decoded from some bytes.

    Attributes:
        wrench: (n, 6) Fx Fy Fz [N], Tx Ty Tz [N mm], in the cell's axes.
        status: (n,) the device's status, 0 where all is well.
        overload: (n,) whether the device says that it is beyond its range.
        sequence: (n,) the device's own count of records, carried on where it wraps; None where it has none.
        device_s: (n,) time by the device's own clock [s], carried on where it wraps; None where it has none.
        rejected: records that were refused: checksum, length, numbers.
        skipped: bytes that belonged to no record.
    """

    wrench: Floats
    status: Integers
    overload: Flags
    sequence: Integers | None = None
    device_s: Floats | None = None
    rejected: int = 0
    skipped: int = 0

    def __len__(self) -> int:
        return len(self.wrench)


class Decoder(Protocol):
    """Bytes to samples, in whatever portions they come; the same bytes always give the same samples."""

    def feed(self, data: bytes) -> Samples:
        """Take what was read (of a datagram link: one datagram) and return the records that it completes."""


@dataclass(frozen=True)
class Setting:
    """Setting of a driver.

    Attributes:
        name: with its unit, such as `counts_per_N`.
        text: what it is, and where to find it.
        default: None where it must be given.
        kind: number, count (a whole number), text, or the choices.
        above: numbers must lie above it.
    """

    name: str
    text: str
    default: float | int | str | None = None
    kind: Literal["number", "count", "text"] | Sequence[str] = "number"
    above: float | None = None

    def parse(self, driver: str, value: str | float | int) -> float | int | str:
        """Return a value of the right kind.

        Raises:
            DriverError: it is of another.
        """
        if not isinstance(self.kind, str):
            if str(value) in self.kind:
                return str(value)
            raise DriverError(f"{driver}: {self.name} is {value!r}", f"one of {' '.join(self.kind)}")
        if self.kind == "text":
            return str(value)
        wanted = "a whole number" if self.kind == "count" else "a number"
        wanted += f" above {self.above:g}" if self.above is not None else ""
        try:
            number = float(value)
        except ValueError:
            raise DriverError(f"{driver}: {self.name} is {value!r}", wanted) from None
        if not np.isfinite(number) or (self.above is not None and number <= self.above):
            raise DriverError(f"{driver}: {self.name} is {value}", wanted)
        if self.kind == "count":
            if number != int(number):
                raise DriverError(f"{driver}: {self.name} is {value}", wanted)
            return int(number)
        return number


class LoadCell(ABC):
    """A six-axis load cell of one family.

    Attributes:
        name: in commands.
        title: maker and model.
        link: what it hangs on.
        settings: what it must be told.
        learns: names of those that it finds out from the device where nobody states them.
        example: a command line that logs it.
        source: where its protocol is described, and how sure that is.
        checksum: whether its records carry one.
        clock: what tells the time of a sample: the device's counter or clock, its arrival here, or a recording itself.
        held_back: records that are decoded only once so many after them, or their beginning, have come.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    link: ClassVar[Link]
    settings: ClassVar[tuple[Setting, ...]] = ()
    learns: ClassVar[tuple[str, ...]] = ()
    example: ClassVar[str]
    source: ClassVar[str]
    checksum: bool = False
    clock: Literal["device", "counter", "arrival", "recording"] = "arrival"
    held_back: int = 0

    def __init__(self, given: Mapping[str, Any] | None = None) -> None:
        self.values = settled(self.name, self.settings, given or {})

    @property
    @abstractmethod
    def rate_hz(self) -> float | None:
        """Nominal rate of the records [Hz], None where the device does not say."""

    @abstractmethod
    def decoder(self) -> Decoder:
        """Return a decoder that has seen nothing yet."""

    @abstractmethod
    def start(self, transport: Transport) -> None:
        """Make the device stream.

        Raises:
            DriverError: it does not answer, or not as this device does.
            LinkLostError: it has gone.
        """

    def stop(self, transport: Transport) -> None:  # noqa: B027 - a device that only ever streams needs no stopping
        """Make the device stop, as far as it can be."""

    def own_transport(self, port: str) -> Transport:
        """Open what the device hangs on, where that is neither a serial port nor UDP (`link` file or none).

        Raises:
            DriverError: it cannot be opened, or the link is another.
        """
        raise DriverError(f"{self.name} hangs on {self.link}", "a transport of that kind")

    def go_on(self, settings: Mapping[str, float | int | str]) -> None:
        """Take what an earlier log of the device found out, where nobody states it: it may not be told again."""
        for setting in self.settings:
            if setting.name in self.learns and self.values[setting.name] == setting.default:
                self.values[setting.name] = settings.get(setting.name, setting.default)

    def number(self, name: str) -> float:
        """Return a setting that is a number."""
        return float(self.values[name])

    def text(self, name: str) -> str:
        """Return a setting that is a text or a choice."""
        return str(self.values[name])


def settled(driver: str, settings: Sequence[Setting], given: Mapping[str, Any]) -> dict[str, float | int | str]:
    """Check the settings that were given, and add the others' defaults.

    Raises:
        DriverError: one is unknown, missing or of another kind.
    """
    known = {s.name: s for s in settings}
    for name in given:
        if name not in known:
            raise DriverError(f"{driver} has no setting {name}", f"one of {' '.join(known) or '(it has none)'}")
    out: dict[str, float | int | str] = {}
    for setting in settings:
        value = given.get(setting.name, setting.default)
        if value is None:
            raise DriverError(
                f"{driver} lacks {setting.name}", setting.text, f"Give it with --set {setting.name}=VALUE"
            )
        out[setting.name] = setting.parse(driver, value)
    return out


def heard_without_samples(transport: Transport, decoder: Decoder, wait_s: float, most_bytes: int) -> bytes | None:
    """Read until bytes make a sample; return None then, or what came instead of one: nothing more, or too much.

    Args:
        transport: that is read.
        decoder: fresh.
        wait_s: for the next bytes, `BOOT_S` where nothing needs to be asked again.
        most_bytes: after which a sample should have come.
    """
    heard = b""
    while True:
        data = transport.read(wait_s)
        heard += data
        if len(decoder.feed(data)):
            return None
        if not data or len(heard) > most_bytes:
            return heard


def steps_from(before: float, values: NDArray[Any]) -> NDArray[Any]:
    """Return differences (n,) of values (n,), the first from one before them; NumPy's take longer than a datagram."""
    out = values.copy()
    out[1:] -= values[:-1]
    out[:1] -= before
    return out


class Unwrap:
    """Carries a counter on where it wraps."""

    def __init__(self, modulus: int) -> None:
        self._modulus = modulus
        self._last: int | None = None

    def __call__(self, raw: NDArray[Any]) -> Integers:
        """Take raw counts (n,) and return them carried on; a step back by less than half the range is one back."""
        counts = raw.astype(np.int64)
        if len(counts) == 0:
            return counts
        first = int(counts[0]) if self._last is None else self._last
        steps = steps_from(first % self._modulus, counts)
        half = self._modulus // 2
        steps = (steps + half) % self._modulus - half
        out: Integers = first + np.cumsum(steps)
        self._last = int(out[-1])
        return out


def told(wrench: Floats) -> Flags:
    """Return of which readings (n, 6) [N, N mm] every number is one that a load cell can tell: (n,)."""
    return np.asarray((np.abs(wrench) <= LARGEST).all(axis=1))


def samples(
    wrench: Floats,
    status: Integers | None = None,
    overload: Flags | None = None,
    sequence: Integers | None = None,
    device_s: Floats | None = None,
    rejected: int = 0,
    skipped: int = 0,
) -> Samples:
    """Make samples (n, 6); without a status all is well."""
    n = len(wrench)
    return Samples(
        np.asarray(wrench, dtype=np.float64).reshape(n, 6),
        np.zeros(n, dtype=np.int64) if status is None else status,
        np.zeros(n, dtype=bool) if overload is None else overload,
        sequence,
        device_s,
        rejected,
        skipped,
    )


NOTHING = np.zeros((0, 6))
