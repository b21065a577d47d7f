"""Whether the cases that were never fitted come out as a fitted model says, within what it cannot know of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from fingermodel.compare import muscles_of
from fingermodel.diagnosis.fitted import Fitted

Floats = NDArray[np.float64]

DRAWS = 64
SEED = 20191107
# One chance in ten thousand, for all cases together.
SURPRISING = 1e-4


@dataclass(frozen=True)
class HeldOut:
    """The case that a model predicts worst.

    Attributes:
        p_value: that any case would be missed so far, all of them paid for.
        text: which case, and by how much; empty where there is none.
    """

    p_value: float
    text: str

    @property
    def surprising(self) -> bool:
        """Whether noise and what the fit leaves open do not explain it."""
        return self.p_value < SURPRISING


def held_out(fitted: Fitted, budget_factor: float) -> HeldOut:
    """Hold the validation cases' forces against an optimum's predictive distribution.

    Args:
        fitted: an explanation's optimum.
        budget_factor: most probable multiple of the budget.
    """
    problem = fitted.problem
    observations, model = problem.observations, problem.model
    cases = [i for i in observations.where("validation") if np.isfinite(observations.wrench[i, :3]).all()]
    if not cases:
        return HeldOut(1.0, "")
    plane = 2 if model.finger.judged_in == "sagittal" else 3
    draws = fitted.draws(DRAWS, np.random.default_rng(SEED), budget_factor)
    here = np.asarray(model.predict(observations.inputs, fitted.theta).reading)[cases][:, :plane]
    spread = np.zeros((DRAWS, len(cases), plane))
    for d, theta in enumerate(draws):
        spread[d] = np.asarray(model.predict(observations.inputs, theta).reading)[cases][:, :plane] - here
    covariance = np.einsum("dni,dnj->nij", spread, spread) / DRAWS
    noise = observations.case_covariance[cases][:, :plane, :plane]
    scatter = model.budget.tension_factor_case_sd
    force = observations.wrench[cases][:, :plane]
    noise = noise + scatter**2 * np.einsum("ni,nj->nij", force, force)
    away = force - here
    z2 = np.array([a @ np.linalg.solve(c, a) for a, c in zip(away, covariance + noise, strict=True)])
    worst = int(np.argmax(z2))
    p_value = min(1.0, len(cases) * float(chdtrc(plane, z2[worst])))
    i = cases[worst]
    load = f"{muscles_of(observations.masses_g[i])} in {observations.postures[i]} at the {observations.locations[i]}"
    text = f"{load}, never fitted, is missed by {float(np.linalg.norm(away[worst])):.2f} N"
    return HeldOut(p_value, text)
