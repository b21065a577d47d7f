"""How large a finding is: in newtons, and as a function of load and posture, with a band."""

from __future__ import annotations

from typing import Any

import numpy as np

from fingermodel.diagnosis.diagnose import Diagnosis
from fingermodel.diagnosis.next_cases.next_cases import PlannedReading, inputs_of, largest_loads
from fingermodel.diagnosis.session_model.reading_changes import CaseChanges
from fingermodel.fitting.identification import SEED
from fingermodel.fitting.roots import root_of

_DRAWS, _LEVELS = 24, (0.25, 0.5, 0.75, 1.0)


def effect_size(d: Diagnosis) -> dict[str, Any]:
    """Change of the force [N] that a finding makes under each tendon alone: by posture, mount and load.

    Returns:
        `curves`: for each posture, mount and tendon the loads [g], the change's norm [N], and its 95 % band.
    """
    fit, session = d.best, d.session
    observations, model = session.observations, session.model
    set_up = zip(observations.postures, observations.locations, strict=True)
    places = dict.fromkeys((posture, location) for posture, location in set_up if posture)
    cases = [
        PlannedReading(posture, location, {muscle: mass * level})
        for posture, location in places
        for muscle, mass in largest_loads(observations).items()
        for level in _LEVELS
    ]
    theta, covariance, index = fit.parameter_posterior(fit.best)
    own = list(fit.explanation.parameters)
    at = np.flatnonzero(np.isin(index, own))
    rng = np.random.default_rng(SEED)
    drawn = rng.normal(size=(_DRAWS, len(at))) @ root_of(covariance[np.ix_(at, at)]).T
    table, scale = model.parameters, session.problem.scale
    vectors = [theta]
    for draw in drawn:
        moved = theta.copy()
        moved[index[at]] += draw * scale[index[at]]
        vectors.append(np.clip(moved, table.lower, table.upper))
    planned, changes = CaseChanges(model, inputs_of(d, cases)), np.zeros((len(vectors), len(cases)))
    for k, vector in enumerate(vectors):
        without = vector.copy()
        without[own] = table.initial[own]
        change = planned.readings(vector) - planned.readings(without)
        changes[k] = np.linalg.norm(change[:, :3], axis=1)
    low, high = np.quantile(changes[1:], [0.025, 0.975], axis=0)
    levels = len(_LEVELS)
    return {
        "curves": [
            {
                "posture": cases[k].posture,
                "location": cases[k].location,
                "muscle": next(iter(cases[k].masses_g)),
                "load_g": [next(iter(c.masses_g.values())) for c in cases[k : k + levels]],
                "change_N": changes[0, k : k + levels].tolist(),
                "low_N": low[k : k + levels].tolist(),
                "high_N": high[k : k + levels].tolist(),
            }
            for k in range(0, len(cases), levels)
        ]
    }
