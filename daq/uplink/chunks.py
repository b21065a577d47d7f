"""A journal's chunks, sent to the service: the oldest first, then whatever it should have and has not.

A chunk counts as sent once the service says that it holds it. What the service refuses is set aside in the journal with
an event that says so. Whatever else goes wrong is tried again: sending the same twice does no harm.
"""

from __future__ import annotations

import hashlib
import json
from collections import deque
from collections.abc import Mapping
from contextlib import suppress
from typing import TYPE_CHECKING

from daq.errors import JournalError
from daq.journal.writer import Event, Journal, Pending, Stream
from daq.uplink.link import Link, answered, said
from daq.uplink.parts import Sending
from daq.uplink.wire import COUNT, EPOCH, SHA256, Cursor, Range, stream_path, without

if TYPE_CHECKING:
    import httpx

# So many chunks are read from the journal at once, and noted as sent in one transaction: each transaction is a wait for
# the disk, also for whoever appends.
TOGETHER = 16
# What is wrong with a stream's description itself, and not with its sender.
_BAD_STREAM = (400, 409, 413, 422)


class ChunkFeed:
    """Sends a journal's chunks.

    Args:
        journal: whose chunks they are.
        link: to the service.
        session: that they belong to.

    Attributes:
        sent: chunks that the service has acknowledged.
        quarantined: chunks that it has refused.
    """

    def __init__(self, journal: Journal, link: Link, session: str) -> None:
        self._journal, self._link, self._session = journal, link, session
        self.sent = self.quarantined = 0
        self._alarm: str | None = None
        self.begin("")

    def begin(self, epoch: str) -> None:
        """Start with nothing known of the service, as after a restart."""
        self._epoch = epoch
        self._sending: Sending | None = None
        # What is to be sent next, and what the service holds though the journal does not say so yet.
        self._queue: deque[Pending] = deque()
        self._unnoted: list[tuple[str, int]] = []
        self._known: dict[str, Stream] = {s.id: s for s in self._journal.streams()} if epoch else {}
        self._to_describe = list(self._known)
        self._to_ask: list[str] = []
        # Streams that the service refused, and why.
        self._barred: dict[str, str] = {}
        # What the service lacks of each stream, of this what the journal cannot give, and how far the service ever was.
        self._lacking: dict[str, list[Range]] = {}
        self._without: dict[str, list[Range]] = {}
        self._told: dict[str, int] = {}
        self._aside: set[tuple[str, int]] = self._journal.set_aside() if epoch else set()

    def recheck(self) -> None:
        """Ask again what the service has."""
        self._to_ask = [s for s in self._known if s not in self._barred]

    def greet(self) -> bool:
        """Make one exchange about what a refusal meant, or about a stream as a whole; return whether there was one."""
        if self._sending is not None and self._sending.refusal is not None:
            self._tell_refusal(self._sending)
        elif self._to_describe:
            self._describe(self._to_describe[0])
        elif self._to_ask:
            self._ask(self._to_ask[0])
        else:
            return False
        return True

    def step(self) -> bool:
        """Send one chunk, or part of one; return whether there was anything to do."""
        if self._sending is None and not self._load():
            return False
        if self._sending is not None:
            self._send(self._sending)
        return True

    def _describe(self, stream: str) -> None:
        row = self._known[stream]
        value = {
            "driver": row.driver, "settings": row.settings, "cell": row.cell,
            "started_utc": row.started_utc, "clock": row.clock,
        }  # fmt: skip
        body = json.dumps(value, sort_keys=True).encode()
        headers = {"Content-Type": "application/json", EPOCH: self._epoch}
        response = self._link.exchange("PUT", stream_path(self._session, stream), body, headers)
        if response is None:
            return
        if response.is_success and isinstance(answered(response), Mapping):
            self._works()
            self._ask_about(stream)
        elif response.status_code in _BAD_STREAM:
            self._barred[stream] = f"its stream was refused: {said(response)}"
            self._to_ask = [s for s in self._to_ask if s != stream]
            if self._sending is not None and self._sending.stream == stream:
                self._sending = None  # to be set aside with the others
        else:
            self.turned_away(response)
            return
        self._to_describe.remove(stream)

    def _cursor(self, stream: str) -> Cursor | None:
        """Return the service's cursor of a stream; None where it is not known, and it is then asked for."""
        response = self._link.exchange("GET", stream_path(self._session, stream) + "/cursor")
        if response is None:
            return None
        try:
            if not response.is_success:
                raise ValueError
            cursor = Cursor.of_answer(answered(response))
        except ValueError:
            # It may have forgotten the stream.
            if stream not in self._to_describe:
                self._to_describe.append(stream)
            self.turned_away(response)
            return None
        self._works()
        return cursor

    def _ask(self, stream: str) -> None:
        cursor = self._cursor(stream)
        if cursor is None:
            return
        self._to_ask.remove(stream)
        end = self._journal.next_seq(stream)
        last = None  # it may be empty
        with suppress(JournalError):  # damaged: that is found where it is sent
            last = next(self._journal.read(stream, end), None)
        beyond = end + int(last is not None and not cursor.ended)
        tail = [(cursor.next_seq, beyond)] if cursor.next_seq < beyond else []
        self._lacking[stream] = without([*cursor.missing, *tail], self._without.get(stream, []))
        if cursor.next_seq > end and self._told.get(stream, 0) <= end:
            value = {"next_seq_here": end, "next_seq_there": cursor.next_seq, "epoch_there": cursor.epoch}
            self._journal.event(Event("service_ahead", 0.0, value, stream))
        self._told[stream] = cursor.next_seq

    def _ask_about(self, stream: str) -> None:
        if stream not in self._to_ask:
            self._to_ask.append(stream)

    def note(self) -> None:
        """Note in the journal what the service holds by now.

        Raises:
            JournalError: it cannot be noted, as on a full disk; it is kept in mind.
        """
        if self._unnoted:
            with self._journal.transaction():
                for key in self._unnoted:
                    self._journal.acknowledged(*key)
            self._unnoted = []

    def _load(self) -> bool:
        """Find a chunk to send; return whether anything was done."""
        if not self._queue:
            self.note()
            self._queue.extend(self._journal.pending(TOGETHER))
        if not self._queue:
            return self._load_lacking()
        chunk = self._queue[0]
        key = (chunk.stream, chunk.first_seq)
        if chunk.stream not in self._known:
            self._known |= {s.id: s for s in self._journal.streams()}
            self._to_describe.append(chunk.stream)
            return True
        self._queue.popleft()
        if chunk.stream in self._barred:
            self._set_aside(*key, chunk.n, self._barred[chunk.stream])
        elif hashlib.sha256(chunk.payload).hexdigest() != chunk.sha256:
            self._set_aside(*key, chunk.n, "damaged in the journal: its SHA-256 does not hold")
        else:
            self._sending = Sending(*key, chunk.n, chunk.payload, chunk.sha256, [(0, chunk.n)], resent=False)
        return True

    def _load_lacking(self) -> bool:
        """Find a chunk that the service once had."""
        for stream, ranges in self._lacking.items():
            if not ranges or stream in self._barred:
                continue
            begin, end = ranges[0]
            try:
                chunk = next(self._journal.read(stream, begin), None)
            except JournalError as error:
                self._journal.event(
                    Event("not_sent", 0.0, {"from_seq": begin, "to_seq": end, "why": str(error)}, stream)
                )
                chunk = None
            if chunk is None or chunk.first_seq >= end:
                self._give_up(stream, begin, end)
            elif (stream, chunk.first_seq) in self._aside:
                self._give_up(stream, begin, _end(chunk.first_seq, len(chunk)))
            else:
                payload = chunk.to_bytes()
                digest = hashlib.sha256(payload).hexdigest()
                whole = [(0, len(chunk))]
                self._sending = Sending(stream, chunk.first_seq, len(chunk), payload, digest, whole, resent=True)
            return True
        return False

    def _send(self, sending: Sending) -> None:
        begin, end = sending.parts[0]
        payload, digest = sending.message(begin, end)
        headers = {
            "Content-Type": "application/octet-stream",
            COUNT: str(end - begin),
            SHA256: digest,
            EPOCH: self._epoch,
        }
        path = f"{stream_path(self._session, sending.stream)}/chunks/{sending.first_seq + begin}"
        response = self._link.exchange("PUT", path, payload, headers)
        if response is None:
            self._journal.tried(sending.stream, sending.first_seq)
        elif response.is_success:
            self._stored(sending, response)
        elif response.status_code == 413 and end - begin > 1:
            sending.halve()
        elif response.status_code == 409:
            self._conflict(sending, response)
        else:
            sending.refusal = said(response)

    def _stored(self, sending: Sending, response: httpx.Response) -> None:
        begin, end = (sending.first_seq + at for at in sending.parts[0])
        try:
            cursor = Cursor.of_answer(answered(response))
        except ValueError:
            cursor = Cursor(0)
        if not cursor.holds(begin, end):
            # Whoever answered (a login page, say) is not the service, or it stored nothing.
            self._link.back_off(f"the service does not say that it holds samples {begin} to {end}")
            return
        self._works()
        sending.parts.pop(0)
        if not sending.parts:
            self._doubt(sending.stream, cursor)
            self._acknowledged(sending)

    def _acknowledged(self, sending: Sending) -> None:
        stream, first = sending.stream, sending.first_seq
        if not sending.resent:  # else it was noted when it was sent before
            self._unnoted.append((stream, first))
        self.sent += 1
        self._sending = None
        self._lacking[stream] = without(self._lacking.get(stream, []), [(first, _end(first, sending.count))])
        if sending.resent:
            self._ask_about(stream)
        if not self._queue:
            self.note()

    def _doubt(self, stream: str, cursor: Cursor) -> None:
        """Ask what the service has where it has less than it said before."""
        told = self._told.get(stream, 0)
        explained = [*self._lacking.get(stream, []), *self._without.get(stream, [])]
        if cursor.next_seq < told or without(cursor.missing, explained):
            self._ask_about(stream)
        self._told[stream] = max(told, cursor.next_seq)

    def _conflict(self, sending: Sending, response: httpx.Response) -> None:
        """See whether the service holds the same samples in other parts, as after its limit changed."""
        body = answered(response)
        held = sending.held(body.get("stored")) if isinstance(body, Mapping) else []
        left = without(sending.parts, held)
        if left == sending.parts:
            self._set_aside(sending.stream, sending.first_seq, sending.count, said(response))
            self._sending = None
            return
        self._works()
        sending.parts = left
        if not left:
            self._acknowledged(sending)

    def _tell_refusal(self, sending: Sending) -> None:
        """Blame the chunk where a service refuses it but answers otherwise; else blame the sender.

        The first time it may also mean what became of the chunk on the way, so it is sent once more.
        """
        reason, sending.refusal = sending.refusal or "", None
        if self._cursor(sending.stream) is None:
            return
        sending.refused += 1
        if sending.refused > 1:
            self._set_aside(sending.stream, sending.first_seq, sending.count, reason)
            self._sending = None

    def _set_aside(self, stream: str, first_seq: int, count: int, reason: str) -> None:
        self._journal.quarantined(stream, first_seq, reason)
        if not self.quarantined:
            self._journal.alarms.put(("quarantined", f"readings from {first_seq} on are only kept here: {reason}"))
        self.quarantined += 1
        self._aside.add((stream, first_seq))
        self._give_up(stream, first_seq, _end(first_seq, count))

    def _give_up(self, stream: str, begin: int, end: int) -> None:
        self._without.setdefault(stream, []).append((begin, end))
        self._lacking[stream] = without(self._lacking.get(stream, []), [(begin, end)])

    def turned_away(self, response: httpx.Response) -> None:
        """Say that a service wants nothing from here, as where a token ran out or a session has gone, and back off."""
        text = said(response)
        self._link.back_off(text)
        if text != self._alarm:
            self._alarm = text
            self._journal.event(Event("uplink_refused", 0.0, {"reason": text}))
            self._journal.alarms.put(("uplink_refused", f"session {self._session} takes nothing: {text}"))

    def _works(self) -> None:
        self._link.works()
        self._alarm = None


def _end(first_seq: int, count: int) -> int:
    # An empty chunk takes the place of the sample that will never follow it.
    return first_seq + max(count, 1)
