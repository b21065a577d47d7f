"""A bench day planned: which finger, which postures, which loads in which order, and a sheet to tick at the bench."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

import yaml

from daq.errors import InputError
from daq.files import replacing
from daq.lab.notebook import Note
from daq.sessions.protocols import PlannedCase, Protocol, plan
from daq.vocabulary import did_you_mean
from fingermodel.comparison.observations import posture_rad, require_determined
from fingermodel.fingers.finger import Finger
from server.figures.bench_sheet import write_bench_sheet

PROTOCOL, FINGER, NOTES, SHEET = "protocol.yaml", "finger.yaml", "notes.txt", "bench-sheet.pdf"
# Of loads that were typed: as the shipped protocols have it [s].
TIMING = {"tare_s": 4.0, "load_s": 5.0, "settle_s": 1.5, "guard_s": 0.3}


def protocol_of(notes: Sequence[Note], postures: Mapping[str, Mapping[str, float]], name: str) -> Protocol:
    """Make a protocol of loads as a notebook has them: lines of one posture, place and role become a block.

    Args:
        notes: the loads, in order; tares and what is left out say nothing, since every block begins with its tare.
        postures: angles [deg] by name.
        name: of the protocol.

    Raises:
        InputError: a posture whose angles are not known.
    """
    loads = [note for note in notes if note.kind == "load"]
    lacks = [n.posture for n in loads if n.posture not in postures]
    if lacks:
        raise InputError(
            f"the angles of {', '.join(dict.fromkeys(lacks))} are not known",
            f"--posture '{lacks[0]}: MCP 0 PIP 65 DIP 50' for each, in degrees, flexion positive",
        )
    if other := next((n for n in loads if n.tapped or n.direction == "unloading"), None):
        raise InputError(
            f"line {other.line} of the loads is {'tapped' if other.tapped else other.direction}",
            "loads that are hung and read",
            "The protocol 'friction' unloads and taps: --protocol friction, or a file with its actions",
        )
    blocks = [
        {"role": role, "location": location, "postures": [posture], "masses_g": [dict(n.masses_g) for n in group]}
        for (posture, location, role), group in groupby(loads, lambda n: (n.posture, n.location, n.role))
    ]
    used = {n.posture: dict(postures[n.posture]) for n in loads}
    return Protocol.model_validate(
        {"format": "protocol/1", "id": name, "postures_deg": used, "timing": TIMING, "blocks": blocks}
    )


def in_postures(protocol: Protocol, postures: Mapping[str, Mapping[str, float]], only: Sequence[str]) -> Protocol:
    """Return a protocol with some postures' angles set anew, and in some postures only.

    Args:
        protocol: to change.
        postures: angles [deg] by name.
        only: the postures to keep; none keeps all.

    Raises:
        InputError: a posture that the protocol does not use, or none left.
    """
    used = list(dict.fromkeys(name for block in protocol.blocks for name in block.postures))
    for name in (*only, *postures):
        if name not in used:
            raise InputError(f"{protocol.id} has no posture {name!r}", f"of {', '.join(used)}")
    kept = [name for name in used if not only or name in only]
    blocks = [b.model_copy(update={"postures": [p for p in b.postures if p in kept]}) for b in protocol.blocks]
    angles = {name: dict(postures.get(name, protocol.postures_deg[name])) for name in kept}
    return protocol.model_copy(update={"blocks": [b for b in blocks if b.postures], "postures_deg": angles})


def require_fits(protocol: Protocol, finger: Finger) -> None:
    """Refuse a protocol that a finger cannot be loaded by.

    Raises:
        InputError: a tendon or an angle that the finger does not have, or a posture that leaves it straight.
    """
    for tendon in protocol.heaviest_g():
        if tendon not in finger.topology.muscles:
            raise InputError(
                f"{protocol.id} loads {tendon!r}, which {finger.id} has not",
                f"of {' '.join(finger.topology.muscles)}",
                did_you_mean(tendon, finger.topology.muscles),
            )
    postures = protocol.postures_deg.items()
    require_determined(finger, {name: posture_rad(finger.topology, a, f"posture {name}") for name, a in postures})


def notes_of_plan(cases: Sequence[PlannedCase]) -> str:
    """Return the planned cases as the notebook that `fingertwin new` reads, one line each."""
    lines = []
    for case in cases:
        masses = " + ".join(f"{tendon} {mass:g}" for tendon, mass in case.masses_g.items())
        more = ["again"] if case.repeat_of else []
        more += ["unloading"] if case.reading.direction == "unloading" else []
        more += ["tapped"] if case.reading.tapped else []
        lines += ["skip"] if case.overload_start_s is not None else []
        lines.append(", ".join([masses, case.posture, case.location, case.role, *more]))
    return "\n".join(lines) + "\n"


def write_plan(
    out: Path, protocol: Protocol, finger: Finger, bones: Sequence[tuple[str, float]], title: str
) -> dict[str, Any]:
    """Write protocol, notebook and bench sheet into a folder.

    Args:
        out: the folder.
        protocol: to run.
        finger: that is loaded.
        bones: measured lengths of the specimen's bones [mm].
        title: of the sheet.

    Returns:
        What was written, how many cases there are, and how long they take [s].
    """
    cases, length_s = plan(protocol)
    out.mkdir(parents=True, exist_ok=True)
    plain = protocol.model_dump(mode="json", exclude_defaults=True)
    for name, text in (
        (PROTOCOL, yaml.safe_dump(plain, sort_keys=False, allow_unicode=True, width=120)),
        (NOTES, notes_of_plan(cases)),
    ):
        with replacing(out / name) as temporary:
            temporary.write_text(text, "utf-8")
    pages = write_bench_sheet(out / SHEET, protocol, cases, title, finger.title, bones)
    return {"cases": len(cases), "length_s": length_s, "pages": pages, "heaviest_g": protocol.heaviest_g()}
