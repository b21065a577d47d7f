"""Net forces on the metacarpal as vectors, with the MCP joint's load (after Synek et al. 2019, Figure 8)."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from fingermodel.comparison.observations import Observations
from fingermodel.model import Model
from server.figures import graph_objects as go
from server.figures.compared import Compared
from server.figures.vectors import Beside, chosen_cases, forces_figure

Floats = NDArray[np.float64]


def joint_loads(model: Model, observations: Observations, theta: Floats | None = None) -> dict[str, Floats]:
    """Return each case's load of the first joint (3,) [N]: of the child bone on the first bone, in its axes."""
    joint = np.asarray(model.predict(observations.inputs, theta).joint)
    return {case_id: joint[i, 0] for i, case_id in enumerate(observations.ids)}


def bone_figure(compared: Compared, cases: Iterable[str] | None = None, beside: Beside | None = None) -> go.Figure:
    """Draw measured and predicted net bone forces at the MCP joint, and the load that the joint itself carries.

    Args:
        compared: model, session and comparison.
        cases: ids of the cases to draw.
        beside: forces that another model predicts.

    Raises:
        NothingToDrawError: no bone force.
    """
    first = compared.model.finger.topology.joints[0]
    drawn = chosen_cases(compared.comparison, "bone", cases)
    loads = joint_loads(compared.model, compared.observations, compared.theta)
    return forces_figure(
        compared,
        drawn,
        lambda pose: (pose.origins[first.child], np.eye(3)),
        longest=0.75,
        title="Net metacarpal bone forces",
        subtitle="Net force on the metacarpal",
        joint=Beside(f"{first.name} joint load, predicted", loads),
        beside=beside,
    )
