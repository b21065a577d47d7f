"""What a pulley's bearing loses, by the load that it carries."""

from __future__ import annotations

from jax import Array

# Tension [N] at which a bearing is half way from a light load to a heavy one: assumed, among the lighter weights hung.
LIGHT_N = 2.0


def of_the_load(light: Array, tension: Array) -> Array:
    """How many times the share lost of a heavy load is lost of each tension [N]: 1 + `light` of the very lightest."""
    return 1.0 + light / (1.0 + tension / LIGHT_N)
