"""A log that goes to the service as it is written: store and forward for what is kept, a live path for what is seen."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from daq.uplink.live_tail import LiveTail
from daq.uplink.thread import Uplink, UplinkStatus

if TYPE_CHECKING:
    from daq.acquisition.acquire import Acquisition
    from daq.journal.writer import Journal

# At the end of a log, for what is not at the service yet; the rest waits in the journal.
FLUSH_S = 15.0
TOKEN = "FINGERTWIN_TOKEN"  # noqa: S105 - the name of the variable that holds it


@dataclass
class Delivery:
    """State of forwarding: complete, or with readings still to be sent."""

    whole: bool = True


@contextmanager
def forwarding(
    to: str | None,
    session: str,
    journal: Journal,
    stream: str,
    acquisition: Acquisition,
    said: Callable[[str], None],
    document: Mapping[str, Any] | None = None,
    delivery: Delivery | None = None,
) -> Iterator[LiveTail | None]:
    """Send a journal to a service while the block runs, and yield its live path; without an address, nothing.

    Args:
        to: address of the service.
        session: there.
        journal: that is written.
        stream: of the acquisition.
        acquisition: whose samples are shown live.
        said: takes a line about how it went.
        document: of the session, where it is known beforehand; else the journal's events are its record.
        delivery: is told how it went.

    Raises:
        InputError: the address is none.
    """
    if to is None:
        yield None
        return
    token = os.environ.get(TOKEN)
    uplink = Uplink(journal, to, session, token=token, begins=True, document=document)
    tail = LiveTail(to, session, token=token)
    acquisition.live = lambda t_s, samples: tail.offer(stream, t_s, samples.wrench, samples.overload)
    uplink.start()
    tail.start()
    try:
        yield tail
    finally:
        acquisition.live = None
        tail.stop()
        whole = uplink.flush(FLUSH_S)
        status = uplink.status()
        uplink.stop()
        said(_worded(to, status, whole))
        if delivery is not None:
            delivery.whole = whole and not status.quarantined


def _worded(to: str, status: UplinkStatus, whole: bool) -> str:
    aside = f"; {status.quarantined} chunks were refused and stay in the journal" if status.quarantined else ""
    if whole:
        return f"All is at {to} ({status.sent} chunks){aside}."
    why = f" ({status.problem})" if status.problem else ""
    return f"Not all is at {to}{why}: {status.sent} chunks are, the rest waits in the journal{aside}."
