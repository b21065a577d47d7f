"""A stand-in for a device that writes lines of text."""

from __future__ import annotations

from typing import ClassVar

from daq.standins.base import Floats, Integers, StandIn

HEADERS = ("t_s", "Fx_N", "Fy_N", "Fz_N", "Tx_Nmm", "Ty_Nmm", "Tz_Nmm", "status")


class TextLinesStandIn(StandIn):
    """Streams from when it is switched on, without a header, and hears nothing."""

    name = "text-lines"
    unasked = True
    settings: ClassVar[dict[str, float | int | str]] = {"columns": ",".join(HEADERS)}

    def hear(self, data: bytes) -> bytes:
        """Say nothing."""
        return b""

    def encode(self, wrench: Floats, sequence: Integers, time_s: Floats, status: Integers | None = None) -> list[bytes]:
        """Return lines with six decimals of the time, four of the rest, and the status."""
        states = [0] * len(wrench) if status is None else status.tolist()
        return [
            f"{t:.6f},{','.join(f'{v:.4f}' for v in row)},{state}\r\n".encode("ascii")
            for t, row, state in zip(time_s.tolist(), wrench.tolist(), states, strict=True)
        ]
