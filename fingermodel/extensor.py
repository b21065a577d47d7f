"""How muscle tensions reach the tendon segments, the extensor hood's slips among them.

Whatever the hood is (fixed fractions here, an elastic network elsewhere), it is one function from muscle tensions to
segment tensions.
"""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array

from fingermodel.fingers import FingerValues, Topology


def segment_tensions(topology: Topology, values: FingerValues, tension: Array) -> Array:
    """Tension of every segment [N] from the muscles' (muscles,) [N]."""
    slips = dict(zip(topology.muscles, jnp.asarray(tension), strict=True))
    if topology.hood is not None:
        slips |= _winslow_rhombus(topology, values, slips)
    return jnp.stack([slips[segment.slip] for segment in topology.segments])


def _winslow_rhombus(topology: Topology, values: FingerValues, muscle: dict[str, Array]) -> dict[str, Array]:
    hood = topology.hood
    assert hood is not None  # noqa: S101 - the caller has looked
    fraction = dict(zip(hood.fractions, jnp.asarray(values.fraction), strict=True))
    enters = {m: muscle[m] * fraction.get(f"{m}_EM", 1.0) for m in hood.members}
    central = {m: enters[m] * fraction[f"{m}_ES"] for m in hood.members}
    rest = {m: enters[m] - central[m] for m in hood.members}
    half = 0.5 * sum((rest[m] for m in hood.extensors), jnp.zeros(()))
    radial = sum((rest[m] for m in hood.radial), half)
    ulnar = sum((rest[m] for m in hood.ulnar), half)
    return {
        hood.central_slip: sum(central.values(), jnp.zeros(())),
        hood.radial_band: radial,
        hood.ulnar_band: ulnar,
        hood.terminal_slip: radial + ulnar,
    }
