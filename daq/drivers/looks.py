"""Diagnosis of bytes that make no reading: a hint at a wrong driver, speed or setting."""

from __future__ import annotations

import re
from collections import Counter

_SHOWN, _BYTES, _LOOKED_AT = 40, 16, 4096
_ENDS = {b"\r\n": "CR LF", b"\r": "CR alone", b"\n": "LF alone"}


def looks_like(data: bytes) -> str:
    """Say in a few words what bytes look like.

    Args:
        data: as they were read.
    """
    data = data[-_LOOKED_AT:]
    if not data:
        return "nothing"
    often, count = Counter(data).most_common(1)[0]
    if count == len(data):
        return f"{count} times {often:02x}"
    if sum(32 <= octet < 127 or octet in b"\t\r\n" for octet in data) > 0.95 * len(data):
        ends = Counter(re.findall(rb"\r\n|\r|\n", data)).most_common(1)
        lines = [line for line in re.split(rb"[\r\n]+", data) if line.strip()]
        # The first may be the rest of one.
        line = (lines[1:-1] or lines or [b""])[0][:_SHOWN].decode("ascii", "replace")
        return f"text such as {line!r}, {f'lines end in {_ENDS[ends[0][0]]}' if ends else 'without line ends'}"
    return f"binary such as {data[-_BYTES:].hex(' ')}"
