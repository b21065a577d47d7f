"""Bench protocols (`protocol/1`): which loads, in which postures, where the cell sits, and when."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from daq.documents import Document, read_document, validated
from daq.errors import InputError
from daq.locations import data_dir
from daq.sessions.faults import require_posture

Mass = Annotated[float, Field(ge=0, le=1e6)]
Action = Literal["load", "overload", "unload", "tap"]
# How the note of a case begins whose rig was tapped before it was read.
TAPPED = "tapped"


class Timing(Document):
    """Durations of each state; windows keep `guard_s` away from the next change."""

    tare_s: float = Field(gt=0)
    load_s: float = Field(gt=0)
    settle_s: float = Field(ge=0)
    guard_s: float = Field(ge=0)

    @model_validator(mode="after")
    def _windows_exist(self) -> Timing:
        if min(self.load_s, self.tare_s) <= self.settle_s + self.guard_s:
            raise ValueError("load_s and tare_s must exceed settle_s + guard_s")
        return self


@dataclass(frozen=True)
class Reading:
    """Manner in which the weights come to rest before they are read.

    Attributes:
        direction: loading or unloading, by their last motion.
        overload: so many times the weights hung before, None where they did not.
        overloading: whether the overload is hung for this reading, and not for one before.
        tapped: whether the rig is tapped before the reading.
    """

    direction: str = "loading"
    overload: float | None = None
    overloading: bool = False
    tapped: bool = False


class Block(Document):
    """The same loads in several postures, the cell staying at one place.

    Attributes:
        actions: what is done with each of the loads, one after the other; the cell is read after all but `overload`.
        overload: so many times the weights hang before they are unloaded to the weights themselves.
        repeat_first: whether the first case of each posture is done once more after the others.
    """

    role: Literal["identification", "validation"]
    location: Literal["tip", "bone"]
    postures: list[str] = Field(min_length=1)
    masses_g: list[dict[str, Mass]] = Field(min_length=1)
    actions: tuple[Action, ...] = ("load",)
    overload: float = Field(1.2, gt=1, le=2)
    repeat_first: bool = False

    @field_validator("actions")
    @classmethod
    def _in_order(cls, actions: tuple[Action, ...]) -> tuple[Action, ...]:
        if not re.fullmatch(r"load( tap)?( overload unload( tap)?)?|overload unload( tap)?", " ".join(actions)):
            raise ValueError(f"{' '.join(actions) or 'none'} is not load, overload, unload, tap, or a part of it")
        return actions

    def readings(self) -> list[Reading]:
        """Return the readings of each load, in order."""
        out: list[Reading] = []
        direction, overload = "loading", None
        for action in self.actions:
            if action == "overload":
                direction, overload = "unloading", self.overload
            else:
                out.append(Reading(direction, overload, overloading=action == "unload", tapped=action == "tap"))
        return out


class Protocol(Document):
    """A bench protocol, `protocol/1`: postures, timing and blocks of load cases."""

    format: Literal["protocol/1"]
    id: str
    title: str = ""
    postures_deg: dict[str, dict[str, float]]
    timing: Timing
    blocks: list[Block] = Field(min_length=1)

    def heaviest_g(self) -> dict[str, float]:
        """Return the most that is hung on each tendon in any case [g]."""
        out: dict[str, float] = {}
        for block in self.blocks:
            for masses in block.masses_g:
                for tendon, mass in masses.items():
                    out[tendon] = max(mass, out.get(tendon, 0.0))
        return out


@dataclass(frozen=True)
class PlannedCase:
    """One load case of a protocol with its windows [s].

    Attributes:
        load_start_s: from when on the weights rest as they are read.
        reading: how they came to rest.
        overload_start_s: from when on the overload hangs, None where none is hung for this reading.
        repeat_of: the case that it repeats.
    """

    id: str
    role: str
    posture: str
    location: str
    masses_g: dict[str, float]
    unloaded_s: tuple[float, float]
    loaded_s: tuple[float, float]
    block_start_s: float
    load_start_s: float
    reading: Reading = Reading()
    overload_start_s: float | None = None
    repeat_of: str | None = None

    def told(self) -> dict[str, str]:
        """Return the case's data beyond its loads: direction, note and repeat_of, as far as there are any."""
        before, overload = [TAPPED] if self.reading.tapped else [], self.reading.overload
        before += [] if overload is None else [f"unloaded from {overload:g} times the weights"]
        unloading = {"direction": "unloading"} if self.reading.direction == "unloading" else {}
        note = {"note": ", ".join(before)} if before else {}
        return unloading | note | ({"repeat_of": self.repeat_of} if self.repeat_of else {})


def protocol_names() -> list[str]:
    """Return the names of the protocols that come with the software."""
    return sorted(p.stem for p in (data_dir() / "protocols").glob("*.yaml"))


def read_protocol(name_or_path: str, folder: Path | None = None) -> Protocol:
    """Read a protocol by its name in `data/protocols`, or from a file.

    Args:
        name_or_path: shipped name, or a path; a relative path is tried against `folder` first.
        folder: of the session that names the protocol.

    Raises:
        InputError: no such protocol, one that does not meet the format, or a posture that no session can have.
    """
    path = Path(name_or_path)
    if folder is not None and (folder / name_or_path).is_file():
        path = folder / name_or_path
    if not path.is_file():
        path = data_dir() / "protocols" / f"{name_or_path}.yaml"
    if not path.is_file():
        raise InputError(f"no protocol {name_or_path!r}", f"a file, or one of {', '.join(protocol_names())}")
    wanted = "a protocol/1 file"
    protocol = validated(Protocol, read_document(path, wanted), path.name, wanted)
    for name, angles in protocol.postures_deg.items():
        require_posture(name, angles)
    for block in protocol.blocks:
        for posture in block.postures:
            if posture not in protocol.postures_deg:
                raise InputError(f"{path.name} uses posture {posture!r}", f"one of {', '.join(protocol.postures_deg)}")
    return protocol


def plan(protocol: Protocol, repeats: int = 1) -> tuple[tuple[PlannedCase, ...], float]:
    """Lay a protocol out in time.

    Args:
        protocol: to lay out.
        repeats: how often the whole protocol is run, one after the other.

    Returns:
        The cases in order, and the length of the session [s].
    """
    t, timing = 0.0, protocol.timing
    cases: list[PlannedCase] = []
    for _ in range(repeats):
        for block in protocol.blocks:
            for posture in block.postures:
                start, first = t, len(cases)
                tare = (t + timing.settle_s, t + timing.tare_s - timing.guard_s)
                t += timing.tare_s
                done = [(masses, reading) for masses in block.masses_g for reading in block.readings()]
                for masses, reading in [*done, *done[: block.repeat_first]]:
                    over_s = t if reading.overloading else None
                    # An overload rests as long as a load settles.
                    t += timing.settle_s if reading.overloading else 0.0
                    loaded = (t + timing.settle_s, t + timing.load_s - timing.guard_s)
                    again = cases[first].id if len(cases) == first + len(done) else None
                    name = f"c{len(cases) + 1:03d}"
                    cases.append(
                        PlannedCase(
                            name, block.role, posture, block.location, dict(masses), tare, loaded, start, t,
                            reading, over_s, again,
                        )
                    )  # fmt: skip
                    t += timing.load_s
    return tuple(cases), t
