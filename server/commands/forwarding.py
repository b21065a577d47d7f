"""A log that goes to the service as it is written: store and forward for what is kept, a live path for what is seen."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from daq.errors import InputError

if TYPE_CHECKING:
    from daq.acquire import Acquisition
    from daq.journal.writer import Journal
    from daq.uplink.thread import UplinkStatus

# At the end of a log, for what is not at the service yet; the rest waits in the journal.
FLUSH_S = 15.0
TOKEN = "FINGERTWIN_TOKEN"  # noqa: S105 - the name of the variable that holds it


@contextmanager
def forwarding(
    to: str | None,
    session: str,
    journal: Journal,
    stream: str,
    acquisition: Acquisition,
    said: Callable[[str], None],
    document: Mapping[str, Any] | None = None,
) -> Iterator[None]:
    """Send a journal to a service while the block runs; without an address, nothing.

    Args:
        to: address of the service.
        session: there.
        journal: that is written.
        stream: of the acquisition.
        acquisition: whose samples are shown live.
        said: takes a line about how it went.
        document: of the session, where it is known beforehand; else the journal's events are its record.

    Raises:
        InputError: the address is none.
    """
    if to is None:
        yield
        return
    from daq.uplink.live_tail import LiveTail
    from daq.uplink.thread import Uplink

    token = os.environ.get(TOKEN)
    uplink = Uplink(journal, to, session, token=token, begins=True, document=document)
    tail = LiveTail(to, session, token=token)
    acquisition.live = lambda t_s, samples: tail.offer(stream, t_s, samples.wrench, samples.overload)
    uplink.start()
    tail.start()
    try:
        yield
    finally:
        acquisition.live = None
        tail.stop()
        whole = uplink.flush(FLUSH_S)
        status = uplink.status()
        uplink.stop()
        said(_worded(to, status, whole))


def _worded(to: str, status: UplinkStatus, whole: bool) -> str:
    aside = f"; {status.quarantined} chunks were refused and stay in the journal" if status.quarantined else ""
    if whole:
        return f"All is at {to} ({status.sent} chunks){aside}."
    why = f" ({status.problem})" if status.problem else ""
    return f"Not all is at {to}{why}: {status.sent} chunks are, the rest waits in the journal{aside}."


def session_document(folder: Path, name: str | None = None) -> dict[str, Any]:
    """Return a session's description as a service takes it: with its finger, where that is a file beside it.

    Args:
        folder: of the session.
        name: that it is to have there, if another than its own.

    Raises:
        SessionError: it cannot be used.
    """
    from daq.sessions import SESSION_FILE, read_session, read_yaml

    read_session(folder)
    document: dict[str, Any] = dict(read_yaml(folder / SESSION_FILE))
    if name is not None:
        document["id"] = name
    finger = folder / str(document["finger"])
    if finger.is_file():
        document["finger_document"] = read_yaml(finger)
    plain: dict[str, Any] = json.loads(json.dumps(document, default=str))
    return plain


def begin_session(to: str, document: Mapping[str, Any]) -> None:
    """Begin a session at a service that needs nothing but its description.

    Raises:
        InputError: the service cannot be reached, or refuses.
    """
    import httpx

    from daq.uplink.link import open_client, said
    from daq.uplink.wire import API

    with open_client(to, os.environ.get(TOKEN)) as client:
        try:
            response = client.post(f"{API}/sessions", json={"id": document["id"], "document": dict(document)})
        except httpx.HTTPError as error:
            raise InputError(
                f"no answer from {to} ({str(error) or type(error).__name__})", "a running service"
            ) from None
    if not response.is_success:
        raise InputError(said(response), "a service that takes the session")
