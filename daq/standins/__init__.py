"""Stand-ins for load cells, by the name of the driver that is to understand them."""

from __future__ import annotations

from importlib import import_module

from daq.errors import DriverError
from daq.standins.base import StandIn

REGISTRY: dict[str, tuple[str, str]] = {
    "ati-serial": ("ati_serial", "AtiSerialStandIn"),
    "ati-axia": ("ati_axia", "AtiAxiaStandIn"),
    "ati-netft": ("ati_netft", "AtiNetftStandIn"),
    "robotiq-ft300": ("robotiq", "RobotiqStandIn"),
    "bota-sensone": ("bota", "BotaStandIn"),
    "optoforce": ("optoforce", "OptoForceStandIn"),
    "gauge-volts": ("gauge_lines", "GaugeLinesStandIn"),
    "text-lines": ("text_lines", "TextLinesStandIn"),
}


def stand_in(name: str) -> type[StandIn]:
    """Return a stand-in's class.

    Raises:
        DriverError: there is none of that name.
    """
    if name not in REGISTRY:
        raise DriverError(f"no stand-in for {name!r}", f"one of {' '.join(REGISTRY)}")
    module, kind = REGISTRY[name]
    found: type[StandIn] = getattr(import_module(f"daq.standins.{module}"), kind)
    return found
