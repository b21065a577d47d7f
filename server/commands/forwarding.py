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
    again: str = ""  # what sends the rest, where the log's own end is to name it
    journal: Path | None = None  # that was sent
    whole: bool = True  # everything is there
    refused: int = 0  # chunks that the service did not take
    barred: bool = False  # whether the service does not take the session under this name

    @property
    def remedy(self) -> str:
        """What sends what is not at the service yet."""
        return f"{self.again} {'and another --session NAME ' * self.barred}sends the rest"

    def require_whole(self) -> None:
        """Make sure that all is at the service.

        Raises:
            InputError: it is not; all is in the journal.
        """
        if self.whole or not self.journal:
            return
        if self.refused:
            raise InputError(
                f"{self.to} refused {counted(self.refused, 'chunk')}",
                "a service that takes them",
                f"They stay in {self.journal}; fingertwin journal requeue {quoted(self.journal)} has them sent again",
            )
        raise InputError(f"not all of {self.journal} is at {self.to}", "a service that takes it", self.remedy)


@contextmanager
def sending(
    delivery: Delivery,
    session: str,
    journal: Journal,
    said: Callable[[str], None],
    document: Mapping[str, Any] | None = None,
    *,
    bench: bool = False,
    begun: Callable[[], None] = lambda: None,
) -> Iterator[None]:
    """Send a journal to a service while the block runs, and on as long as any of it goes; without an address, nothing.

    Args:
        delivery: has the address of the service, and is told how it went.
        session: there.
        journal: that is sent.
        said: takes a line about how it went.
        document: of the session, where it is known beforehand; else the journal's events are its record.
        bench: whether these are a bench's, which takes no session of another's.
        begun: called once the session may be sent to.

    Raises:
        InputError: the address is none.
    """
    to = delivery.to
    if to is None:
        yield
        return
    token = os.environ.get(TOKEN)
    uplink = Uplink(journal, to, session, token=token, begins=True, document=document, bench=bench, begun=begun)
    uplink.start()
    broke_off = True
    try:
        yield
        broke_off = False
    finally:
        sent, whole = uplink.status().sent, uplink.flush(FLUSH_S)
        while not (whole or broke_off) and (status := uplink.status()).sent > sent:
            sent, whole = status.sent, uplink.flush(FLUSH_S)
        status = uplink.status()
        uplink.stop()
        delivery.journal, delivery.refused, delivery.barred = journal.path, status.quarantined, status.barred
        delivery.whole = whole and not status.quarantined and not status.events_refused
        said(_worded(delivery, status, whole, "All so far" if broke_off else "All"))


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
    """Send a journal that is written as `sending` does, and yield its live path; without an address, nothing.

    Args:
        delivery: has the address of the service, and is told how it went.
        session: there; the live path is shown once it is begun.
        journal: that is written.
        stream: of the acquisition.
        acquisition: whose samples are shown live.
        said: takes a line about how it went.
        document: of the session, where it is known beforehand.
        bench: whether these are a bench's.

    Raises:
        InputError: the address is none.
    """
    if delivery.to is None:
        yield None
        return
    tail = LiveTail(delivery.to, session, token=os.environ.get(TOKEN))
    with sending(delivery, session, journal, said, document, bench=bench, begun=tail.start):
        acquisition.live = lambda t_s, samples: tail.offer(stream, t_s, samples.wrench, samples.overload)
        try:
            yield tail
        finally:
            acquisition.live = None
            tail.stop()


def _worded(delivery: Delivery, status: UplinkStatus, whole: bool, all_of_it: str) -> str:
    if delivery.whole:
        return f"{all_of_it} is at {delivery.to} ({counted(status.sent, 'chunk')})."
    aside = [] if whole else ["the rest waits in the journal"]
    refused = counted(status.quarantined, "chunk") if status.quarantined else counted(status.events_refused, "event")
    aside += [f"{refused} refused and kept in the journal"] if status.quarantined or status.events_refused else []
    why = f" ({status.problem})" if status.problem else ""
    sent = f"Not all is at {delivery.to}{why}: {counted(status.sent, 'chunk')} sent, {', '.join(aside)}."
    return sent if whole or not delivery.again else f"{sent} {delivery.remedy}."
