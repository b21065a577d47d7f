"""Bench protocols (`protocol/1`): which loads, in which postures, where the cell sits, and when."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from daq.documents import Document, read_document, validated
from daq.errors import InputError
from daq.locations import data_dir

Mass = Annotated[float, Field(ge=0, le=1e6)]


class Timing(Document):
    """How long each state lasts; windows keep `guard_s` away from the next change."""

    tare_s: float = Field(gt=0)
    load_s: float = Field(gt=0)
    settle_s: float = Field(ge=0)
    guard_s: float = Field(ge=0)

    @model_validator(mode="after")
    def _windows_exist(self) -> Timing:
        if min(self.load_s, self.tare_s) <= self.settle_s + self.guard_s:
            raise ValueError("load_s and tare_s must exceed settle_s + guard_s")
        return self


class Block(Document):
    """The same loads in several postures, the cell staying at one place."""

    role: Literal["identification", "validation"]
    location: Literal["tip", "bone"]
    postures: list[str] = Field(min_length=1)
    masses_g: list[dict[str, Mass]] = Field(min_length=1)


class Protocol(Document):
    """A bench protocol, `protocol/1`: postures, timing and blocks of load cases."""

    format: Literal["protocol/1"]
    id: str
    title: str = ""
    postures_deg: dict[str, dict[str, float]]
    timing: Timing
    blocks: list[Block] = Field(min_length=1)

    def heaviest_g(self) -> dict[str, float]:
        """The most that is hung on each tendon in any case [g]."""
        out: dict[str, float] = {}
        for block in self.blocks:
            for masses in block.masses_g:
                for tendon, mass in masses.items():
                    out[tendon] = max(mass, out.get(tendon, 0.0))
        return out


@dataclass(frozen=True)
class PlannedCase:
    """One load case of a protocol with its windows [s]."""

    id: str
    role: str
    posture: str
    location: str
    masses_g: dict[str, float]
    unloaded_s: tuple[float, float]
    loaded_s: tuple[float, float]
    block_start_s: float
    load_start_s: float


def read_protocol(name_or_path: str, folder: Path | None = None) -> Protocol:
    """Read a protocol by its name in `data/protocols`, or from a file.

    Args:
        name_or_path: shipped name, or a path; a relative path is tried against `folder` first.
        folder: of the session that names the protocol.

    Raises:
        InputError: no such protocol, or one that does not meet the format.
    """
    path = Path(name_or_path)
    if folder is not None and (folder / name_or_path).is_file():
        path = folder / name_or_path
    if not path.is_file():
        path = data_dir() / "protocols" / f"{name_or_path}.yaml"
    if not path.is_file():
        names = sorted(p.stem for p in (data_dir() / "protocols").glob("*.yaml"))
        raise InputError(f"no protocol {name_or_path!r}", f"a file, or one of {', '.join(names)}")
    wanted = "a protocol/1 file"
    protocol = validated(Protocol, read_document(path, wanted), path.name, wanted)
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
                start = t
                tare = (t + timing.settle_s, t + timing.tare_s - timing.guard_s)
                t += timing.tare_s
                for masses in block.masses_g:
                    loaded = (t + timing.settle_s, t + timing.load_s - timing.guard_s)
                    name = f"c{len(cases) + 1:03d}"
                    cases.append(
                        PlannedCase(name, block.role, posture, block.location, dict(masses), tare, loaded, start, t)
                    )
                    t += timing.load_s
    return tuple(cases), t
