"""Stand-ins for load cells, by the name of the driver that is to understand them."""

from __future__ import annotations

from importlib import import_module

from daq.errors import DriverError
from daq.standins.base import StandIn

REGISTRY: dict[str, tuple[str, str]] = {
    "robotiq-ft300": ("robotiq", "RobotiqStandIn"),
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
