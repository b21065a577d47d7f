"""Tables beside the rows of hu2014b: muscle forces put in, nodes, stiffnesses, and what other layouts give."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from server.reproduce.hu2014b_network import (
    Change,
    Held,
    held_by,
    hood_of,
    index_with_network,
    mended,
    pulls_by_components,
    pulls_by_table_1,
)
from server.reproduce.printed import reference
from server.reproduce.study import Line, Sheet

if TYPE_CHECKING:
    from fingermodel.hood.parts import ElasticHood

# How far distal of B the hood's file has G and M, in lengths of the bone.
BESIDE = 0.0075


def pulls_sheet(loads: Sequence[dict[str, Any]]) -> Sheet:
    """Return muscle forces as printed, and as the printed springs add up to."""
    lines: list[Line] = []
    for k, load in enumerate(loads):
        table, sums = pulls_by_table_1(load), pulls_by_components(load)
        lines += [(f"posture {k + 1}", m, load["printed"].get(m, "–"), table[m], sums[m]) for m in table]
    return Sheet(
        "Muscle forces at the network's nodes",
        ("posture", "muscle", "printed [P]", "put in [N]", "springs at its node [N]"),
        lines,
        (
            "EDC is the paper's LE: put in by Eq 8. The sums leave out that the springs are askew, which makes them "
            "a little too large.",
        ),
    )


def nodes_sheet(held: Sequence[Held], hood: ElasticHood) -> Sheet:
    """Tabulate each node's position and its displacement."""
    lines: list[Line] = []
    for i, node in enumerate(hood.network.nodes):
        along, around = held[0].home_mm[i]
        lines.append((node, -float(along), float(around), *(float(one.moved_mm[i, 0]) for one in held)))
    return Sheet(
        "Nodes: place where nothing pulls, and displacement under load",
        (
            "node",
            "distal of the MCP [mm]",
            "radial, round the bone [mm]",
            *(f"proximal in posture {k + 1} [mm]" for k in range(len(held))),
        ),
        lines,
        ("On the unrolled dorsum of An's straight index finger. The paper prints no positions.",),
    )


def springs_sheet(held: Sequence[Held], springs: Sequence[str]) -> Sheet:
    """Return the length where nothing pulls, length under load and force of every spring."""
    lines: list[Line] = []
    for i, spring in enumerate(springs):
        numbers = ((h.length_mm[i], h.length_mm[i] + h.change_mm[i], h.force_N[i]) for h in held)
        lines.append((spring, *(float(x) for three in numbers for x in three)))
    return Sheet(
        "Springs: length where nothing pulls, distance of their ends under load, force",
        ("spring", *(f"{what}, posture {k + 1}" for k in range(len(held)) for what in ("mm", "loaded mm", "N"))),
        lines,
        ("A slack spring's ends are nearer than its length.",),
    )


def stiffness_sheet(hood: ElasticHood) -> Sheet:
    """Return printed force over printed length change, beside the stiffness in use."""
    tables = reference("hu2014b")["components"]
    lines: list[Line] = []
    for spring, stiffness in zip(hood.network.springs, hood.stiffness, strict=True):
        ratios: list[str | float | None] = []
        for table in tables.values():
            length, force = (float(x) for x in table[spring])
            ratios.append(force / length if force > 0.0 else None)
        lines.append((spring, *ratios, stiffness))
    return Sheet(
        "Stiffness: printed force over printed length change [N/mm]",
        ("spring", *(f"posture {k + 1}" for k in range(len(tables))), "used"),
        lines,
        (
            "A ratio ten times the others is a length change printed ten times too small. –: slack in print.",
            "EOE of posture 1: its printed force is posture 2's.",
        ),
    )


def layouts_sheet(loads: Sequence[dict[str, Any]]) -> Sheet:
    """Tabulate the distance of forces from the printed ones with other layouts and inputs."""
    lines: list[Line] = []
    for title, change, pulls in (
        ("as shipped", None, pulls_by_table_1),
        ("muscle forces from the printed springs", None, pulls_by_components),
        ("nodes slide along and round the bone", _in_both_directions, pulls_by_table_1),
        ("G and M level with B", _moved(("G", "M"), -BESIDE), pulls_by_table_1),
        ("G and M 0.1 of the bone more distal", _moved(("G", "M"), 0.1), pulls_by_table_1),
        ("C 0.1 of the bone more proximal", _moved(("C",), -0.1), pulls_by_table_1),
        ("bands and wings a third narrower", _narrower, pulls_by_table_1),
    ):
        finger = index_with_network(change)
        held = held_by(finger, loads, [pulls(load) for load in loads])
        lines.append((title, *_distance(held, hood_of(finger).network.springs)))
    return Sheet(
        "What the unprinted layout does: forces of the springs against the printed ones, three postures",
        ("layout", "RMS difference [N]", "largest [N]", "where", "slack or taut as printed, of 54"),
        lines,
        (
            "EOE of posture 1 as mended. None was chosen for its forces; as shipped, G and M lie where the springs "
            "that are slack in print are slack.",
        ),
    )


def _distance(held: Sequence[Held], springs: Sequence[str]) -> Line:
    off: list[tuple[float, str]] = []
    same = 0
    for k, one in enumerate(held):
        for spring, ours in zip(springs, one.force_N.tolist(), strict=True):
            printed = mended(one.name, spring)[1]
            off.append((abs(ours - printed), f"{spring}, posture {k + 1}"))
            same += (ours == 0.0) == (printed == 0.0)
    largest, where = max(off)
    return float(np.sqrt(np.mean([d * d for d, _ in off]))), largest, where, float(same)


def _in_both_directions(network: dict[str, Any]) -> None:
    for node in network["nodes"]:
        if node["slides_deg"]:
            node["slides_deg"] = [0.0, 90.0]


def _moved(names: Sequence[str], along: float) -> Change:
    def change(network: dict[str, Any]) -> None:
        for node in network["nodes"]:
            if node["name"] in names:
                node["along"] += along

    return change


def _narrower(network: dict[str, Any]) -> None:
    for node in network["nodes"]:
        node["around"] *= 2.0 / 3.0
