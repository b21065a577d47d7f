"""Live connection of a load cell to the service: a WebSocket that stays open, or posts where it takes none.

Through the WebSocket the service may also ask something of the bench. What is lost with a connection is not sent again:
a command that is carried out late does more harm than one that has to be given twice.
"""

from __future__ import annotations

import json
import logging
import math
import time
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

from daq.uplink.link import open_client
from daq.uplink.wire import session_path

if TYPE_CHECKING:
    import httpx
    from websockets.sync.client import ClientConnection

# Of an exchange: what is older is no longer live.
TIMEOUT_S = 0.5
# Of one command.
_MOST_BYTES = 1 << 16
# Refusals that say nothing of whether there is a WebSocket for benches.
_NOT_NOW = frozenset({401, 403, 408, 421, 429, 503})
# After a refusal that does, posts are sent for so long before it is tried again.
POSTING_S = 30.0
# A lost connection is told by what it raises. Of a ping that failed with it, the library would print a traceback.
_QUIET = logging.getLogger(__name__)
_QUIET.addHandler(logging.NullHandler())


@dataclass(frozen=True)
class Command:
    """Command of the service to a bench.

    Attributes:
        number: of the connection's commands, which its answer names.
        command: by its name.
        text: that belongs to it.
    """

    number: int
    command: str
    text: str = ""


class LiveWire(Protocol):
    """A way to a session's live path.

    Attributes:
        connections: how often one was made or lost; what was told before it changed may not be known at the other end.
    """

    connections: int

    def send(self, message: Mapping[str, Any]) -> bool:
        """Send a message, once; return whether it went."""

    def heard(self) -> list[Command]:
        """Return what the service asks for, without waiting."""

    def close(self) -> None:
        """Hang up."""


class Posts:
    """A request for each message.

    Args:
        client: of the service; closed with this.
        path: of the session's live path.
    """

    def __init__(self, client: httpx.Client, path: str) -> None:
        self._client, self._path = client, path
        self.connections = 0

    def send(self, message: Mapping[str, Any]) -> bool:
        """Post a message; return whether the service took it."""
        import httpx

        headers = {"Content-Type": "application/json"}
        try:
            return self._client.post(self._path, content=json.dumps(message), headers=headers).is_success
        except (httpx.HTTPError, OSError):
            return False

    def heard(self) -> list[Command]:
        """Return nothing: a request carries no command."""
        return []

    def close(self) -> None:
        """Hang up."""
        self._client.close()


class LiveSocket:
    """A WebSocket that is opened with the first message, and again with the next one after it was lost.

    Args:
        url: of the service.
        session: that is watched.
        token: for the service, where it wants one.

    Raises:
        InputError: the address is none.
    """

    def __init__(self, url: str, session: str, token: str | None = None) -> None:
        client = open_client(url, token, TIMEOUT_S)
        self._posts = Posts(client, f"{session_path(session)}/live")
        self._posting_until_s = -math.inf
        at = client.base_url.copy_with(
            scheme="wss" if client.base_url.scheme == "https" else "ws",
            raw_path=client.base_url.raw_path.rstrip(b"/") + f"{session_path(session)}/live".encode(),
        )
        self._address = str(at)
        self._headers = {"Authorization": f"Bearer {token}"} if token else {}
        self._socket: ClientConnection | None = None
        self._opened = ExitStack()
        self.connections = 0

    def send(self, message: Mapping[str, Any]) -> bool:
        """Send a message; return whether it went."""
        if self._socket is None and not self._posting:
            self._open()
        if self._socket is None:
            return self._posting and self._posts.send(message)
        from websockets.exceptions import WebSocketException

        try:
            self._socket.send(json.dumps(message))
        except (WebSocketException, OSError):
            self._lose()
            return False
        return True

    def heard(self) -> list[Command]:
        """Return what the service asks for; what cannot be understood is none of it."""
        from websockets.exceptions import WebSocketException

        out: list[Command] = []
        while self._socket is not None:
            try:
                text = self._socket.recv(timeout=0.0)
            except TimeoutError:
                break
            except (WebSocketException, OSError):
                self._lose()
                break
            with suppress(ValueError, KeyError, TypeError):
                told = json.loads(text)
                out.append(Command(int(told["number"]), str(told["command"]), str(told.get("text", ""))))
        return out

    def close(self) -> None:
        """Hang up."""
        self._lose()
        self._posts.close()

    @property
    def _posting(self) -> bool:
        return time.monotonic() < self._posting_until_s

    def _open(self) -> None:
        from websockets.exceptions import InvalidHandshake, InvalidStatus, WebSocketException
        from websockets.sync.client import connect

        try:
            self._socket = self._opened.enter_context(
                connect(
                    self._address,
                    additional_headers=self._headers,
                    compression=None,
                    # A proxy that the environment names leads to the world outside; the service is the lab's own.
                    proxy=None,
                    open_timeout=TIMEOUT_S,
                    close_timeout=TIMEOUT_S,
                    max_size=_MOST_BYTES,
                    logger=_QUIET,
                )
            )
            self.connections += 1
        except InvalidHandshake as error:
            if not (isinstance(error, InvalidStatus) and error.response.status_code in _NOT_NOW):
                self._posting_until_s = time.monotonic() + POSTING_S
        except (WebSocketException, OSError):
            self._socket = None

    def _lose(self) -> None:
        from websockets.exceptions import WebSocketException

        if self._socket is not None:
            self._socket = None
            self.connections += 1
        with suppress(WebSocketException, OSError):
            self._opened.close()
