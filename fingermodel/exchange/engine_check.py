"""Moment arms of an imported finger held against those that the engine itself gives its file."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fingermodel.exchange.arm_formulas import formula_arms
from fingermodel.exchange.described import EngineCheck, Imported
from fingermodel.exchange.joint_heads import FLEXION_RANGE, NOTHING_MM, OTHER_RANGE, flexions
from fingermodel.exchange.writing import segment_names, upwards

Floats = NDArray[np.float64]
# Of an engine: rotations, tendons, postures (n, rotations) [rad] to moment arms (n, rotations, tendons) [mm].
Asked = Callable[[Sequence[str], Sequence[str], Floats], Floats]
_POSTURES, _STEPS = 200, 60


def held_against(imported: Imported, engine: str, asked: Asked) -> Imported:
    """Add what the engine says: the worst error of every tendon's moment arms, and a note of each that is off.

    Args:
        imported: finger.
        engine: its name and version.
        asked: gives the engine's moment arms.
    """
    finger, ours = imported.finger, imported.ours
    topology = finger.topology
    slips = segment_names(finger) if ours else tuple(s.slip for s in topology.segments)
    tendons = list(dict.fromkeys(slips))
    bends = flexions(finger)
    low, high = (np.where(bends, a, b) for a, b in zip(FLEXION_RANGE, OTHER_RANGE, strict=True))
    # One angle after the other too: where a path changes sides is found by small steps only.
    swept = [np.eye(len(low))[i] * angle for i in range(len(low)) for angle in np.linspace(low[i], high[i], _STEPS)]
    drawn = np.random.default_rng(0).uniform(low, high, (_POSTURES, len(low)))
    postures = np.concatenate([swept, drawn])
    whole = np.array([[slip == name for name in tendons] for slip in slips], dtype=float)
    apart = np.abs(asked(topology.rotations, tendons, postures) - formula_arms(finger, postures) @ whole)
    worst = {name: float(x) for name, x in zip(tendons, apart.max(axis=(0, 1)), strict=True)}
    low_deg, high_deg, other_deg = (round(math.degrees(x)) for x in (*FLEXION_RANGE, OTHER_RANGE[1]))
    over = f"flexion {low_deg}° to {high_deg}°, other angles within ±{other_deg}°"
    notes = [
        f"{name}: its moment arms differ from {engine}'s by up to {upwards(error)} mm, most about "
        f"{topology.rotations[int(np.argmax(apart[:, :, i].max(axis=0)))]} ({over})"
        for i, (name, error) in enumerate(worst.items())
        if error > NOTHING_MM and not ours
    ]
    check = EngineCheck(engine, worst, len(postures), over)
    return replace(imported, notes=(*imported.notes, *notes), check=check)
