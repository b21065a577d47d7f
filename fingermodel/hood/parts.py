"""What an elastic hood is made of: nodes, springs, and where they lie. Read without the array compiler."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Network:
    """Who is tied to whom. Hashable: the compiler keys on it.

    Attributes:
        nodes: names.
        springs: names.
        ends: of each spring, indices of its nodes, the more distal one first.
        moves: node that each way of sliding belongs to: none for a fixed node, one for a line, two for a surface.
    """

    nodes: tuple[str, ...]
    springs: tuple[str, ...]
    ends: tuple[tuple[int, int], ...]
    moves: tuple[int, ...]

    @cached_property
    def incidence(self) -> NDArray[np.float64]:
        """(springs, nodes): -1 at a spring's distal node, 1 at its proximal one."""
        out = np.zeros((len(self.springs), len(self.nodes)))
        for i, (distal, proximal) in enumerate(self.ends):
            out[i, distal], out[i, proximal] = -1.0, 1.0
        return out

    @cached_property
    def sliding(self) -> NDArray[np.float64]:
        """(ways, nodes): 1 at the node that each way belongs to."""
        return np.eye(len(self.nodes))[list(self.moves)].reshape(-1, len(self.nodes))


@dataclass(frozen=True)
class ElasticHood:
    """A hood that shares tension by the stiffness of its fibres. Hashable, with numbers that belong to the anatomy.

    Lengths are multiples of the bone's own length from joint centre to joint centre (of the last bone: of the one
    before), so that the hood fits a finger of any size.

    Attributes:
        network: nodes and springs.
        bones: index of each node's bone.
        places: of each node: how far distal of the bone's proximal joint it lies, and how far round from the dorsal
            midline (radial positive).
        slide: unit vector of each of `network.moves`: along (proximal positive) and around.
        stiffness: of each spring [N/mm].
        tether: [N/mm].
        slips: finger's slip that each spring is a part of where it crosses a joint, empty elsewhere.
        pulls: (muscle, node, along, around): where each muscle enters and in which direction.
        partial: muscles of which a part may insert at the proximal phalanx.
        groups: (name, springs) whose stiffness has a common parameter.
        central_slip: name of the finger's slip.
        radial_band: likewise.
        ulnar_band: likewise.
        terminal_slip: likewise.
    """

    network: Network
    bones: tuple[int, ...]
    places: tuple[tuple[float, float], ...]
    slide: tuple[tuple[float, float], ...]
    stiffness: tuple[float, ...]
    tether: float
    slips: tuple[str, ...]
    pulls: tuple[tuple[str, int, float, float], ...]
    partial: tuple[str, ...]
    groups: tuple[tuple[str, tuple[int, ...]], ...]
    central_slip: str
    radial_band: str
    ulnar_band: str
    terminal_slip: str

    @property
    def members(self) -> tuple[str, ...]:
        """Every muscle that enters the hood."""
        return tuple(muscle for muscle, *_ in self.pulls)

    @property
    def radial(self) -> tuple[str, ...]:
        """Muscles that enter on the radial side."""
        return tuple(muscle for muscle, node, *_ in self.pulls if self.places[node][1] > 0.0)

    @property
    def ulnar(self) -> tuple[str, ...]:
        """Muscles that enter on the ulnar side."""
        return tuple(muscle for muscle, node, *_ in self.pulls if self.places[node][1] < 0.0)

    @property
    def extensors(self) -> tuple[str, ...]:
        """Muscles that enter on the midline."""
        return tuple(muscle for muscle, node, *_ in self.pulls if self.places[node][1] == 0.0)

    @property
    def fractions(self) -> tuple[str, ...]:
        """Names of its parameters between 0 and 1, in the order of `FingerValues.fraction`.

        `MUSCLE_EM`: the part of a muscle that enters the hood. `k_GROUP`: stiffness of a group of springs, 0.5 as in
        the hood's file, 0 a sixteenth and 1 sixteen times of it. `follow`: how far rest lengths follow the posture, 1
        where the network is unstretched in every posture, 0 where its rest lengths are those of the straight finger.
        """
        return (*(f"{m}_EM" for m in self.partial), *(f"k_{name}" for name, _ in self.groups), "follow")
