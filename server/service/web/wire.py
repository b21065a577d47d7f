"""WebSockets whose frames need not pass a task and five layers, thirty times a second each way.

The server's own connections are uvicorn's, and reachable from their scope as an extension: what is due to a client may
be written at once where nothing waits before it, and what a bench says may be taken as it comes.
"""

from __future__ import annotations

from collections.abc import Callable, MutableMapping
from typing import Any

from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.http11 import Request
from websockets.protocol import State

_EXTENSION = "fingertwin.wire"


class Wire(WebSocketsSansIOProtocol):
    """WebSocket connection that can be written to and heard directly."""

    _hear: Callable[[str], bool] | None = None

    def handle_connect(self, event: Request) -> None:
        """Begin, and put the connection into the scope."""
        super().handle_connect(event)
        # One that was refused never comes to the application, and has no scope.
        if not self.close_sent:
            self.scope["extensions"] = {**(self.scope["extensions"] or {}), _EXTENSION: {"wire": self}}

    def write(self, frame: bytes) -> bool:
        """Write a whole frame of the server's now; return False where it would wait, or nobody would get it."""
        closing = self.close_sent or self.disconnected or self.transport.is_closing()
        if closing or not self.handshake_complete or self.conn.state is not State.OPEN or not self.writable.is_set():
            return False
        self.transport.write(frame)
        return True

    def listen(self, hear: Callable[[str], bool]) -> None:
        """Hand each text to `hear` as it comes; one for which it returns False waits to be received."""
        self._hear = hear

    def send_receive_event_to_app(self) -> None:
        """Hand on a message that came."""
        if self._hear is not None and self.curr_msg_data_type == "text" and self.queue.empty() and not self.close_sent:
            try:
                text = b"".join(self.frames).decode()
            except UnicodeDecodeError:
                text = None
            if text is not None and self._hear(text):
                self.frames = []
                return
        super().send_receive_event_to_app()


def wire_of(scope: MutableMapping[str, Any]) -> Wire | None:
    """Return the connection that a scope is of, None where it is none of ours or hidden."""
    wire = scope.get("extensions", {}).get(_EXTENSION, {}).get("wire")
    return wire if isinstance(wire, Wire) else None


def hide_wire(scope: MutableMapping[str, Any]) -> None:
    """Hide the connection, so that every frame passes all layers and one of them can look at it."""
    scope.get("extensions", {}).pop(_EXTENSION, None)
