"""Limit on a request's body, and an orderly end of one that is refused, so that its sender reads the reason."""

from __future__ import annotations

import asyncio
from contextlib import suppress

from starlette.responses import Response
from starlette.types import Message, Receive, Scope, Send

# Of a refused body, so much is read and thrown away for at most so long: a sender that still sends reads no answer.
_DRAINED_BYTES = 64 << 20
_DRAINED_S = 5.0


class LimitedBody:
    """Passes on a request's body and its answer, until the body has grown too large.

    Args:
        scope: of the request.
        receive: gives the body.
        send: takes the answer.
        most_bytes: of the body.
        refusal: the answer where it is larger.

    Attributes:
        refused: whether it was refused; the application's answer is then no longer wanted.
    """

    def __init__(self, scope: Scope, receive: Receive, send: Send, most_bytes: int, refusal: Response) -> None:
        self._scope, self._receive, self._send = scope, receive, send
        self._left, self._refusal = most_bytes, refusal
        self._started = self.refused = False

    async def receive(self) -> Message:
        """Return the next part of the body; where it is too large, the answer is given here, and the sender is gone."""
        if self.refused:
            return {"type": "http.disconnect"}
        message = await self._receive()
        if message["type"] != "http.request":
            return message
        self._left -= len(message.get("body", b""))
        if self._left >= 0:
            return message
        self.refused = True
        if not self._started:
            await refuse(self._scope, self._receive, self._send, self._refusal, more=message.get("more_body", False))
        return {"type": "http.disconnect"}

    async def send(self, message: Message) -> None:
        """Pass on the application's answer, unless another was given."""
        if self.refused and not self._started:
            return
        self._started = True
        await self._send(message)


async def refuse(scope: Scope, receive: Receive, send: Send, answer: Response, *, more: bool = True) -> None:
    """Answer a request whose body is not wanted, or open no WebSocket.

    Args:
        scope: of the request.
        receive: gives the body.
        send: takes the answer.
        answer: to be given.
        more: whether there may be more of the body.
    """
    if scope["type"] == "websocket":
        if "websocket.http.response" in scope.get("extensions", {}):
            await answer(scope, receive, send)
            # uvicorn closes the connection in its next turn; until then it takes our end for a failure.
            await asyncio.sleep(0)
        else:
            await send({"type": "websocket.close", "code": 1008, "reason": "refused"})
        return
    await send({"type": "http.response.start", "status": answer.status_code, "headers": answer.raw_headers})
    body = b"" if scope["method"] == "HEAD" else bytes(answer.body)
    await send({"type": "http.response.body", "body": body, "more_body": True})
    # Who waits to be told to go on has sent nothing, and will not.
    if more and not any(name == b"expect" for name, _ in scope["headers"]):
        with suppress(TimeoutError):
            async with asyncio.timeout(_DRAINED_S):
                await _drain(receive)
    await send({"type": "http.response.body", "body": b"", "more_body": False})


async def _drain(receive: Receive) -> None:
    left = _DRAINED_BYTES
    while left > 0:
        message = await receive()
        left -= len(message.get("body", b""))
        if message["type"] != "http.request" or not message.get("more_body", False):
            return
