"""Serial ports and UDP, as transports that a driver talks over. Faults are explained in one line with a remedy."""

from __future__ import annotations

import contextlib
import select
import socket
import time
from typing import TYPE_CHECKING

from daq.drivers.base import LoadCell, Transport
from daq.errors import DriverError, LinkLostError

if TYPE_CHECKING:
    import serial

# A read returns no more than this, so that one of a fast device does not grow without bound.
MOST_BYTES = 1 << 16
RDT_PORT = 49152
# A trace is shown thirty times a second, and times follow the device's count: neither suffers from this.
GATHER_S = 0.01


def connect(cell: LoadCell, port: str | None, baud: int | None = None) -> Transport:
    """Open what a load cell hangs on.

    Args:
        cell: whose `link` says what that is.
        port: a serial port (`COM3`, `/dev/ttyUSB0`, or any pyserial address such as `socket://host:port`), a host
            (`192.168.1.1` or `host:port`), or a file.
        baud: of a serial port; by default the device's.

    Raises:
        DriverError: it cannot be opened.
    """
    if cell.link == "none" and port is None:
        return cell.own_transport("")
    if port is None:
        what = {"serial": "the serial port", "udp": "the device's address", "file": "the file"}[cell.link]
        raise DriverError(
            f"{cell.name} lacks a port", f"{what} as --port", _known_ports() if cell.link == "serial" else ""
        )
    if cell.link == "serial":
        return SerialTransport(port, baud or int(getattr(cell, "baud", 115200)))
    if cell.link == "udp":
        return UdpTransport(port)
    return cell.own_transport(port)


class SerialTransport:
    """A serial port, eight data bits, no parity, one stop bit."""

    def __init__(self, port: str, baud: int) -> None:
        import serial

        self._lost = (serial.SerialException, OSError, TypeError)
        try:
            # Two programs on one port would each get a part of the bytes.
            self._port: serial.Serial = serial.serial_for_url(
                port, baud, timeout=0.0, write_timeout=2.0, exclusive=True
            )
        except (serial.SerialException, OSError, ValueError) as error:
            raise _cannot_open(port, error) from error

    def write(self, data: bytes) -> None:
        """Send all bytes."""
        try:
            self._port.write(data)
            self._port.flush()
        except self._lost as error:
            raise LinkLostError(f"the serial port has gone ({error})") from error

    def read(self, timeout_s: float) -> bytes:
        """Return what has come, as soon as anything has."""
        try:
            self._port.timeout = timeout_s
            first: bytes = self._port.read(1)
            if not first:
                return b""
            self._port.timeout = 0.0
            # Not by `in_waiting`, which of a socket only says whether there is anything.
            rest: bytes = self._port.read(MOST_BYTES)
        except self._lost as error:
            # pyserial raises TypeError where the port was closed under a waiting read.
            raise LinkLostError(f"the serial port has gone ({error})") from error
        return first + rest

    def close(self) -> None:
        """Let go of the port; a port that has gone is closed already."""
        with contextlib.suppress(*self._lost):
            self._port.close()


class UdpTransport:
    """Datagrams to and from one device."""

    def __init__(self, address: str) -> None:
        host, _, port = address.partition(":")
        if port and not port.isdecimal():
            raise DriverError(f"the address {address!r}", "a host, or host:port, such as 192.168.1.1:49152")
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._datagram = memoryview(bytearray(MOST_BYTES))
        self._flowing = False
        # Bursts wait here while this process is held up: a second of 7 kHz in single records.
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        try:
            self._socket.connect((host, int(port or RDT_PORT)))
        except (OSError, UnicodeError) as error:
            self._socket.close()
            why = getattr(error, "strerror", None) or error
            raise DriverError(
                f"no way to {address} ({why})",
                "the address of the device",
                "Is it on this network?",
            ) from error

    def write(self, data: bytes) -> None:
        """Send one datagram."""
        try:
            self._socket.send(data)
        except OSError as error:
            raise LinkLostError(f"the network has gone ({error.strerror or error})") from error

    def read(self, timeout_s: float) -> bytes:
        """Return one datagram. In a stream they gather for a moment: waking up for each costs more than reading it."""
        data = self._waiting()
        if data is None and self._flowing:
            rest_s = min(GATHER_S, timeout_s)
            time.sleep(rest_s)
            timeout_s -= rest_s
            data = self._waiting()
        if data is None:
            select.select([self._socket], [], [], max(timeout_s, 0.0))
            data = self._waiting()
        self._flowing = data is not None
        return data or b""

    def _waiting(self) -> bytes | None:
        """Return a datagram that has come; None where there is none."""
        try:
            # Into one place: a buffer of this size for each datagram would be asked of the system, and given back.
            count = self._socket.recv_into(self._datagram)
        except BlockingIOError:
            return None
        except OSError as error:
            raise LinkLostError(f"the device has gone ({error.strerror or error})") from error
        return bytes(self._datagram[:count])

    def close(self) -> None:
        """Let go of the socket."""
        self._socket.close()


def _cannot_open(port: str, error: Exception) -> DriverError:
    text = str(error)
    lower = text.lower()
    if "permission" in lower or "access is denied" in lower:
        return DriverError(
            f"no right to open {port}",
            "a port that this user may use",
            "Is another program on it? On Linux: be in the group dialout",
        )
    if "busy" in lower or "lock" in lower:
        return DriverError(f"{port} is in use", "a free port", "Close the other program")
    absent = any(word in lower for word in ("no such file", "filenotfound", "cannot find"))
    why = "" if absent else f" ({text.splitlines()[0][:120]})"
    return DriverError(f"no port {port}{why}", "a serial port", _known_ports())


def _known_ports() -> str:
    from serial.tools import list_ports

    names = [p.device for p in list_ports.comports()]
    return f"Here are {' '.join(names)}" if names else "None is here: plug in the adapter"
