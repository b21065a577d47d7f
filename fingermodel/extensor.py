"""How muscle tensions reach the tendon segments, the extensor hood's slips among them.

Whatever the hood is (fixed fractions here, an elastic network in `fingermodel.hood`), it is one function from muscle
tensions, and for an elastic one the posture, to segment tensions.
"""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array

from daq.errors import ModelError
from fingermodel.fingers import FingerValues, Hood, Topology
from fingermodel.hood.parts import ElasticHood
from fingermodel.kinematics import JointPose


def segment_tensions(
    topology: Topology, values: FingerValues, tension: Array, poses: tuple[JointPose, ...] | None = None
) -> Array:
    """Tension of every segment [N] from the muscles' (muscles,) [N].

    Args:
        topology: of the finger.
        values: its numbers.
        tension: (muscles,) [N].
        poses: of `joint_poses`; fixed fractions do without.

    Raises:
        ModelError: an elastic hood without a posture.
    """
    slips = dict(zip(topology.muscles, jnp.asarray(tension), strict=True))
    match topology.hood:
        case Hood():
            slips |= _winslow_rhombus(topology.hood, values, slips)
        case ElasticHood():
            slips |= _elastic_network(topology, values, slips, poses)
    return jnp.stack([slips[segment.slip] for segment in topology.segments])


def _elastic_network(
    topology: Topology, values: FingerValues, muscle: dict[str, Array], poses: tuple[JointPose, ...] | None
) -> dict[str, Array]:
    from fingermodel.hood.sharing import hood_state

    if poses is None:
        raise ModelError(
            "an elastic hood, whose slips have no fixed shares of the muscles' tensions",
            "a finger with fixed fractions",
            "Use a finger with the hood kind winslow_rhombus",
        )
    return hood_state(topology, values, muscle, poses).slips


def _winslow_rhombus(hood: Hood, values: FingerValues, muscle: dict[str, Array]) -> dict[str, Array]:
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
