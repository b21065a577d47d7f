"""Where the model fails: by muscle, posture, mount, load level and component, and as missing joint torque."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fingermodel.compare import muscles_of
from fingermodel.fingers import COMPONENTS
from fingermodel.model import tips_of
from fingermodel.problems import Problem

Floats = NDArray[np.float64]


def where(problem: Problem, theta: Floats) -> dict[str, Any]:
    """Group the identification cases' residuals of a fitted model.

    Args:
        problem: whose readings count.
        theta: (parameters,) of the model.

    Returns:
        `by_muscle`, `by_posture`, `by_location`, `by_load_level`, `by_component`, `cells` (muscle × posture × mount),
        `joint_torque_Nmm` and `joint_torque_cases`, each with RMSE [N] and RMS of the residual in standard
        uncertainties of the reading.
    """
    observations = problem.observations
    reading = np.asarray(problem.model.predict(observations.inputs, theta).reading)
    residual = np.nan_to_num(observations.wrench) - reading
    variance = np.diagonal(observations.case_covariance, axis1=1, axis2=2)
    fitted = np.zeros(residual.shape, dtype=bool)
    fitted[problem.rows // 6, problem.rows % 6] = True
    used = [i for i in np.unique(problem.rows // 6) if observations.roles[i] == "identification"]

    def summary(cases: Iterable[int], components: Iterable[int] = (0, 1, 2, 5)) -> dict[str, Any]:
        rows = list(cases)
        chosen = np.zeros(residual.shape, dtype=bool)
        chosen[np.ix_(rows, list(components))] = True
        chosen &= fitted
        forces = chosen & (np.arange(6) < 3)
        z2 = residual[chosen] ** 2 / np.maximum(variance[chosen], 1e-18)
        return {
            "cases": len(rows),
            "rmse_N": float(np.sqrt(np.mean(residual[forces] ** 2))) if forces.any() else None,
            "z_rms": float(np.sqrt(np.mean(z2))) if len(z2) else None,
        }

    def grouped(key: Callable[[int], str]) -> dict[str, Any]:
        keys = dict.fromkeys(key(i) for i in used)
        return {k: summary([i for i in used if key(i) == k]) for k in keys}

    masses = observations.masses_g
    levels = _levels(problem, used)
    keys = dict.fromkeys((muscles_of(masses[i]), observations.postures[i], observations.locations[i]) for i in used)
    cells = []
    for muscles, posture, location in keys:
        members = [
            i
            for i in used
            if (muscles_of(masses[i]), observations.postures[i], observations.locations[i])
            == (muscles, posture, location)
        ]
        cells.append({"muscles": muscles, "posture": posture, "location": location} | summary(members))
    per_component = {}
    for c in sorted(set(problem.rows % 6)):
        rows = [i for i in used if fitted[i, c]]
        values = residual[rows, c]
        size = float(np.sqrt(np.mean(values**2))) if rows else None
        z = float(np.sqrt(np.mean(values**2 / np.maximum(variance[rows, c], 1e-18)))) if rows else None
        key = "rmse_N" if c < 3 else "rmse_Nmm"
        per_component[COMPONENTS[c]] = {"cases": len(rows), key: size, "z_rms": z}
    torque, by_case = missing_torque(problem, residual, used)
    return {
        "by_muscle": grouped(lambda i: muscles_of(masses[i])),
        "by_posture": grouped(lambda i: observations.postures[i]),
        "by_location": grouped(lambda i: observations.locations[i]),
        "by_load_level": grouped(lambda i: levels[i]),
        "by_component": per_component,
        "cells": cells,
        "joint_torque_Nmm": torque,
        "joint_torque_cases": by_case,
    }


def _levels(problem: Problem, used: list[int]) -> dict[int, str]:
    """Load of each case as a part of the largest that the same tendons ever carry."""
    masses = problem.observations.masses_g
    total = {i: sum(masses[i].values()) for i in used}
    largest: dict[str, float] = {}
    for i in used:
        key = muscles_of(masses[i])
        largest[key] = max(largest.get(key, 0.0), total[i])
    out = {}
    for i in used:
        share = total[i] / max(largest[muscles_of(masses[i])], 1e-9)
        out[i] = "full load" if share > 0.9 else "half to full" if share > 0.5 else "under half"
    return out


def missing_torque(problem: Problem, residual: Floats, used: list[int]) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Push tip residuals through Jᵀ: the joint torque that the model lacks, case by case.

    Without a measured Mz the torques at the flexion joints are known only up to one common amount; its uncertainty then
    is that of a moment that nobody measured (the mount's offset and the reading's), so the stated uncertainty is large.

    Args:
        problem: whose readings count.
        residual: (n, 6) measured minus predicted [N, N mm].
        used: cases.
    """
    model, observations = problem.model, problem.observations
    topology = model.finger.topology
    tips = [i for i in used if observations.locations[i] == "tip"]
    if not tips:
        return {}, []
    jacobian = np.asarray(tips_of(topology, model.values, observations.inputs).jacobian)[tips]
    reactions = list(topology.reactions)
    cases, squares = [], []
    for row, i in enumerate(tips):
        lever = jacobian[row, reactions].T
        covariance = observations.case_covariance[i][np.ix_(reactions, reactions)].copy()
        change = residual[i, reactions].copy()
        unread = [k for k, c in enumerate(reactions) if not np.isfinite(observations.wrench[i, c])]
        for k in unread:
            change[k] = 0.0
            covariance[k, :] = covariance[:, k] = 0.0
            covariance[k, k] = 50.0**2
        torque = lever @ change
        sd = np.sqrt(np.maximum(np.diag(lever @ np.nan_to_num(covariance) @ lever.T), 0.0))
        squares.append((torque, sd))
        cases.append(
            {
                "id": observations.ids[i],
                "posture": observations.postures[i],
                "muscles": muscles_of(observations.masses_g[i]),
                "torque_Nmm": {n: float(t) for n, t in zip(topology.rotations, torque, strict=True)},
                "sd_Nmm": {n: float(s) for n, s in zip(topology.rotations, sd, strict=True)},
            }
        )
    torques, sds = np.array([t for t, _ in squares]), np.array([s for _, s in squares])
    summary = {
        name: {"rms": float(np.sqrt(np.mean(torques[:, k] ** 2))), "sd": float(np.sqrt(np.mean(sds[:, k] ** 2)))}
        for k, name in enumerate(topology.rotations)
    }
    return summary, cases
