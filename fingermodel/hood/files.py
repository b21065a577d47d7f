"""Elastic hoods as files: `data/hoods/NAME.yaml`, format `hood/1`, and the block of a finger file that names one."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field

from daq.documents import Document, read_document
from daq.errors import ModelError
from daq.locations import data_dir
from fingermodel.fingers.sourced import Sourced
from fingermodel.hood.parts import ElasticHood, Network

WANTED = "a hood/1 file"
Role = Literal["central_slip", "radial_band", "ulnar_band", "terminal_slip"]
ROLES: tuple[Role, ...] = ("central_slip", "radial_band", "ulnar_band", "terminal_slip")


class _Node(Sourced):
    name: str
    bone: str
    along: float
    """How far distal of the bone's proximal joint, in lengths of the bone (of the last bone: of the one before)."""
    around: float
    """How far round the bone from its dorsal midline, radial positive, in the same length."""
    slides_deg: list[float] = Field(default_factory=list, max_length=2)
    """Directions in which it slides, from the finger's axis towards radial; none: it is fixed to the bone."""


class _Spring(Sourced):
    name: str
    ends: tuple[str, str]
    stiffness_N_per_mm: float = Field(gt=0)


class _Tether(Sourced):
    stiffness_N_per_mm: float = Field(gt=0)


class HoodFile(Document):
    """The schema of a hood file."""

    format: Literal["hood/1"]
    id: str
    title: str
    sources: dict[str, str]
    bones: list[str] = Field(min_length=2)
    nodes: list[_Node]
    springs: list[_Spring]
    tether: _Tether
    delivers: dict[Role, list[str]]
    groups: dict[str, list[str]] = Field(default_factory=dict)


class Fraction(Sourced):
    """A share with what is known of it."""

    value: float = Field(ge=0, le=1)
    sd: float | None = Field(default=None, ge=0)
    centre: float | None = Field(default=None, ge=0, le=1)


class ElasticHoodBlock(Document):
    """The block `hood` of a finger file whose hood is elastic."""

    kind: Literal["elastic_network"]
    network: HoodFile
    pulls: dict[str, str]
    """Node at which each muscle enters."""
    partial: list[str] = Field(default_factory=list)
    central_slip: str
    radial_band: str
    ulnar_band: str
    terminal_slip: str
    fractions: dict[str, Fraction]


def hood_names() -> list[str]:
    """Names of the shipped hoods."""
    return sorted(p.stem for p in (data_dir() / "hoods").glob("*.yaml"))


def with_network(finger: Any, folder: Path | None) -> Any:
    """Put a hood's file in the place of its name in the contents of a finger file, so that these stand alone.

    Args:
        finger: contents of a finger file, of whatever form.
        folder: of the finger file, in which a hood file may lie beside it; None allows shipped hoods only.

    Raises:
        ModelError: no such hood.
    """
    hood = finger.get("hood") if isinstance(finger, Mapping) else None
    if (
        not isinstance(hood, Mapping)
        or hood.get("kind") != "elastic_network"
        or not isinstance(hood.get("network"), str)
    ):
        return finger
    path = _find(hood["network"], folder)
    return {**finger, "hood": {**hood, "network": read_document(path, WANTED, ModelError)}}


def _find(name: str, folder: Path | None) -> Path:
    plain = Path(name).name == name
    if folder is not None and plain and (folder / name).is_file():
        return folder / name
    shipped = data_dir() / "hoods" / f"{name}.yaml"
    if plain and shipped.is_file():
        return shipped
    near = difflib.get_close_matches(name, hood_names(), n=1)
    raise ModelError(
        f"no hood {name!r}",
        f"one of {', '.join(hood_names())}, or the name of a file beside the finger's",
        f"Did you mean {near[0]}?" if near else "",
    )


def elastic_hood(block: ElasticHoodBlock, bones: Sequence[str], where: str) -> ElasticHood:
    """Build a finger's elastic hood from its block; `where` names the file in errors.

    Raises:
        ModelError: names that are not there, or springs that no slip of the finger stands for.
    """
    file = block.network
    _check(file, where)
    _need(
        all(b in bones for b in file.bones),
        f"{where}: the hood's bones are {', '.join(file.bones)}",
        f"bones of the finger: {', '.join(bones)}",
    )
    index = {node.name: i for i, node in enumerate(file.nodes)}
    for muscle, node in block.pulls.items():
        movable = node in index and bool(file.nodes[index[node]].slides_deg)
        _need(movable, f"{where}: {muscle} pulls at {node!r}", f"a node that slides: {', '.join(_movable(file))}")
    strange = [m for m in block.partial if m not in block.pulls]
    _need(not strange, f"{where}: hood.partial has {strange}", f"some of {', '.join(block.pulls)}")
    bone = {name: i for i, name in enumerate(bones)}
    slide = [direction for node in file.nodes for direction in _directions(node)]
    moves = [i for i, node in enumerate(file.nodes) for _ in node.slides_deg]
    slip_of = {spring: getattr(block, role) for role, springs in file.delivers.items() for spring in springs}
    hood = ElasticHood(
        network=Network(
            nodes=tuple(index),
            springs=tuple(s.name for s in file.springs),
            ends=tuple(_ordered(file, s, bone, index) for s in file.springs),
            moves=tuple(moves),
        ),
        bones=tuple(bone[node.bone] for node in file.nodes),
        places=tuple((node.along, node.around) for node in file.nodes),
        slide=tuple(slide),
        stiffness=tuple(s.stiffness_N_per_mm for s in file.springs),
        tether=file.tether.stiffness_N_per_mm,
        slips=tuple(slip_of.get(s.name, "") for s in file.springs),
        pulls=tuple((m, index[n], *_directions(file.nodes[index[n]])[0]) for m, n in block.pulls.items()),
        partial=tuple(block.partial),
        groups=tuple((name, tuple(_springs(file).index(s) for s in group)) for name, group in file.groups.items()),
        central_slip=block.central_slip,
        radial_band=block.radial_band,
        ulnar_band=block.ulnar_band,
        terminal_slip=block.terminal_slip,
    )
    expected = set(hood.fractions)
    _need(
        set(block.fractions) == expected,
        f"{where}: hood.fractions has {sorted(block.fractions)}",
        f"{sorted(expected)}",
    )
    return hood


def sourced_blocks(hood: HoodFile) -> Iterator[Sourced]:
    """Every block of the file that names a source."""
    yield hood.tether
    yield from hood.nodes
    yield from hood.springs


def _check(hood: HoodFile, where: str) -> None:
    names, springs = [n.name for n in hood.nodes], _springs(hood)
    for kind, given in (("node", names), ("spring", springs)):
        twice = sorted({n for n in given if given.count(n) > 1})
        _need(not twice, f"{where}: two {kind}s are called {twice[:1]}", "a name for each")
    of_bone = {node.name: node.bone for node in hood.nodes}
    for node in hood.nodes:
        _need(node.bone in hood.bones, f"{where}: node {node.name} lies on {node.bone!r}", ", ".join(hood.bones))
        a, b = (*node.slides_deg, 0.0, 90.0)[:2] if len(node.slides_deg) == 2 else (0.0, 90.0)
        _need(
            abs(np.sin(np.deg2rad(b - a))) > 0.01, f"{where}: node {node.name} slides twice one way", "two directions"
        )
    for spring in hood.springs:
        known = len(set(spring.ends)) == 2 and all(e in names for e in spring.ends)
        _need(known, f"{where}: spring {spring.name} joins {' and '.join(spring.ends)}", "two nodes")
    roles = [s for group in hood.delivers.values() for s in group]
    _need(set(hood.delivers) == set(ROLES), f"{where}: delivers has {sorted(hood.delivers)}", f"{sorted(ROLES)}")
    for spring in hood.springs:
        here, there = (hood.bones.index(of_bone[e]) for e in spring.ends)
        _need(abs(here - there) <= 1, f"{where}: spring {spring.name} crosses two joints", "a node on the bone between")
        expected = 1 if here != there else 0
        _need(
            roles.count(spring.name) == expected,
            f"{where}: spring {spring.name} is {roles.count(spring.name)} times in delivers",
            "each spring that crosses a joint once, no other",
        )
    for what, group in (("delivers", roles), *((f"groups.{k}", v) for k, v in hood.groups.items())):
        strange = [s for s in group if s not in springs]
        _need(not strange, f"{where}: {what} has {strange}", f"some of {', '.join(springs)}")
    for block in sourced_blocks(hood):
        _need(
            block.source in hood.sources, f"{where}: source {block.source!r} is not listed", f"{sorted(hood.sources)}"
        )


def _ordered(hood: HoodFile, spring: _Spring, bone: Mapping[str, int], index: Mapping[str, int]) -> tuple[int, int]:
    """Nodes of a spring, the more distal one first: its excursion lengthens it in that direction."""
    node = {n.name: n for n in hood.nodes}
    distal, proximal = sorted(spring.ends, key=lambda e: (bone[node[e].bone], node[e].along), reverse=True)
    return index[distal], index[proximal]


def _directions(node: _Node) -> list[tuple[float, float]]:
    return [(float(np.cos(np.deg2rad(a))), float(np.sin(np.deg2rad(a)))) for a in node.slides_deg]


def _movable(hood: HoodFile) -> list[str]:
    return [n.name for n in hood.nodes if n.slides_deg]


def _springs(hood: HoodFile) -> list[str]:
    return [s.name for s in hood.springs]


def _need(ok: bool, found: str, expected: str) -> None:
    if not ok:
        raise ModelError(found, expected)
