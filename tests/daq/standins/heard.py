"""A wire of a stand-in that no host is at the other end of."""

from __future__ import annotations


class Heard:
    """A wire that keeps what is sent, and for which a pulled cable is nothing."""

    address = "nowhere"

    def __init__(self) -> None:
        self.data = b""

    def receive(self) -> bytes:
        return b""

    def send(self, records: list[bytes]) -> None:
        self.data += b"".join(records)

    def pull(self) -> None: ...

    def plug_in(self) -> None: ...

    def close(self) -> None: ...
