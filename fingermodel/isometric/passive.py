"""Torques that joints have without any muscle: ligaments, capsule, skin."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from fingermodel.fingers import Finger

Floats = NDArray[np.float64]


class PassiveTorques(NamedTuple):
    """A spring and two exponentials about every rotation, (rotations,) each; zeros where there are none.

    Attributes:
        stiffness: [N mm/rad].
        rest: [rad].
        extension: what resists extension, one growth beyond `extension_from` [N mm].
        extension_rate: [1/rad].
        extension_from: angle below which it acts [rad].
        flexion: likewise against flexion [N mm].
        flexion_rate: [1/rad].
        flexion_from: angle above which it acts [rad].
    """

    stiffness: Array | Floats
    rest: Array | Floats
    extension: Array | Floats
    extension_rate: Array | Floats
    extension_from: Array | Floats
    flexion: Array | Floats
    flexion_rate: Array | Floats
    flexion_from: Array | Floats


def read_passive(finger: Finger) -> PassiveTorques:
    """Passive torques of a finger, from its file."""
    rotations = finger.topology.rotations
    values = {name: np.zeros(len(rotations)) for name in PassiveTorques._fields}
    for block in finger.document.get("passive", []):
        at = rotations.index(block["rotation"])
        if block["kind"] == "linear":
            values["stiffness"][at] = block["stiffness_Nmm_per_rad"]
            values["rest"][at] = np.deg2rad(block.get("rest_deg", 0.0))
            continue
        for way in ("extension", "flexion"):
            values[way][at] = block[f"{way}_Nmm"]
            values[f"{way}_rate"][at] = block[f"{way}_per_rad"]
            values[f"{way}_from"][at] = np.deg2rad(block[f"{way}_from_deg"])
    return PassiveTorques(**values)


def passive_torque(passive: PassiveTorques, posture: Array) -> Array:
    """Torque about every rotation in a posture (rotations,) [rad]: (rotations,) [N mm], flexion positive."""
    spring = passive.stiffness * (passive.rest - posture)
    stretched = jnp.expm1(passive.extension_rate * jnp.maximum(passive.extension_from - posture, 0.0))
    bent = jnp.expm1(passive.flexion_rate * jnp.maximum(posture - passive.flexion_from, 0.0))
    return jnp.asarray(spring + passive.extension * stretched - passive.flexion * bent)
