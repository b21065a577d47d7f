"""The live connection of a load cell, when the network goes away under it."""

from __future__ import annotations

import subprocess
import sys

import pytest

# A process whose logging nobody has set up, as of a command at the bench: what a library logs as an error is printed.
PROGRAM = """
import threading, time
from websockets.sync.client import ClientConnection
from websockets.sync.server import serve

made = ClientConnection.__init__

def often(self, *given, **named):
    made(self, *given, **named | {"ping_interval": 0.02})

def gone(self, *given, **named):
    raise OSError("the network is gone")

ClientConnection.__init__, ClientConnection.ping = often, gone
with serve(lambda connection: list(connection), "127.0.0.1", 0) as server:
    threading.Thread(target=server.serve_forever, daemon=True).start()
    url = f"http://127.0.0.1:{server.socket.getsockname()[1]}"
    if WHO == "bench":
        from daq.uplink.live_wire import LiveSocket
        wire = LiveSocket(url, "S1")
        assert wire.send({"kind": "now"})
    else:
        from fingertwin.client import Client
        from fingertwin.client.live import _connected
        client = Client(url)
        stack = _connected(client._exchange, (), None, time.monotonic() + 5.0)
        stack.__enter__()
    time.sleep(0.3)
    server.shutdown()
print("done")
"""


@pytest.mark.parametrize("who", ["bench", "client"])
def test_a_ping_that_fails_prints_no_traceback(who: str) -> None:
    command = [sys.executable, "-c", f"WHO = {who!r}\n{PROGRAM}"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)  # noqa: S603
    assert (done.stdout, done.stderr) == ("done\n", "")
