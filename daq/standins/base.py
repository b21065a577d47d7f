"""Stand-ins: what answers and streams as a real device does, so that everything can be tried without one.

A stand-in knows a device's conversation and how it writes a reading; what it reads, and over which wire, and which
faults it has, is not its business.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from daq.errors import DriverError

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


class StandIn(ABC):
    """A device of one family, without its wire.

    Attributes:
        name: the driver's.
        datagrams: whether it writes datagrams instead of a stream of bytes.
        unasked: whether it streams from when it is switched on.
        settings: given to the driver that is to understand it, as long as it is set up no further.
        driver_settings: given to the driver that is to understand it as it is set up now.
        streaming: whether it does now.
        per_datagram: records in each datagram, where it writes datagrams.
    """

    name: ClassVar[str]
    datagrams: ClassVar[bool] = False
    unasked: ClassVar[bool] = False
    settings: ClassVar[dict[str, float | int | str]] = {}

    def __init__(self) -> None:
        self.streaming = self.unasked
        self.per_datagram = 1
        self.driver_settings: dict[str, float | int | str] = dict(self.settings)

    def set_up(self, given: Mapping[str, Any]) -> None:
        """Set what can be set of the device; of most, nothing can.

        Raises:
            DriverError: there is no such setting.
        """
        if given:
            raise DriverError(f"the stand-in for {self.name} has no setting {next(iter(given))}", "none")

    @abstractmethod
    def hear(self, data: bytes) -> bytes:
        """Take what the host sends, in whatever portions, and return the answer; starts or stops the stream."""

    @abstractmethod
    def encode(self, wrench: Floats, sequence: Integers, time_s: Floats, status: Integers | None = None) -> list[bytes]:
        """Write readings as the device does: each as the bytes (or the datagram) of one record.

        Args:
            wrench: (n, 6) [N, N mm] in the cell's axes; rounded and cut to what the device can say.
            sequence: (n,) count of readings since it was switched on; wraps as the device's does.
            time_s: (n,) since it was switched on.
            status: (n,) of the device, 0 where all is well.
        """
