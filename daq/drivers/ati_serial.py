"""ATI F/T controller over RS-232, in its ASCII and its binary form."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.drivers.base import BOOT_S, NOTHING, Decoder, Floats, LoadCell, Samples, Setting, Transport, samples
from daq.errors import DriverError

PROMPT = b"\r\n>"
BREAK = b"\r"
# It is asked again while it may still be starting up.
ANSWER_S = 2.0
TRIES = int(BOOT_S / ANSWER_S)
QUIET_S = 0.2
# More than this after a break is no rest of a stream any more, and more than that no answer.
MOST_REST, MOST_ANSWER = 20_000, 4000

ASCII_LENGTH = 45
BINARY_LENGTH = 13
# A controller prints neither leading zeros nor a negative zero.
_RECORD = re.compile(rb"([0-9])((?:, *(?:-?[1-9][0-9]*|0)){6})")
_END = re.compile(rb"[\r\n]")
# How fields are written: right-aligned and six wide, or without any spaces.
PADDED, PLAIN = 1, 2


class Lines:
    """Lines of a stream, no longer than `longest` bytes; longer ones are skipped as they come.

    CR, LF or both end a line: an empty one, which counts for nothing, may stand between the two.
    """

    def __init__(self, longest: int) -> None:
        self._longest = longest
        self._held = b""
        self._dropping = False

    def feed(self, data: bytes) -> tuple[list[bytes | None], int]:
        """Take bytes and return the lines that they complete (None: too long), and how many bytes were skipped."""
        *whole, held = _END.split(self._held + data)
        lines: list[bytes | None] = []
        skipped = 0
        for line in whole:
            if self._dropping or len(line) > self._longest:
                self._dropping = False
                lines.append(None)
                skipped += len(line) + 1
            else:
                lines.append(line)
        if self._dropping or len(held) > self._longest:
            skipped += len(held)
            self._dropping, held = True, b""
        self._held = held
        return lines, skipped


class AsciiDecoder:
    """Lines of exactly 43 bytes: an error digit, six times a comma and a right-aligned integer; CR, LF or both.

    There is no checksum (the controller's own is not confirmed): a digit that became another digit cannot be told.
    Everything else that damage does to a line breaks its form, and costs that line. A device that writes its numbers
    without padding is read too, as its first record tells; of its lines a lost digit cannot be told either.
    """

    def __init__(self, scale: Floats) -> None:
        self._scale = scale
        # Two records whose line end was lost are counted as two.
        self._lines = Lines(4 * ASCII_LENGTH)
        self._seen = self._bad = False
        self._form = PADDED | PLAIN

    def feed(self, data: bytes) -> Samples:
        """Take bytes and return the readings that they complete."""
        lines, skipped = self._lines.feed(data)
        rejected = 0
        rows: list[list[int]] = []
        for line in lines:
            if line == b"":
                skipped += int(self._bad)  # the other byte of that line's end
                continue
            row, form = ([], 0) if line is None else _row(line)
            self._bad = not form & self._form
            if not self._bad:
                rows.append(row)
                self._seen = True
                self._form &= form
                continue
            skipped += 0 if line is None else len(line) + 1
            # Before the first record it was an echo or a part of one; blank lines are none.
            if self._seen and (line is None or line.strip()):
                rejected += 1 if line is None else max(1, round(len(line) / ASCII_LENGTH))
        found = np.array(rows, dtype=np.int64).reshape(-1, 7)
        return samples(found[:, 1:] * self._scale, found[:, 0], found[:, 0] != 0, rejected=rejected, skipped=skipped)


def _row(line: bytes) -> tuple[list[int], int]:
    """Return error digit and six counts of a line, and in which of the forms it is, 0 where in none."""
    match = _RECORD.fullmatch(line)
    if match is None:
        return [], 0
    fields = match[2].split(b",")[1:]
    row = [int(match[1]), *map(int, fields)]
    form = PADDED * all(len(field) == 6 for field in fields) | PLAIN * (b" " not in line)
    return row, form if all(-32768 <= count <= 32767 for count in row) else 0


class BinaryDecoder:
    """Records of 13 bytes: an error byte, six big-endian int16; no header, no checksum, no count.

    What can be told: an error byte above 9 is none, so that record is refused. Where records begin is taken from the
    bytes themselves: a beginning is given up for another one when the three records after it would be a thousand times
    more plausible there (error bytes of 0, small counts, small steps), which bytes that were lost or added bring about;
    that costs up to four records, and one or two that damage put together may pass.

    What cannot be told: whether a byte inside a record was damaged; and, where axes do not move at all and their counts
    are tiny, whether bytes were lost. The ASCII form tells lost bytes and most damage; use it where 85 readings a
    second are enough. To look ahead, the last four records and a bit are held back until others follow.
    """

    AHEAD = 4 * BINARY_LENGTH - 1  # three records, wherever they begin
    WORST_ERROR = 9  # as in the ASCII form, where it is one digit
    CLEAR = np.log(1000.0)
    # Of an error byte that is none, and of one that is set, which is rare: three of them are a beginning to give up.
    NO_ERROR_BYTE, AN_ERROR = np.log(100.0), np.log(11.0)

    def __init__(self, scale: Floats) -> None:
        self._scale = scale
        self._held = b""
        self._seen = False

    def feed(self, data: bytes) -> Samples:
        """Take bytes and return the readings that they complete."""
        buffer, length = self._held + data, BINARY_LENGTH
        if len(buffer) < length + self.AHEAD:
            self._held = buffer
            return samples(NOTHING)
        octets = np.frombuffer(buffer, np.uint8)
        score = self._implausible(octets)
        at = rejected = skipped = 0
        out: list[NDArray[np.uint8]] = []
        while len(buffer) - at >= length + self.AHEAD:
            count = (len(buffer) - at - self.AHEAD) // length
            # (count, 13): the three records after each, were they to begin 0 to 12 bytes later.
            after = score[at + length : at + length * (count + 1)].reshape(count, length)
            better = after.min(axis=1) + self.CLEAR < after[:, 0]
            upto = int(np.argmax(better)) if better.any() else count
            records = octets[at : at + upto * length].reshape(upto, length)
            good = records[:, 0] <= self.WORST_ERROR
            out.append(records[good])
            bad = int(np.count_nonzero(~good))
            self._seen = self._seen or bad < upto
            rejected += bad
            skipped += bad * length
            at += upto * length
            if upto < count:
                # What was lost or added is somewhere in this record: it goes, up to the new beginning after it.
                step = length + int(np.argmin(after[upto]))
                rejected += int(self._seen)
                skipped += step
                at += step
        self._held = buffer[at:]
        found = np.concatenate(out) if out else np.zeros((0, length), dtype=np.uint8)
        counts = np.ascontiguousarray(found[:, 1:]).view(">i2").astype(np.float64)
        status = found[:, 0].astype(np.int64)
        return samples(counts * self._scale, status, status != 0, rejected=rejected, skipped=skipped)

    def _implausible(self, octets: NDArray[np.uint8]) -> Floats:
        """Return how implausible three records are that begin at each byte (n - 38,), as a logarithm."""
        windows = np.lib.stride_tricks.sliding_window_view(octets, BINARY_LENGTH)
        counts = np.ascontiguousarray(windows[:, 1:]).view(">i2").astype(np.float64)
        error = windows[:, 0]
        doubt = np.where(error > self.WORST_ERROR, self.NO_ERROR_BYTE, np.where(error > 0, self.AN_ERROR, 0.0))
        size = np.abs(counts)
        step = np.abs(counts[BINARY_LENGTH:] - counts[:-BINARY_LENGTH])
        n = len(octets) - self.AHEAD + BINARY_LENGTH
        first, second, third = (slice(k * BINARY_LENGTH, k * BINARY_LENGTH + n) for k in range(3))
        # Where a low byte is taken for a high one, 1 is 256. Each axis counts for itself, so that one such is enough.
        out: Floats = np.log1p(step[first] + step[second]).sum(axis=1)
        out += np.log1p(size[first] + size[second] + size[third]).sum(axis=1)
        # One may be damaged; three that are none are not.
        none = error > self.WORST_ERROR
        out += np.where(none[first] & none[second] & none[third], 2.0 * self.CLEAR, 0.0)
        out += doubt[first] + doubt[second] + doubt[third]
        # So that equal ones stay equal, in whatever portions the bytes come.
        return np.round(out, 6)


class AtiSerial(LoadCell):
    """ATI F/T controller: at 38400 baud at most 85 ASCII or 295 binary readings a second, no counter."""

    name = "ati-serial"
    title = "ATI F/T controller (RS-232)"
    link = "serial"
    baud = 38400
    settings = (
        Setting("encoding", "ascii (its form can be checked) or binary (faster)", "ascii", ("ascii", "binary")),
        Setting("counts_per_N", "counts for 1 N, from the cell's calibration", above=0.0),
        Setting(
            "counts_per_Nmm",
            "counts for 1 N mm, from the cell's calibration (counts for 1 N m, divided by 1000)",
            above=0.0,
        ),
    )
    example = (
        "fingertwin log --driver ati-serial --port COM3 --set counts_per_N=100 --set counts_per_Nmm=10 "
        "--protocol levels --out DIR"
    )
    source = "commands and records as in public driver code; checksum and error codes not confirmed, and not used"

    def __init__(self, given: Mapping[str, Any] | None = None) -> None:
        super().__init__(given)
        self.held_back = 4 if self.text("encoding") == "binary" else 0

    @property
    def rate_hz(self) -> float | None:
        """Unknown: it depends on baud rate, filter and form."""
        return None

    def decoder(self) -> Decoder:
        """Return a fresh decoder."""
        per_n, per_nmm = self.number("counts_per_N"), self.number("counts_per_Nmm")
        scale = np.array([1.0 / per_n] * 3 + [1.0 / per_nmm] * 3)
        return BinaryDecoder(scale) if self.text("encoding") == "binary" else AsciiDecoder(scale)

    def start(self, transport: Transport) -> None:
        """Stop what may be streaming, ask for resolved loads of all six axes and for saturation, then stream."""
        form = "B" if self.text("encoding") == "binary" else "A"
        hush(transport, BREAK)
        for command in (b"CD R", b"CD " + form.encode(), b"CV 3F", b"SM 1"):
            self._ask(transport, command, None)
        self._ask(transport, b"QS", self.decoder())

    def _ask(self, transport: Transport, command: bytes, decoder: Decoder | None) -> None:
        """Send a command until it is answered: by its echo and the prompt, or by the prompt alone of one without echo.

        Args:
            transport: to the device.
            command: without what ends it.
            decoder: fresh, where its answer is a stream of records, of which one is enough; else None.
        """
        said = b""
        for _ in range(TRIES):
            transport.write(command + b"\r")
            heard = b""
            while data := transport.read(ANSWER_S):
                heard += data
                _, echo, rest = heard.partition(command)
                if decoder is None:
                    if PROMPT in rest or heard.strip() == PROMPT.strip():
                        return
                elif echo or len(decoder.feed(data)):
                    return
                if len(heard) > MOST_ANSWER:
                    break
            said = said or heard
            if len(heard) > MOST_ANSWER:
                break
        raise DriverError(
            f"to {command.decode()} the device says {said[:40]!r}" if said else "no answer",
            f"an ATI F/T controller at {self.baud} baud",
            "Check power, cable, port and the controller's baud rate; is another device there?",
        )

    def stop(self, transport: Transport) -> None:
        """End the stream with a carriage return."""
        transport.write(BREAK)


def hush(transport: Transport, stop: bytes) -> None:
    """Stop a stream that may be running, and let its rest go by.

    Raises:
        DriverError: it does not end.
    """
    transport.write(stop)
    rest = 0
    while data := transport.read(QUIET_S):
        rest += len(data)
        if rest > MOST_REST:
            raise DriverError("the device keeps sending", "silence after it was stopped", "Switch it off and on again")
