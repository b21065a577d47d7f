"""How much of a muscle's tension each segment carries, for software that knows no hood."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from fingermodel.extensor import segment_tensions
from fingermodel.fingers import Finger
from fingermodel.hood.parts import ElasticHood
from fingermodel.model import jax_values

Floats = NDArray[np.float64]


UNSHARED = (
    "The shares of an elastic hood hang on load and posture, which no such file can say: every segment is driven by "
    "its own tension, which `fingermodel.extensor.segment_tensions` gives"
)


def segment_shares(finger: Finger) -> Floats | None:
    """Tension of every segment per tension of every muscle: (segments, muscles); None where it is no fixed share."""
    if isinstance(finger.topology.hood, ElasticHood):
        return None
    values = jax_values(finger.values)
    columns = [
        segment_tensions(finger.topology, values, jnp.asarray(row)) for row in np.eye(len(finger.topology.muscles))
    ]
    return np.array([np.asarray(column) for column in columns]).reshape(len(columns), -1).T
