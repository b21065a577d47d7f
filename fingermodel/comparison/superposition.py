"""What single tendons promise for several together: measured forces added up, with no model of the tendons at all.

Where superposition fails, no linear model that was fitted to single tendons can be right: it is the floor that a
refit is held against.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fingermodel.comparison.comparison import Comparison
from fingermodel.comparison.observations import Observations
from fingermodel.model import Model, jax_values, tip_kinematics_batch

Floats = NDArray[np.float64]


def superposition(model: Model, observations: Observations, comparison: Comparison) -> Comparison:
    """Replace every prediction by the sum of single-tendon forces measured in the same posture.

    Args:
        model: gives postures their orientation, and nothing else.
        observations: of the session.
        comparison: of the same session; its measured forces are added up.

    Returns:
        Only the cases of several tendons, each of which was also loaded alone at the tip in that posture. Forces are in
        proportion to the hung mass; at the bone, tensions less the tip force turned into the bone's axes.
    """
    tension = np.asarray(observations.inputs.tension)
    index = {case_id: i for i, case_id in enumerate(observations.ids)}
    per_tension: dict[tuple[str, str], list[Floats]] = defaultdict(list)
    for case in comparison.cases:
        if case.role == "identification" and case.location == "tip" and "+" not in case.muscles and case.masses_g:
            total = tension[index[case.id]].sum()
            if total > 0:
                per_tension[case.posture, case.muscles].append(case.measured_N / total)
    finger = model.finger
    tips = tip_kinematics_batch(finger.topology, jax_values(finger.values), observations.inputs.posture)
    to_base = np.asarray(tips.to_base)
    out = []
    muscles = model.finger.topology.muscles
    for case in comparison.cases:
        loaded = [m for m, mass in case.masses_g.items() if mass]
        if len(loaded) < 2 or not all((case.posture, m) in per_tension for m in loaded):
            continue
        i = index[case.id]
        tip = sum(
            (np.mean(per_tension[case.posture, m], axis=0) * tension[i, muscles.index(m)] for m in loaded), np.zeros(3)
        )
        if case.location == "bone":
            tip = tension[i] @ np.asarray(model.finger.values.suture) - to_base[i] @ tip
        out.append(replace(case, predicted_N=tip, predicted_Nmm=None, z=None, z_sagittal=None))
    return Comparison(tuple(out), comparison.noise_assumed)
