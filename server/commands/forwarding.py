"""A log that goes to the service as it is written: store and forward for what is kept, a live path for what is seen."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from daq.errors import InputError
from daq.quoting import counted, quoted
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

    to: str | None  # address of the service; None where nothing is sent
    journal: Path | None = None  # that was sent
    whole: bool = True  # everything is there
    refused: int = 0  # chunks that the service did not take

    def require_taken(self) -> None:
        """Make sure that the service refused nothing; what waits is sent by the next log.

        Raises:
            InputError: it did; all is in the journal.
        """
        if self.refused and self.journal:
            raise InputError(
                f"{self.to} refused {counted(self.refused, 'chunk')}",
                "a service that takes them",
                f"They stay in {self.journal}; fingertwin journal requeue {quoted(self.journal)} has them sent again",
            )


@contextmanager
def forwarding(
    delivery: Delivery,
    session: str,
    journal: Journal,
    stream: str,
    acquisition: Acquisition,
    said: Callable[[str], None],
    document: Mapping[str, Any] | None = None,
    *,
    bench: bool = False,
) -> Iterator[LiveTail | None]:
    """Send a journal to a service while the block runs, and yield its live path; without an address, nothing.

    Args:
        delivery: has the address of the service, and is told how it went.
        session: there.
        journal: that is written.
        stream: of the acquisition.
        acquisition: whose samples are shown live.
        said: takes a line about how it went.
        document: of the session, where it is known beforehand; else the journal's events are its record.
        bench: whether these are a bench's, which takes no session of another's, and shows nothing there.

    Raises:
        InputError: the address is none.
    """
    to = delivery.to
    if to is None:
        yield None
        return
    token = os.environ.get(TOKEN)
    tail = LiveTail(to, session, token=token)
    uplink = Uplink(journal, to, session, token=token, begins=True, document=document, bench=bench, begun=tail.start)
    acquisition.live = lambda t_s, samples: tail.offer(stream, t_s, samples.wrench, samples.overload)
    uplink.start()
    try:
        yield tail
    finally:
        acquisition.live = None
        tail.stop()
        whole = uplink.flush(FLUSH_S)
        status = uplink.status()
        uplink.stop()
        said(_worded(to, status, whole))
        delivery.journal, delivery.refused = journal.path, status.quarantined
        delivery.whole = whole and not status.quarantined


def _worded(to: str, status: UplinkStatus, whole: bool) -> str:
    if whole and not status.quarantined:
        return f"All is at {to} ({counted(status.sent, 'chunk')})."
    aside = [] if whole else ["the rest waits in the journal"]
    aside += [f"{counted(status.quarantined, 'chunk')} refused and kept in the journal"] if status.quarantined else []
    why = f" ({status.problem})" if status.problem else ""
    return f"Not all is at {to}{why}: {counted(status.sent, 'chunk')} sent, {', '.join(aside)}."
