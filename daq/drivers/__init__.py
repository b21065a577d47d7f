"""Drivers of load cells, by name. Each is one file; only the one that is asked for is imported."""

from __future__ import annotations

from importlib import import_module

from daq.drivers.base import LoadCell
from daq.errors import DriverError

# Name in commands: file, class.
REGISTRY: dict[str, tuple[str, str]] = {
    "ati-serial": ("ati_serial", "AtiSerial"),
    "ati-axia": ("ati_axia", "AtiAxia"),
    "ati-netft": ("ati_netft", "AtiNetft"),
    "gauge-volts": ("gauge_lines", "GaugeLines"),
    "ni-daqmx": ("nidaq", "NiDaq"),
    "robotiq-ft300": ("robotiq", "Robotiq"),
    "bota-sensone": ("bota", "Bota"),
    "optoforce": ("optoforce", "OptoForce"),
    "text-lines": ("text_lines", "TextLines"),
    "replay": ("recorded", "Replay"),
}


def driver(name: str) -> type[LoadCell]:
    """Return a driver's class.

    Raises:
        DriverError: there is none of that name.
    """
    if name not in REGISTRY:
        raise DriverError(f"no driver {name!r}", f"one of {' '.join(REGISTRY)}", "See fingertwin log --driver list")
    module, kind = REGISTRY[name]
    found: type[LoadCell] = getattr(import_module(f"daq.drivers.{module}"), kind)
    return found


def drivers() -> tuple[type[LoadCell], ...]:
    """Return all drivers, in the registry's order."""
    return tuple(driver(name) for name in REGISTRY)
