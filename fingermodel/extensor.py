"""How muscle tensions reach the tendon segments, the extensor hood's slips among them.

Whatever the hood is (fixed fractions here, an elastic network in `fingermodel.hood`), it is one function from muscle
tensions, and for an elastic one the posture, to segment tensions.
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from daq.errors import ModelError
from fingermodel.fingers import Array as AnyArray
from fingermodel.fingers import FingerValues, Hood, Topology
from fingermodel.hood.parts import ElasticHood
from fingermodel.kinematics import JointPose
from fingermodel.rows import spread


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
    if isinstance(topology.hood, Hood):
        return jnp.asarray(_winslow_rhombus(topology, topology.hood, values, tension))
    slips = dict(zip(topology.muscles, jnp.asarray(tension), strict=True))
    if isinstance(topology.hood, ElasticHood):
        slips |= _elastic_network(topology, values, slips, poses)
    return jnp.stack([slips[segment.slip] for segment in topology.segments])


def shares(topology: Topology, values: FingerValues) -> NDArray[np.float64]:
    """Tension of every segment for 1 N of each muscle: (segments, muscles), of a hood with fixed fractions or none."""
    if isinstance(topology.hood, Hood):
        fixed = values._replace(fraction=np.asarray(values.fraction))
        return np.asarray(_winslow_rhombus(topology, topology.hood, fixed, np.eye(len(topology.muscles))))
    return spread([topology.muscles.index(s.slip) for s in topology.segments], len(topology.muscles))


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


def _winslow_rhombus(topology: Topology, hood: Hood, values: FingerValues, tension: AnyArray) -> AnyArray:
    """Segment tensions (segments, …) of a hood with fixed fractions, as products with constants.

    A hundred operations on single numbers would each be compiled, and differentiated, by itself.
    """
    fraction, count = values.fraction, len(hood.members)
    partly = np.array([[float(m == p) for p in hood.partial] for m in hood.members]).reshape(count, -1)
    entering = spread([topology.muscles.index(m) for m in hood.members], len(topology.muscles))
    enters = ((entering @ tension).T * (partly @ fraction[count:] + (1.0 - partly.sum(axis=1)))).T
    central = (enters.T * fraction[:count]).T
    radial, ulnar = (
        np.array([0.5 * (m in hood.extensors) + float(m in side) for m in hood.members])
        for side in (hood.radial, hood.ulnar)
    )
    none = np.zeros(count)
    of_rest = {hood.radial_band: radial, hood.ulnar_band: ulnar, hood.terminal_slip: radial + ulnar}
    slips = [segment.slip for segment in topology.segments]
    hooded = (*of_rest, hood.central_slip)
    directly = np.array([[float(s == m and s not in hooded) for m in topology.muscles] for s in slips])
    to_central = np.array([np.full(count, float(s == hood.central_slip)) for s in slips])
    to_rest = np.array([of_rest.get(s, none) for s in slips])
    shared = np.concatenate([directly, to_central, to_rest], axis=1)
    return shared @ jnp.concatenate([tension, central, enters - central])
