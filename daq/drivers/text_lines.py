"""Any device that writes readings as lines of text over a serial port, with or without a header."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from daq.drivers.base import BOOT_S, LoadCell, Samples, Setting, Transport, samples
from daq.errors import DriverError, ReadingsError
from daq.recordings.columns import find_columns, quantity_of
from daq.vocabulary import LARGEST

AUTO = "auto"
# Tried in this order: a comma may be a decimal mark, and spaces may pad the fields of the others.
DELIMITERS: Mapping[str, str | None] = {"tab": "\t", "semicolon": ";", "comma": ",", "space": None}
MOST_LINE_BYTES = 1024
# One that writes so many whole lines which say nothing is another device.
MOST_BAD_LINES = 20
MOST_BYTES = 1 << 16
_NUMBER = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
# A number with what it is before it, and what parts it from the next.
_LABELLED = re.compile(
    r"\s*([^\s\d:=,;][^:=,;]*?)\s*[:=]\s*([+-]?(?:[0-9]+(?:[.,][0-9]+)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)(?:\s*[,;]\s*|\s+|$)"
)
_NAMED = re.compile(r"f[_ ]?x", re.IGNORECASE)
_EXAMPLE = "t_s,Fx_N,Fy_N,Fz_N,Tx_Nmm,Ty_Nmm,Tz_Nmm"


@dataclass(frozen=True)
class Layout:
    """Meaning of the fields of a line.

    Attributes:
        count: of fields.
        axes: place and factor to N or N mm of each of the six.
        time: place and factor to s, where there is one.
        status: its place, where there is one.
    """

    count: int
    axes: tuple[tuple[int, float], ...]
    time: tuple[int, float] | None
    status: int | None

    def reading(self, values: Sequence[float]) -> tuple[float, ...] | None:
        """Return time (0 where there is none), six axes and status; None where one cannot be."""
        at, factor = self.time or (0, 0.0)
        status = 0.0 if self.status is None else values[self.status]
        out = (values[at] * factor, *(values[i] * f for i, f in self.axes), status)
        whole = abs(status) < 2**53 and status == int(status)
        return out if whole and math.isfinite(out[0]) and all(abs(v) <= LARGEST for v in out[1:7]) else None


def layout_of(headers: Sequence[str], where: str) -> Layout:
    """Tell what the fields are by their headers; the time may be missing.

    Raises:
        ReadingsError: another is missing, there twice, or without a known unit.
    """
    count = len(headers)
    try:
        found = find_columns(headers, where)
    except ReadingsError as error:
        try:
            found = find_columns([*headers, "t_s"], where)
        except ReadingsError:
            raise error from None
    time, *axes = ((c.index, c.factor) for c in found.used)
    return Layout(count, tuple(axes), time if time[0] < count else None, found.status.index if found.status else None)


def split(line: str, delimiter: str) -> list[str]:
    """Cut a line into fields; one delimiter may end it."""
    fields = [f.strip() for f in line.split(DELIMITERS[delimiter])]
    return fields[:-1] if len(fields) > 1 and not fields[-1] else fields


def labelled(line: str) -> tuple[list[str], list[float]] | None:
    """Return labels and numbers of a line such as `Fx:1.00 Fy:-2.00` or `Fx=1,00; Fy=-2,00`; None where it is none."""
    labels, values, at = list[str](), list[float](), 0
    while at < len(line):
        field = _LABELLED.match(line, at)
        if field is None:
            return None
        labels.append(field[1])
        values.append(float(field[2].replace(",", ".")))
        at = field.end()
    return (labels, values) if len(labels) >= 6 else None


class TextDecoder:
    """Lines of numbers between delimiters, as a header or the setting says what they are.

    Delimiter, decimal mark and columns are told once, and kept: a line that does not fit is refused. The first line may
    be the rest of one, and is not used unless it is a header. A later header that says otherwise ends the readings:
    what follows it is refused.

    Where each number has a label (`Fx:1.00`), the labels are the header, or must be those of the columns in their
    order. Text carries no checksum: a digit that was changed on its way cannot be seen.

    Attributes:
        columns: headers between commas, once known.
        delimiter: its name, once known.
        decimal: point or comma, once known.
        problem: why what looks like a header is none.
    """

    def __init__(self, columns: str = "", delimiter: str = AUTO, decimal: str = AUTO) -> None:
        self.columns, self.delimiter, self.decimal = columns, delimiter, decimal
        self.problem: ReadingsError | None = None
        self._layout = layout_of(columns.split(","), "columns") if columns else None
        # A header counts once a line of so many numbers follows it.
        self._announced: tuple[Layout, str, str] | None = None
        self._contradicted = False
        self._held = b""
        self._first, self._overlong = True, False
        self._rejected = self._skipped = 0

    def feed(self, data: bytes) -> Samples:
        """Take bytes and return the readings of the lines that they complete."""
        self._rejected = self._skipped = 0
        rows: list[tuple[float, ...]] = []
        *ended, last = data.replace(b"\r", b"\n").split(b"\n")
        for piece in ended:
            self._hold(piece)
            if (row := self._end_line()) is not None:
                rows.append(row)
        self._hold(last)
        table = np.array(rows, dtype=np.float64).reshape(-1, 8)
        timed = self._layout is not None and self._layout.time is not None
        return samples(
            table[:, 1:7],
            table[:, 7].astype(np.int64),
            device_s=table[:, 0] if timed else None,
            rejected=self._rejected,
            skipped=self._skipped,
        )

    def _hold(self, piece: bytes) -> None:
        self._held += piece
        if self._overlong or len(self._held) > MOST_LINE_BYTES:
            self._skipped += len(self._held)
            self._held, self._overlong = b"", True

    def _end_line(self) -> tuple[float, ...] | None:
        octets, first, overlong = self._held, self._first, self._overlong
        self._held, self._overlong = b"", False
        if not octets and not overlong:
            return None  # between CR and LF, or an empty line
        self._first = False
        line = octets.decode("utf-8", "replace")
        fields = labelled(line)
        if fields is None and _NAMED.search(line) and self._header(line):
            self._skipped += len(octets)
            return None
        if first:
            self._skipped += len(octets)
            return None
        # Of an overlong line nothing is left, which is no reading.
        row = self._of_labels(*fields) if fields else self._reading(line)
        self._rejected += int(row is None)
        return row

    def _header(self, line: str) -> bool:
        """Take a line that names columns; False where it does not."""
        for delimiter in DELIMITERS if self.delimiter == AUTO else (self.delimiter,):
            headers = split(line, delimiter)
            if len(headers) < 6:
                continue
            try:
                layout = layout_of(headers, "the header")
            except ReadingsError as error:
                self.problem = self.problem or error
                continue
            if self._layout is None:
                self._announced = layout, ",".join(h.replace(",", " ") for h in headers), delimiter
            else:
                self._contradicted = layout != self._layout
            return True
        return False

    def _of_labels(self, labels: list[str], values: list[float]) -> tuple[float, ...] | None:
        """Return the reading of a line whose numbers have labels."""
        layout, columns = self._layout, self.columns
        if layout is None:
            try:
                layout, columns = layout_of(labels, "a line"), ",".join(labels)
            except ReadingsError as error:
                self.problem = self.problem or error
                return None
        named, needed = ([quantity_of(h) for h in headers] for headers in (labels, columns.split(",")))
        if self._contradicted or named != needed:
            return None
        row = layout.reading(values)
        if row is not None:
            self._layout, self.columns = layout, columns
        return row

    def _reading(self, line: str) -> tuple[float, ...] | None:
        """Return a line's reading, and keep what it tells about all lines."""
        if self._contradicted:
            return None
        layout, columns, delimiter = self._layout, self.columns, self.delimiter
        if layout is None:
            if self._announced is None:
                return None
            layout, columns, delimiter = self._announced
        for name in DELIMITERS if delimiter == AUTO else (delimiter,):
            decimal, values = self._numbers(line, name, layout.count)
            row = layout.reading(values) if values else None
            if row is not None:
                self._layout, self.columns, self.delimiter, self.decimal = layout, columns, name, decimal
                return row
        return None

    def _numbers(self, line: str, delimiter: str, count: int) -> tuple[str, list[float]]:
        """Return the decimal mark, as far as it is known with this line, and its numbers; none where one is none."""
        fields = split(line, delimiter)
        point, comma = "." in line, "," in line and delimiter != "comma"
        decimal = self.decimal if self.decimal != AUTO else "point" if point else "comma" if comma else AUTO
        if len(fields) != count or (point and decimal == "comma") or (comma and decimal != "comma"):
            return decimal, []
        if comma:
            fields = [f.replace(",", ".") for f in fields]
        return decimal, [float(f) for f in fields] if all(map(_NUMBER.fullmatch, fields)) else []


class TextLines(LoadCell):
    """Lines of text, whose fields a header or the settings define; the definition is kept with the record."""

    name = "text-lines"
    title = "Lines of text over a serial port (Arduino, loggers)"
    link = "serial"
    settings = (
        Setting(
            "columns",
            f"where no header comes, nor labels with units: what the columns are, such as {_EXAMPLE}",
            "",
            kind="text",
        ),
        Setting("delimiter", "between the numbers: told by the first lines", AUTO, (AUTO, *DELIMITERS)),
        Setting("decimal", "the decimal mark: told by the first lines", AUTO, (AUTO, "point", "comma")),
    )
    learns = ("columns", "delimiter", "decimal")
    example = f"fingertwin log --driver text-lines --port COM3 --set columns={_EXAMPLE} --protocol levels --out DIR"
    source = "the device's own: header or settings say what its columns are; a unit is never assumed"
    clock = "device"

    def __init__(self, given: Mapping[str, Any] | None = None) -> None:
        super().__init__(given)
        if self.text("delimiter") == "comma" and self.text("decimal") == "comma":
            raise DriverError(f"{self.name}: comma is both delimiter and decimal mark", "one of the two")
        try:
            self.decoder()
        except ReadingsError as error:
            raise DriverError(f"{self.name}: {error.found}", error.expected, f"Say --set columns={_EXAMPLE}") from None

    @property
    def rate_hz(self) -> None:
        """None: the device does not say."""
        return

    def decoder(self) -> TextDecoder:
        """Return a fresh decoder, which knows what `start` has learnt."""
        return TextDecoder(self.text("columns"), self.text("delimiter"), self.text("decimal"))

    def start(self, transport: Transport) -> None:
        """Read the first lines and keep what they tell in `values`, as a later reader may never see the header."""
        decoder, heard, bad = self.decoder(), b"", 0
        while True:
            data = transport.read(BOOT_S)
            heard += data
            got = decoder.feed(data)
            bad += got.rejected
            if len(got):
                self.values.update(columns=decoder.columns, delimiter=decoder.delimiter, decimal=decoder.decimal)
                return
            if not data or bad > MOST_BAD_LINES or len(heard) > MOST_BYTES:
                raise self._refusal(heard, decoder)

    def _refusal(self, heard: bytes, decoder: TextDecoder) -> DriverError:
        if not heard:
            return DriverError("the device sends nothing", "lines of text", "Check power, cable, port and --baud")
        if decoder.problem is not None:
            return DriverError(decoder.problem.found, decoder.problem.expected, f"Say it with --set columns={_EXAMPLE}")
        lines = heard.replace(b"\r", b"\n").split(b"\n")
        line = next((text for text in lines[1:-1] if text.strip()), lines[0])[:80]
        shown = repr(line.decode("ascii", "backslashreplace"))
        if decoder.columns:
            return DriverError(
                f"the device says {shown}", f"numbers for the columns {decoder.columns}", "Is --baud right?"
            )
        return DriverError(
            f"the device says {shown}, without a header",
            "a header with names and units, or the setting columns",
            f"Say what the columns are: --set columns={_EXAMPLE}",
        )
