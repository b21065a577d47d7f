"""The stand-in's end of a cable: a pseudo-terminal, a TCP or a UDP port of this machine.

TCP ports are reached with pyserial's `socket://host:port` and work on every system; pseudo-terminals do where the
system has them.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
from pathlib import Path
from typing import Protocol

from daq.errors import DriverError


class Wire(Protocol):
    """The stand-in's end of a cable."""

    address: str

    def receive(self) -> bytes:
        """Return the bytes that have come from the host, without waiting."""

    def send(self, records: list[bytes]) -> None:
        """Write records; what nobody reads is lost, as on a real cable."""

    def pull(self) -> None:
        """Pull the cable."""

    def plug_in(self) -> None:
        """Plug the cable in again."""

    def close(self) -> None:
        """Take everything away."""


class TcpWire:
    """One host at a time on a TCP port of this machine."""

    def __init__(self, port: int = 0) -> None:
        self._server = socket.create_server(("127.0.0.1", port))
        self._server.setblocking(False)
        self._host: socket.socket | None = None
        self._port = self._server.getsockname()[1]
        self.address = f"socket://127.0.0.1:{self._port}"

    def receive(self) -> bytes:
        """Return the bytes that the host sent; a host that has gone makes room for the next."""
        if self._host is None:
            with contextlib.suppress(BlockingIOError):
                self._host, _ = self._server.accept()
                self._host.setblocking(False)
            return b""
        try:
            data = self._host.recv(4096)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self._hang_up()
        return data

    def send(self, records: list[bytes]) -> None:
        """Write to the host, if there is one."""
        if self._host is None:
            return
        try:
            self._host.sendall(b"".join(records))
        except BlockingIOError:
            return
        except OSError:
            self._hang_up()

    def _hang_up(self) -> None:
        if self._host is not None:
            self._host.close()
            self._host = None

    def pull(self) -> None:
        """Hang up and refuse calls."""
        self._hang_up()
        self._server.close()

    def plug_in(self) -> None:
        """Take calls again."""
        self._server = socket.create_server(("127.0.0.1", self._port))
        self._server.setblocking(False)

    def close(self) -> None:
        """Close both ends."""
        self._hang_up()
        self._server.close()


class UdpWire:
    """Datagrams to whoever spoke last."""

    def __init__(self, port: int = 0) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", port))
        self._socket.setblocking(False)
        self._host: tuple[str, int] | None = None
        self._out = False
        self.address = f"127.0.0.1:{self._socket.getsockname()[1]}"

    def receive(self) -> bytes:
        """Return the bytes that the host sent."""
        try:
            data, host = self._socket.recvfrom(4096)
        except OSError:
            return b""
        if self._out:
            return b""
        self._host = host
        return data

    def send(self, records: list[bytes]) -> None:
        """Send one datagram a record."""
        if self._host is not None and not self._out:
            for record in records:
                with contextlib.suppress(OSError):
                    self._socket.sendto(record, self._host)

    def pull(self) -> None:
        """Unplug the cable: nothing goes or comes."""
        self._out = True

    def plug_in(self) -> None:
        """Plug the cable in: data goes and comes again."""
        self._out = False

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


class PtyWire:
    """A pseudo-terminal; a link keeps its name while the cable is pulled and plugged in."""

    def __init__(self, link: str | None = None) -> None:
        if not hasattr(os, "openpty"):
            raise DriverError("this system has no pseudo-terminals", "a TCP port", "Use --wire tcp")
        self._link = link
        self.plug_in()

    def plug_in(self) -> None:
        """Open a new one."""
        import tty

        self._ours, self._theirs = os.openpty()
        tty.setraw(self._theirs)
        os.set_blocking(self._ours, False)
        name = os.ttyname(self._theirs)
        self.address = name
        if self._link:
            self._take_link_away()
            try:
                Path(self._link).symlink_to(name)
            except OSError as error:
                self.close()
                raise DriverError(
                    f"the link {self._link} cannot be made ({error.strerror})",
                    "a path in a folder that can be written, where nothing is but an earlier link",
                    "Choose another --link",
                ) from error
            self.address = self._link

    def _take_link_away(self) -> None:
        """Remove the link; what is no link is a file of the user's."""
        if self._link and Path(self._link).is_symlink():
            Path(self._link).unlink(missing_ok=True)

    def receive(self) -> bytes:
        """Return the bytes that the host sent."""
        try:
            return os.read(self._ours, 4096) if select.select([self._ours], [], [], 0.0)[0] else b""
        except OSError:
            return b""

    def send(self, records: list[bytes]) -> None:
        """Write as much as fits."""
        with contextlib.suppress(OSError):
            os.write(self._ours, b"".join(records))

    def pull(self) -> None:
        """Close both ends: the host's port goes away."""
        for end in (self._ours, self._theirs):
            with contextlib.suppress(OSError):
                os.close(end)
        self._take_link_away()

    def close(self) -> None:
        """Close both ends."""
        self.pull()
