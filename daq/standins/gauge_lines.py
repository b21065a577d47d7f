"""A stand-in for what writes six gauge voltages as text lines: wrenches go back through a calibration's inverse."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from daq.drivers.gauge_lines import CALIBRATION, GaugeLines
from daq.locations import data_dir
from daq.standins.base import Floats, Integers, StandIn

# Of a cell that there is not.
MADE_UP = "calibrations/stand-in.cal"
# A number that is no gauge's.
FILLER = "0"


class GaugeLinesStandIn(StandIn):
    """Streams from when it is switched on, and hears nothing; its converter ends where the gauges' range does.

    By default its calibration is a made-up one that comes with fingertwin. It has the driver's settings, and writes
    what the driver reads with the same ones.
    """

    name = "gauge-volts"
    unasked = True
    settings: ClassVar[dict[str, float | int | str]] = {CALIBRATION.name: str(data_dir() / MADE_UP)}

    def __init__(self) -> None:
        super().__init__()
        self.set_up({})

    def set_up(self, given: Mapping[str, Any]) -> None:
        """Take the driver's settings.

        Raises:
            DriverError: one is unknown, or the calibration cannot be used.
        """
        told = {**self.driver_settings, **given}
        self._driver = GaugeLines(told)
        self._inverse = np.linalg.inv(self._driver.gauges.calibration.matrix)
        self.driver_settings = told

    def hear(self, data: bytes) -> bytes:
        """Say nothing."""
        return b""

    def encode(self, wrench: Floats, sequence: Integers, time_s: Floats, status: Integers | None = None) -> list[bytes]:
        """Return lines of voltages to a millionth of a volt; the device has no count, clock or status."""
        driver, gauges = self._driver, self._driver.gauges
        most_V = gauges.calibration.range_V or gauges.limit_V
        volts = np.clip(wrench @ self._inverse.T + gauges.zero_V, -most_V, most_V)
        decimal, between = (".", ",") if driver.text("decimal") == "point" else (",", ";")
        before = int(driver.number("first_gauge")) - 1
        after = int(driver.number("columns")) - before - 6
        per_unit = driver.number("volts_per_unit")
        lines = []
        for row in (volts / per_unit).tolist():
            numbers = [f"{value:.{_decimals(per_unit)}f}".replace(".", decimal) for value in row]
            lines.append((between.join([FILLER] * before + numbers + [FILLER] * after) + "\r\n").encode("ascii"))
        return lines


def _decimals(volts_per_unit: float) -> int:
    """Return the decimals of a number that tells a millionth of a volt."""
    return max(int(np.ceil(6.0 + np.log10(volts_per_unit) - 1e-9)), 0)
