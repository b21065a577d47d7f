"""ATI Axia over its console: lines of text with units, a line counter and a status."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np

from daq.drivers.ati_serial import Lines, hush
from daq.drivers.base import BOOT_S, LoadCell, Samples, Setting, Transport, Unwrap, heard_without_samples, samples, told
from daq.errors import DriverError

BREAK = b"\r"
# It is asked again while it may still be starting up.
ANSWER_S = 2.0
TRIES = int(BOOT_S / ANSWER_S)
LONGEST = 250
AXES = ("fx", "fy", "fz", "tx", "ty", "tz")
POUND_N = 4.4482216152605
INCH_MM = 25.4
GRAVITY = 9.80665
# To N and N mm; the units that the maker lists. A number without one of them is no reading.
FORCE_N = {"n": 1.0, "kn": 1e3, "lbf": POUND_N, "klbf": 1e3 * POUND_N, "kg": GRAVITY}
TORQUE_NMM = {
    "nm": 1e3,
    "nmm": 1.0,
    "kn-m": 1e6,
    "knm": 1e6,
    "lbf-in": POUND_N * INCH_MM,
    "lbf-ft": POUND_N * INCH_MM * 12.0,
    "kg-cm": GRAVITY * 10.0,
}
# Broken gauge, gauge out of range, force or torque out of range: each stays for 32 samples.
OVERLOAD = (1 << 2) | (1 << 27) | (1 << 30)

_VALUE = re.compile(r"([+-]?[0-9]+(?:\.[0-9]+)?)")
_FIELD = {"#": re.compile(r"[0-9]{1,10}"), "!": re.compile(r"[0-9A-Fa-f]{1,8}")}


def columns(command: str) -> tuple[str, ...]:
    """Parse the columns that a console command prints, in its order: `#`, `!` and the six axes.

    Raises:
        DriverError: it asks for what cannot be read here, or not for the counter and all six axes.
    """
    first, _, letters = command.partition(" ")
    out: list[str] = []
    kind = "f"
    for letter in letters:
        if letter in "ft":
            kind = letter
        elif letter in "xyz":
            out.append(kind + letter)
        elif letter in "#!":
            out.append(letter)
        elif letter not in "u<>; ":
            first = ""
    if first != "c" or not {"#", *AXES} <= set(out) or len(set(out)) != len(out):
        raise DriverError(
            f"ati-axia: command is {command!r}",
            "c and a space, then # and each axis once, such as c #!ufxyztxyz; in units, without s (an unknown CRC)",
        )
    return tuple(out)


@dataclass(frozen=True)
class _Line:
    counter: int
    status: int
    wrench: tuple[float, ...]
    size: int


class AxiaDecoder:
    """Lines such as `17 00000000 1.000 N -2.500 N 12.340 N 0.0100 Nm -0.0200 Nm 0.0030 Nm`.

    The three forces share a unit, and so do the three torques. The first line may be the rest of one: it counts once
    the second follows it by the counter. The console's checksum is not documented, and not asked for: a digit that
    became another one, or went missing, cannot be told.
    """

    def __init__(self, layout: tuple[str, ...], modulus: int) -> None:
        self._layout = layout
        self._modulus = modulus
        self._lines = Lines(LONGEST)
        self._unwrap = Unwrap(modulus)
        self._first: _Line | None = None
        self._started = False
        self._seen = self._bad = False

    def feed(self, data: bytes) -> Samples:
        """Take bytes and return the readings that they complete."""
        lines, skipped = self._lines.feed(data)
        rejected = 0
        good: list[_Line] = []
        for text in lines:
            if text == b"":
                # The other byte of a line's end.
                skipped += int(self._bad)
                self._first = self._first and replace(self._first, size=self._first.size + 1)
                continue
            line = None if text is None else self._read(text)
            whole, self._started = self._started, True
            if self._first is not None:
                held, self._first = self._first, None
                if line is not None and line.counter == (held.counter + 1) % self._modulus:
                    good.append(held)
                else:
                    skipped += held.size
            self._bad = line is None
            if line is None:
                skipped += 0 if text is None else len(text) + 1
                rejected += int(self._seen and (text is None or bool(text.strip())))
            elif whole:
                good.append(line)
            else:
                self._first = line
            self._seen = self._seen or line is not None
        status = np.array([line.status for line in good], dtype=np.int64)
        return samples(
            np.array([line.wrench for line in good], dtype=np.float64).reshape(-1, 6),
            status,
            (status & OVERLOAD) != 0,
            self._unwrap(np.array([line.counter for line in good], dtype=np.int64)),
            rejected=rejected,
            skipped=skipped,
        )

    def _read(self, line: bytes) -> _Line | None:
        """Read a line, or None where it is not exactly of the layout."""
        try:
            words = line.decode("ascii").replace(",", " ").split()
        except UnicodeDecodeError:
            return None
        if len(words) != sum(2 if name in AXES else 1 for name in self._layout):
            return None
        found = {"#": 0, "!": 0}
        values: dict[str, float] = {}
        units: dict[str, set[str]] = {"f": set(), "t": set()}
        rest = iter(words)
        for name in self._layout:
            word = next(rest)
            if name not in AXES:
                if not _FIELD[name].fullmatch(word):
                    return None
                found[name] = int(word, 10 if name == "#" else 16)
                continue
            unit = next(rest).lower()
            factor = (FORCE_N if name[0] == "f" else TORQUE_NMM).get(unit)
            if factor is None or not _VALUE.fullmatch(word):
                return None
            units[name[0]].add(unit)
            values[name] = float(word) * factor
        wrench = tuple(values[name] for name in AXES)
        if (
            max(len(units["f"]), len(units["t"])) > 1
            or found["#"] >= self._modulus
            or not told(np.array([wrench])).all()
        ):
            return None
        return _Line(found["#"], found["!"], wrench, len(line) + 1)


class AtiAxia(LoadCell):
    """ATI Axia: streams lines until it hears a carriage return."""

    name = "ati-axia"
    title = "ATI Axia (console)"
    link = "serial"
    baud = 115200
    settings = (
        Setting("command", "what streams: # counter, ! status, u units, f and t, x y z", "c #!ufxyztxyz", "text"),
        Setting("counter_bits", "where the line counter wraps, which the manual does not say", "32", ("16", "32")),
    )
    example = "fingertwin log --driver ati-axia --port COM3 --protocol levels --out DIR"
    source = (
        "maker's manual: letters, examples, units, status bits; that # and ! are printed where they are asked for, the "
        "baud rate and how a stream is stopped are to be checked on a device"
    )
    clock = "counter"

    @property
    def rate_hz(self) -> float | None:
        """Unknown: as fast as its baud rate and filter let it."""
        return None

    def decoder(self) -> AxiaDecoder:
        """Return a fresh decoder."""
        return AxiaDecoder(columns(self.text("command")), 2 ** int(self.text("counter_bits")))

    def start(self, transport: Transport) -> None:
        """Stop what may be streaming, then ask for the stream and see its first lines."""
        command = self.text("command").encode("ascii")
        hush(transport, BREAK)
        said = b""
        for _ in range(TRIES):
            transport.write(command + b"\r")
            heard = heard_without_samples(transport, self.decoder(), ANSWER_S, 20 * LONGEST)
            if heard is None:
                return
            said = said or heard
            if len(heard) > 20 * LONGEST:
                break
        raise DriverError(
            f"the device says {said[:40]!r}" if said else "no answer",
            f"lines of an ATI Axia for {command.decode()} at {self.baud} baud",
            "Check power, cable, port and baud rate; is another device there?",
        )

    def stop(self, transport: Transport) -> None:
        """End the stream with a carriage return."""
        transport.write(BREAK)
