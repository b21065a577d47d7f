"""`fingertwin simulate-cell`: a process that behaves as a load cell of a maker does, on a port of this machine."""

from __future__ import annotations

import math
import os
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from daq.drivers import driver
from daq.errors import InputError
from daq.locations import data_dir
from daq.recordings.readings import ReadingBlock, open_readings
from daq.sessions import read_session
from daq.sessions.protocols import read_protocol
from daq.standins import REGISTRY, stand_in
from daq.standins.faults import Faults
from daq.standins.noise import Disturbance
from daq.standins.run import Player
from daq.standins.simulated import SimulatedCell
from daq.standins.wires import PtyWire, TcpWire, UdpWire, Wire
from fingermodel.fingers.files import read_finger
from server.commands.console import answer, refuse_useless, say, table
from server.commands.log import given_settings

LAST_PORT = 65535


@dataclass(frozen=True)
class Options:
    """Options of `fingertwin simulate-cell`."""

    device: str  # a stand-in's name
    wire: str | None  # pty, tcp or udp; by default what fits the device and this system
    port: int  # of TCP or UDP; 0 is any free one
    link: str | None  # a name for the pseudo-terminal that stays
    play: str  # a session, a readings file, or a protocol that a simulated rig follows
    rate_hz: float  # of a simulated rig
    seconds: float | None  # after which it ends; None plays to the end
    seed: int  # of noise and faults
    settings: tuple[str, ...] = ()  # of the device, `name=value`, as they were given


def list_devices(json: str | None) -> None:
    """Show the devices that there are stand-ins for."""
    serial = ["pty", "tcp"] if hasattr(os, "openpty") else ["tcp"]
    rows: list[dict[str, Any]] = [
        {"name": name, "title": driver(name).title, "wires": ["udp"] if driver(name).link == "udp" else serial}
        for name in REGISTRY
    ]
    if not answer("simulate-cell", {"devices": rows}, json):
        table("Stand-ins", ["device", "title", "wires"], [[r["name"], r["title"], " ".join(r["wires"])] for r in rows])


def simulate_cell(
    options: Options, faults: dict[str, float | bool | int], disturbed: dict[str, float], json: str | None
) -> None:
    """Play readings as a device until they are over, the time is, or Ctrl-C."""
    for name, value in faults.items():
        if not 0 <= value < math.inf:
            raise InputError(f"{name.replace('_', '-')} is {value:g}", "a number, 0 or more")
    if not 0 < options.rate_hz < math.inf:
        raise InputError(f"--rate-hz {options.rate_hz:g}", "a rate above 0")
    if not 0 <= options.port <= LAST_PORT:
        raise InputError(f"--port {options.port}", f"0 to {LAST_PORT}", "0 takes any free one")
    if options.seconds is not None and not options.seconds > 0:
        raise InputError(f"--seconds {options.seconds:g}", "a time above 0")
    disturbance = Disturbance(**disturbed)
    device = stand_in(options.device)()
    device.set_up(given_settings(options.settings))
    kind = options.wire or ("udp" if device.datagrams else "pty" if hasattr(os, "openpty") else "tcp")
    if device.datagrams != (kind == "udp"):
        raise InputError(f"{options.device} on {kind}", "udp" if device.datagrams else "pty or tcp")
    if kind == "pty":
        refuse_useless("with a pseudo-terminal", "--wire tcp", port=options.port or None)
    else:
        refuse_useless(f"with --wire {kind}", "a pseudo-terminal", link=options.link)
    with _readings(options) as blocks:
        try:
            wire: Wire = (
                PtyWire(options.link) if kind == "pty" else (UdpWire if kind == "udp" else TcpWire)(options.port)
            )
        except OSError as error:
            what = "a pseudo-terminal" if kind == "pty" else f"port {options.port}"
            remedy = "" if kind == "pty" else "--port 0 takes any free one"
            raise InputError(f"{what} cannot be had ({error.strerror})", "a free one", remedy) from error
        settings = device.driver_settings
        command = _log_with(options.device, wire.address, settings)
        said = {"device": options.device, "address": wire.address, "settings": settings, "log_with": command}
        if not answer("simulate-cell", said, json):
            say(f"{options.device} at {wire.address}; Ctrl-C ends it.\n{command}")
        rate_hz = driver(options.device)(settings).rate_hz
        faulty = Faults(**faults)  # type: ignore[arg-type]
        player = Player(device, wire, blocks, faulty, disturbance=disturbance, seed=options.seed, rate_hz=rate_hz)
        try:
            player.run(lambda: options.seconds is not None and player.passed_s >= options.seconds)
        except KeyboardInterrupt:
            say(f"Ended; {player.written} records were written.")
        finally:
            wire.close()


def _log_with(device: str, address: str, settings: dict[str, Any]) -> str:
    """Return the command line that logs a stand-in."""
    words = ["fingertwin", "log", "--driver", device, "--port", address]
    for name, value in settings.items():
        words += ["--set", f'"{name}={value}"' if " " in str(value) else f"{name}={value}"]
    # A calibration file says whose it is.
    words += [] if "calibration" in settings else ["--serial", "STAND-IN", "--calibration", "none"]
    return " ".join([*words, "--out", "LOG"])


@contextmanager
def _readings(options: Options) -> Iterator[Iterable[ReadingBlock]]:
    """Return the readings to play: a recording, or those that a simulated rig records of a protocol."""
    path = Path(options.play)
    if path.is_file() and path.suffix not in (".yaml", ".yml"):
        yield open_readings(path).blocks()
    elif path.is_dir() or (data_dir() / "sessions" / options.play).is_dir():
        yield open_readings(_readings_of(options.play)).blocks()
    else:
        from fingermodel.rig import simulate_session

        protocol, cell = read_protocol(options.play), SimulatedCell(rate_hz=options.rate_hz)
        with tempfile.TemporaryDirectory() as folder:
            rig = Path(folder) / "rig"
            simulate_session(read_finger("an1979_middle"), protocol, rig, cell=cell, seed=options.seed)
            yield open_readings(_readings_of(str(rig))).blocks()


def _readings_of(session: str) -> Path:
    found = read_session(session)
    if found.readings_path is None:
        raise InputError(f"session {found.id} has no readings", "a session with raw readings")
    return found.readings_path
