"""ATI Net F/T and Ethernet Axia: raw data transfer (RDT) over UDP, up to 7 kHz."""

from __future__ import annotations

import struct

import numpy as np

from daq.drivers.base import BOOT_S, Floats, LoadCell, Samples, Setting, Transport, Unwrap, samples
from daq.errors import DriverError

LENGTH = 36
STOP_CODE, START_CODE, BUFFERED_CODE = 0, 2, 3
MODULUS = 2**32
ANSWER_S = 1.0
QUIET_S = 0.1
# UDP may lose a request, and a box may still be starting up.
TRIES = int(BOOT_S / ANSWER_S)
MOST_REST = 2000


def request(command: int, count: int = 0) -> bytes:
    """Return a request: header, command, number of records (0: without end)."""
    return struct.pack(">HHI", 0x1234, command, count)


class NetftDecoder:
    """Records of 36 bytes, big-endian: rdt_seq, ft_seq, status, six int32 counts; one or (buffered) many a datagram.

    Time is rdt_seq over the output rate. ft_seq counts the box's own measurements, and jumps where fewer are sent than
    measured, so it tells no loss.
    """

    def __init__(self, scale: Floats, rate_hz: float, overload: int) -> None:
        self._scale = scale
        self._rate_hz = rate_hz
        self._overload = np.int64(overload)
        self._unwrap = Unwrap(MODULUS)

    def feed(self, data: bytes) -> Samples:
        """Take one datagram and return its readings; one whose length is wrong is refused whole."""
        refused = len(data) % LENGTH != 0
        words = np.frombuffer(b"" if refused else data, ">u4").reshape(-1, LENGTH // 4)
        counts = words[:, 3:].astype(np.uint32).view(np.int32)
        status = words[:, 2].astype(np.int64)
        sequence = self._unwrap(words[:, 0])
        return samples(
            counts * self._scale,
            status,
            (status & self._overload) != 0,
            sequence,
            sequence / self._rate_hz,
            rejected=-(-len(data) // LENGTH) if refused else 0,
            skipped=len(data) if refused else 0,
        )


class AtiNetft(LoadCell):
    """ATI Net F/T, Ethernet Axia: UDP port 49152, 36 bytes a reading, counted by the device."""

    name = "ati-netft"
    title = "ATI Net F/T, Ethernet Axia (RDT over UDP)"
    link = "udp"
    port = 49152
    settings = (
        Setting("counts_per_N", "cfgcpf in netftapi2.xml of the box, for newtons", above=0.0),
        Setting("counts_per_Nmm", "cfgcpt in netftapi2.xml, divided by 1000 where its unit is N m", above=0.0),
        Setting("rate_hz", "RDT output rate, as set on the box's Communications page", above=0.0),
        Setting("buffered", "yes: many readings a datagram; no: one", "no", ("yes", "no")),
        Setting(
            "overload_bits",
            "status bits that mean beyond range: 2, 27, 30 in an Axia; 17 in a Net F/T, to be checked in its manual",
            "2 17 27 30",
            "text",
        ),
    )
    example = (
        "fingertwin log --driver ati-netft --port 192.168.1.1 --set counts_per_N=1000000 --set counts_per_Nmm=1000 "
        "--set rate_hz=1000 --protocol levels --out DIR"
    )
    source = "maker's manual; the status bits of a Net F/T older than the Axia are general knowledge"
    clock = "counter"

    @property
    def rate_hz(self) -> float:
        """The RDT output rate."""
        return self.number("rate_hz")

    def decoder(self) -> NetftDecoder:
        """Return a fresh decoder."""
        per_n, per_nmm = self.number("counts_per_N"), self.number("counts_per_Nmm")
        return NetftDecoder(np.array([1.0 / per_n] * 3 + [1.0 / per_nmm] * 3), self.rate_hz, self._overload())

    def _overload(self) -> int:
        words = self.text("overload_bits").replace(",", " ").split()
        if not all(w.isdecimal() and int(w) < 32 for w in words):
            raise DriverError(f"{self.name}: overload_bits is {' '.join(words)!r}", "bits 0 to 31, such as 27 30")
        return sum(1 << bit for bit in {int(w) for w in words})

    def start(self, transport: Transport) -> None:
        """Stop a stale stream and let it go by, then start the stream and see its first datagram."""
        transport.write(request(STOP_CODE))
        for _ in range(MOST_REST):
            if not transport.read(QUIET_S):
                break
        code = BUFFERED_CODE if self.text("buffered") == "yes" else START_CODE
        for _ in range(TRIES):
            transport.write(request(code))
            data = transport.read(ANSWER_S)
            if data and len(data) % LENGTH == 0:
                return
            if data:
                raise DriverError(
                    f"a datagram of {len(data)} bytes",
                    f"records of {LENGTH} bytes of an ATI Net F/T",
                    "Check the address; is another device there?",
                )
        raise DriverError(
            "no answer", "records of an ATI Net F/T", "Check power, address, network and that RDT is enabled on the box"
        )

    def stop(self, transport: Transport) -> None:
        """Ask for the end of the stream."""
        transport.write(request(STOP_CODE))
