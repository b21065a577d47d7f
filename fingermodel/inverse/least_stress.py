"""Muscle tensions of least summed squared stress among those that pull: a small convex problem, solved exactly.

With s = tension / PCSA the problem is least |s|² with A s = b, s ≥ 0, a least-distance problem, which Lawson and Hanson
(1974, ch. 23) turn into one of non-negative least squares, for which SciPy has the solver.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class LeastStress(NamedTuple):
    """Tensions that hold a torque, or come as near to it as tensions that pull can.

    Attributes:
        tension: (muscles,) [N], none negative.
        unbalanced: (rotations,) [N mm] of the torque that no tensions that pull make; zero where they make all of it.
    """

    tension: Floats
    unbalanced: Floats


def least_stress(arms: Floats, torque: Floats, area: Floats, free: Floats | None = None) -> LeastStress:
    """Share a torque out among muscles.

    Args:
        arms: (rotations, muscles) [mm].
        torque: (rotations,) to be made [N mm].
        area: (muscles,) PCSA, in any one unit.
        free: (k, rotations) torque of a unit of each component of the tip's load that may take any value.
    """
    from scipy.optimize import nnls

    if free is not None and len(free):
        seen = _unreached(free)
        held = least_stress(seen @ arms, seen @ torque, area)
        return LeastStress(held.tension, held.unbalanced @ seen)
    demand = float(np.linalg.norm(torque))
    if demand == 0.0:
        return LeastStress(np.zeros(arms.shape[1]), np.zeros(len(torque)))
    scaled = arms * (area / area.max())
    scaled, b = scaled / np.abs(scaled).max(), torque / demand
    reached, miss = nnls(scaled, b)
    back = (area / area.max()) * demand / np.abs(arms * (area / area.max())).max()
    # Beyond the reach of pulling tensions the nearest torque lies on a face, where the tensions leave no choice.
    if miss > 1e-9:
        return LeastStress(reached * back, demand * (b - scaled @ reached))
    # Tensions of order one: |s| of the answer is 1/|r|, and a small r would lose digits.
    size = max(float(np.linalg.norm(reached)), 1e-12)
    n = scaled.shape[1]
    right = np.zeros(n + 1)
    right[n] = 1.0
    dual = np.vstack([np.hstack([scaled.T, -scaled.T, np.eye(n)]), np.hstack([b / size, -b / size, np.zeros(n)])])
    multiplier, _ = nnls(dual, right)
    r = dual @ multiplier - right
    least = np.maximum(-r[:n] / r[n], 0.0) * size
    return LeastStress(least * back, np.zeros(len(torque)))


def _unreached(free: Floats) -> Floats:
    """Directions of torque (rotations - rank, rotations) that none of the free components makes, orthonormal."""
    _, sizes, directions = np.linalg.svd(free)
    return np.asarray(directions[int((sizes > 1e-9 * sizes.max()).sum()) :])
