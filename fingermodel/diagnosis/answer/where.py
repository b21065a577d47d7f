"""Where the model fails: by muscle, posture, mount, load level and component, and as missing joint torque."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import Any

import numpy as np

from fingermodel.arrays import Floats
from fingermodel.comparison.comparison import compare, muscles_of, rmse, summarise
from fingermodel.diagnosis.verdict.instruments import rig_remedy
from fingermodel.fingers import COMPONENTS, PLANES
from fingermodel.fitting.problems import Problem
from fingermodel.model import tip_kinematics_batch

# Parameters of the budget that are told, from so many of their stated widths on.
BENT = 2.0
# How large a moment may be that was not read.
_UNREAD_NMM = 50.0


def where(problem: Problem, theta: Floats, apart: Collection[int] = ()) -> dict[str, Any]:
    """Group the identification cases' residuals after a fit, each as a comparison of that fit has it.

    Args:
        problem: whose readings count.
        theta: (parameters,) of the fit.
        apart: cases that do not count, by their indices.

    Returns:
        `by_muscle`, `by_posture`, `by_location`, `by_load_level`, `cells` (muscle × posture × mount), each with RMSE
        [N] of the force components and the root mean square of its cases' z, in the plane that the finger is judged
        in; `by_component`, with z of the component alone; `joint_torque_Nmm` and `joint_torque_cases`; and `bent`.
    """
    observations, plane = problem.observations, problem.model.finger.judged_in
    compared = {c.id: c for c in compare(problem.model, observations, theta).cases}
    used = [i for i in np.unique(problem.rows // 6) if observations.roles[i] == "identification" and i not in apart]

    def summary(cases: Sequence[int]) -> dict[str, Any]:
        rows = [compared[observations.ids[i]] for i in cases]
        z2 = [z**2 for c in rows if (z := c.z_in(plane)) is not None]
        size = summarise(rows, PLANES[plane]).rmse_N
        return {"cases": len(rows), "rmse_N": size, "z_rms": float(np.sqrt(np.mean(z2))) if z2 else None}

    def grouped(key: Callable[[int], Any]) -> dict[Any, Any]:
        return {k: summary([i for i in used if key(i) == k]) for k in dict.fromkeys(key(i) for i in used)}

    masses = observations.masses_g
    levels = _levels(problem, used)
    cells = grouped(lambda i: (muscles_of(masses[i]), observations.postures[i], observations.locations[i]))
    residual = np.nan_to_num(observations.wrench) - np.asarray(
        problem.model.predict(observations.inputs, theta).reading
    )
    torque, by_case = missing_torque(problem, residual, used)
    return {
        "by_muscle": grouped(lambda i: muscles_of(masses[i])),
        "by_posture": grouped(lambda i: observations.postures[i]),
        "by_location": grouped(lambda i: observations.locations[i]),
        "by_load_level": grouped(lambda i: levels[i]),
        "by_component": _by_component(problem, residual, used),
        "cells": [{"muscles": m, "posture": p, "location": at} | found for (m, p, at), found in cells.items()],
        "joint_torque_Nmm": torque,
        "joint_torque_cases": by_case,
        "bent": bent(problem, theta),
    }


def bent(problem: Problem, theta: Floats) -> list[dict[str, Any]]:
    """Errors of the rig that a fit takes to be more than two of their stated widths, the most bent first.

    Args:
        problem: with the budget as it is stated.
        theta: (parameters,) of the fit.

    Returns:
        of each its `name`, `value` with `unit`, its `stated_sd`, the `widths` that it lies from its null, and as
        `remedy` what measurement would settle it.
    """
    table = problem.model.parameters
    found = []
    for i in np.flatnonzero(table.of_kind("budget") & (table.sd > 0.0)):
        widths = float((theta[i] - table.initial[i]) / table.sd[i])
        if abs(widths) > BENT:
            row = {"name": table.names[i], "value": float(theta[i]), "unit": table.parameters[i].unit}
            row |= {"stated_sd": float(table.sd[i]), "widths": widths, "remedy": rig_remedy(table.names[i])}
            found.append(row)
    return sorted(found, key=lambda row: -abs(row["widths"]))


def _by_component(problem: Problem, residual: Floats, used: Sequence[int]) -> dict[str, Any]:
    variance = np.diagonal(problem.observations.case_covariance, axis1=1, axis2=2)
    out = {}
    for c in sorted(set(problem.rows % 6)):
        rows = [i for i in used if i * 6 + c in set(problem.rows)]
        values = residual[rows, c]
        size = rmse(values) if rows else None
        z = float(np.sqrt(np.mean(values**2 / np.maximum(variance[rows, c], 1e-18)))) if rows else None
        key = "rmse_N" if c < 3 else "rmse_Nmm"
        out[COMPONENTS[c]] = {"cases": len(rows), key: size, "z_rms": z}
    return out


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
    jacobian = np.asarray(tip_kinematics_batch(topology, model.values, observations.inputs.posture).jacobian)
    of_tips = np.ix_(tips, topology.reactions)
    lever, read = jacobian[of_tips].swapaxes(1, 2), np.isfinite(observations.wrench[of_tips])
    covariance = np.nan_to_num(observations.case_covariance[np.ix_(tips, topology.reactions, topology.reactions)])
    covariance *= read[:, :, None] & read[:, None, :]
    covariance += (_UNREAD_NMM**2 * ~read)[:, :, None] * np.eye(len(topology.reactions))
    torque = (lever @ np.where(read, residual[of_tips], 0.0)[:, :, None])[..., 0]
    variance = np.maximum(np.diagonal(lever @ covariance @ lever.swapaxes(1, 2), axis1=1, axis2=2), 0.0)
    cases = [
        {
            "id": observations.ids[i],
            "posture": observations.postures[i],
            "muscles": muscles_of(observations.masses_g[i]),
            "torque_Nmm": dict(zip(topology.rotations, of_case, strict=True)),
            "sd_Nmm": dict(zip(topology.rotations, sd, strict=True)),
        }
        for i, of_case, sd in zip(tips, torque.tolist(), np.sqrt(variance).tolist(), strict=True)
    ]
    rms, sds = (np.sqrt(squares.mean(axis=0)).tolist() for squares in (torque**2, variance))
    each = zip(topology.rotations, rms, sds, strict=True)
    return {name: {"rms": own, "sd": sd} for name, own, sd in each}, cases
