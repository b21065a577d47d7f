"""Tests that need no tendon points: what any finger in this rig must obey, however its tendons run.

Each compares measured forces with measured forces. Their differences are held against the noise, the tares that they
share and the errors that the rig's budget allows, in one chi-square with all correlations; what is tried within one
test is paid for by Bonferroni. Identification and validation cases count alike, since nothing is fitted.

Here are the tests by statics; `loads` compares loads with loads.
"""

from __future__ import annotations

import numpy as np

from fingermodel.arrays import Floats
from fingermodel.comparison.observations import Observations
from fingermodel.diagnosis.model_free.answer import Null, Residuals, concluded, count, figure, not_tested, pm
from fingermodel.diagnosis.model_free.budget import Readings
from fingermodel.diagnosis.model_free.frames import mistake_in
from fingermodel.diagnosis.model_free.loads import load_levels, repeats, superposition
from fingermodel.fingers import COMPONENTS
from fingermodel.model import Model

__all__ = ["Null", "nulls"]

STANDARD_GRAVITY = 9.80665


def nulls(model: Model, observations: Observations) -> tuple[Null, ...]:
    """Test what needs no tendon points; the model's joints, its sutures' direction and its budget are used."""
    readings = Readings(model, observations.inputs, observations)
    tests = (balance, fds_no_dip_torque, superposition, load_levels, repeats, moments_closure)
    return tuple(test(readings) for test in tests)


def balance(r: Readings) -> Null:
    """Tip and bone together carry the tendons' pulls, and nothing else."""
    pairs = r.both_ends
    if not pairs:
        return not_tested("balance", "No load was read both at the tip and at the bone in the same posture.")
    first = [bone[0] for _, bone in pairs]
    residual, size = _left_of_pulls(r, pairs)
    rest = residual.value.reshape(-1, 3)
    is_along = np.tile([True, False, False], len(pairs))
    in_proportion = (size[:, None, None] * np.eye(3)).reshape(-1, 3)
    along = residual.along("in proportion along", in_proportion[:, :1])
    across = residual.along("in proportion across", in_proportion[:, 1:])
    parts = (
        residual.all("all"),
        residual.part("along", is_along),
        residual.part("across", ~is_along),
        along.test,
        across.test,
    )
    stated = float(np.mean([r.newton_per_gram(i) for i in first])) / (STANDARD_GRAVITY * 1e-3)
    gain, sd = residual.factor(in_proportion[:, 0])
    lean = np.rad2deg(np.arctan2(float(np.hypot(*across.value)), 1.0 + gain))
    above = int(np.sum(stated * (1.0 + rest[:, 0] / size) > 1.0))
    amount = (
        f"along the metacarpal they carry {pm(100.0 + 100.0 * gain, 100.0 * sd)} % of the stated tensions (friction "
        f"factor c = {pm(stated * (1.0 + gain), stated * sd, 3)}, stated {stated:.3f}); across it "
        f"{figure(float(np.sqrt(np.mean(rest[:, 1:] ** 2))))} N are left (RMS), on average {lean:.1f}° off its axis"
    )
    if above:
        amount += f"; c is above 1 in {above} of {count(len(pairs), 'load')}, which no friction explains"
    mistake = mistake_in(r)
    return concluded(
        r.observations,
        "balance",
        parts,
        f"Tip and bone together balance the tendons' pulls in {count(len(pairs), 'load')}: {amount}.",
        f"Tip and bone do not balance the tendons' pulls in {count(len(pairs), 'load')}: {amount}; worst is "
        f"{r.worst(residual, first, mount=False)}{f'; {mistake.words}' if mistake else ''}.",
        [i for pair in pairs for cases in pair for i in cases],
    )


def _left_of_pulls(r: Readings, pairs: list[tuple[list[int], list[int]]]) -> tuple[Residuals, Floats]:
    """R F_tip + F_bone - Σ t v of each pair: its part along the pulls and two parts across; and ‖Σ t v‖."""
    n, budget = len(r.wrench), r.model.budget
    pull = r.tension[[bone[0] for _, bone in pairs], :, None] * np.asarray(r.model.finger.values.suture)
    total = pull.sum(axis=1)
    size = np.linalg.norm(total, axis=1)
    unit = total / size[:, None]
    # Dorsal and radial for tendons that leave along the metacarpal.
    upright = np.where(np.abs(unit[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[-1.0, 0.0, 0.0]])
    dorsal = np.cross(upright, unit)
    dorsal /= np.linalg.norm(dorsal, axis=1, keepdims=True)
    frame = np.stack([unit, dorsal, np.cross(unit, dorsal)], axis=1)
    weights = np.zeros((len(pairs), 3, n, 6))
    for p, (tip, bone) in enumerate(pairs):
        for i in tip:
            weights[p, :, i, :3] += frame[p] @ r.to_base[i] / len(tip)
        for i in bone:
            weights[p, :, i, :3] += frame[p] / len(bone)
    # Both ends feel the same pulleys, so these errors are those of the pulls.
    errors = np.concatenate([budget.tension_factor_sd * pull, budget.tension_factor_common_sd * total[:, None]], axis=1)
    residual = r.residuals(
        weights.reshape(-1, n, 6),
        (frame @ total[:, :, None]).reshape(-1),
        (frame @ errors.swapaxes(1, 2)).reshape(3 * len(pairs), -1),
    )
    return residual, size


def fds_no_dip_torque(r: Readings) -> Null:
    """FDS ends on the middle phalanx, so alone it turns the DIP joint not at all."""
    name, topology = "fds_no_dip_torque", r.model.finger.topology
    last = topology.joints[-1]
    if "FDS" not in topology.muscles or any(s.slip == "FDS" and s.joint == last.name for s in topology.segments):
        return not_tested(name, "The finger has no FDS that ends before its last joint.")
    alone = [i for i in r.at("tip") if [muscle for muscle, _ in r.masses[i]] == ["FDS"]]
    if not alone:
        return not_tested(name, "FDS was never loaded alone with the cell at the tip.")
    carried = list(topology.reactions)
    cases = [i for i in alone if r.read[i, carried].all()]
    if not cases:
        return not_tested(
            name, f"The tip's moment was not read, and forces alone do not tell the torque about the {last.name}."
        )
    rotation = len(topology.rotations) - len(last.rotations) + max(last.flexion, 0)
    weights = np.zeros((len(cases), len(r.wrench), 6))
    for k, i in enumerate(cases):
        weights[k, i, carried] = r.jacobian[i, carried, rotation]
    residual = r.residuals(weights)
    arm = residual.along("moment arm", r.load[cases, None])
    k, most = residual.worst(1)
    amount = (
        f"{figure(residual.rms)} N mm (RMS of {count(len(cases), 'case')}), as of a moment arm of "
        f"{pm(float(arm.value[0]), float(arm.sd[0]), 2)} mm"
    )
    return concluded(
        r.observations,
        name,
        (residual.all("torque"), arm.test),
        f"FDS alone leaves the {last.name} without torque, as it must: {amount}.",
        f"FDS alone seems to turn the {last.name}, which it does not cross, by {amount}; worst is "
        f"{r.name(cases[k], mount=False)} ({figure(most)} N mm).",
        cases,
    )


def moments_closure(r: Readings) -> Null:
    """The tip clamp swivels: it carries no moment but the model's (Eq 2)."""
    name, carried = "moments_closure", r.model.finger.topology.reactions
    free = [c for c in range(3, 6) if c not in carried]
    if not free:
        return not_tested(name, "The finger's clamp is taken to carry every moment.")
    cases = [i for i in r.at("tip") if r.read[i, 3:].all()]
    if not cases:
        return not_tested(name, "The moments at the tip were not read.")
    weights = np.zeros((len(cases), len(free), len(r.wrench), 6))
    for k, i in enumerate(cases):
        weights[k, np.arange(len(free)), i, free] = 1.0
    residual = r.residuals(weights.reshape(-1, len(r.wrench), 6))
    k, _ = residual.worst(len(free))
    left = residual.unexplained.reshape(-1, len(free))
    names = " and ".join("M" + COMPONENTS[c][1:] for c in free)
    only = ", ".join(("F" if c < 3 else "M") + COMPONENTS[c][1:] for c in carried)
    amount = (
        f"{figure(residual.rms)} N mm (RMS of {count(len(cases), 'case')}), of which the cell's offset and rotation "
        f"within their budget leave {figure(float(np.sqrt(np.mean(left**2))))} N mm unexplained"
    )
    return concluded(
        r.observations,
        name,
        (residual.all("moments"),),
        f"The tip clamp carries {only} only, as the model assumes: {names} are {amount}.",
        f"The tip clamp carries more than {only}, or the cell sits otherwise than its budget allows: {names} are "
        f"{amount}; worst is {r.name(cases[k], mount=False)}.",
        cases,
    )
