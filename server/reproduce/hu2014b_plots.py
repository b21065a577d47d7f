"""Figures of hu2014b: the network in the three postures, and its forces beside the printed ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from server.figures.hood import NetworkPanel, forces_figure, network_figure
from server.figures.plot import Plot
from server.reproduce.hu2014b_network import (
    Floats,
    Held,
    hood_of,
    index_with_network,
    mended,
    printed_loads,
)
from server.reproduce.printed import reference

# How far from the bones' axes the network is drawn, and how much of the metacarpal [mm]; the paper prints neither.
_OFF, _METACARPAL = 7.0, 22.0


def plots(held: Sequence[Held]) -> list[Plot]:
    """Draw the network and its forces."""
    finger = index_with_network()
    hood = hood_of(finger)
    network = hood.network
    lengths = {k: float(v) for k, v in finger.phalanx_lengths_mm().items()}
    loads = {load["name"]: load for load in printed_loads()}
    panels = []
    for k, one in enumerate(held):
        bones, side = _from_the_side(hood.bones, one, loads[one.name], [lengths["PP"], lengths["MP"]])
        title = f"Posture {k + 1} ({one.name}), pressing with {one.size_N:.1f} N"
        panels.append(NetworkPanel(title, one.home_mm, one.moved_mm, one.force_N, bones, side))
    joints = {"PIP": -lengths["PP"], "DIP": -lengths["PP"] - lengths["MP"]}
    return [
        Plot(
            "hood-network",
            "The network in the three postures",
            network_figure(panels, network.nodes, network.springs, network.ends, joints),
            "From the side, the network is drawn 7 mm off the bones' axes; the paper prints no positions.",
        ),
        Plot(
            "hood-forces",
            "Forces of the springs",
            forces_figure(
                [p.title for p in panels],
                network.springs,
                [[mended(one.name, s)[1] for s in network.springs] for one in held],
                [one.force_N for one in held],
                [one.force_within_N for one in held],
            ),
            "Whiskers: what half a digit of Table 1's muscle forces allows. EOE of posture 1 is drawn as mended, 78 N.",
        ),
    ]


def _from_the_side(
    bone_of: Sequence[int], held: Held, load: Mapping[str, Any], lengths: Sequence[float]
) -> tuple[Floats, Floats]:
    """Return the bones' axes from the tip on and the nodes under load, in the room's X and Y [mm]."""
    angle = np.deg2rad(np.array(load["theta_deg"], dtype=float))
    proximal = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    dorsal = np.stack([-proximal[:, 1], proximal[:, 0]], axis=1)
    steps = np.array([reference("hu2014a")["distal_phalanx_mm"], lengths[1], lengths[0], _METACARPAL])
    bones = np.concatenate([np.zeros((1, 2)), np.cumsum(proximal * steps[:, None], axis=0)])
    # Of each bone from DP to MC: its proximal joint in the room, and on the straight finger.
    straight = {3: -lengths[0] - lengths[1], 2: -lengths[0], 1: 0.0}
    side = []
    for bone, (along, around) in zip(bone_of, held.home_mm + held.moved_mm, strict=True):
        k = 3 - bone
        turn = around / (2.0 * _OFF)
        side.append(bones[k + 1] + (along - straight[bone]) * proximal[k] + _OFF * np.cos(turn) * dorsal[k])
    return bones, np.array(side)
