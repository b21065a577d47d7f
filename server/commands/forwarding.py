"""A log that goes to the service as it is written: store and forward for what is kept, a live path for what is seen."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from daq.errors import InputError
from daq.quoting import quoted
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
    """How forwarding ended."""

    whole: bool = True  # everything is there
    refused: int = 0  # chunks that the service did not take

    def require_taken(self, to: str | None, journal: Path) -> None:
        """Make sure that the service refused nothing; what waits is sent by the next log.

        Raises:
            InputError: it did; all is in the journal.
        """
        if self.refused:
            raise InputError(
                f"{to} refused {_chunks(self.refused)}",
                "a service that takes them",
                f"They stay in {journal}; fingertwin journal requeue {quoted(journal)} has them sent again",
            )


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
            delivery.refused, delivery.whole = status.quarantined, whole and not status.quarantined


def _chunks(count: int) -> str:
    return f"{count} chunk{'s' * (count != 1)}"


def _worded(to: str, status: UplinkStatus, whole: bool) -> str:
    if whole and not status.quarantined:
        return f"All is at {to} ({_chunks(status.sent)})."
    aside = [] if whole else ["the rest waits in the journal"]
    aside += [f"{_chunks(status.quarantined)} refused and kept in the journal"] if status.quarantined else []
    why = f" ({status.problem})" if status.problem else ""
    return f"Not all is at {to}{why}: {_chunks(status.sent)} sent, {', '.join(aside)}."
