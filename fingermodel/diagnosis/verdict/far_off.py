"""What would have to be further off than chance makes it: one error of the rig, one part of the specimen, or all alike.

The multiples of budget and anatomy stand for a rig, and a specimen, that differ throughout, and scatter for cases that
all scatter alike. Where a single part is far off, or all of them by more than is thought possible, something else acts.
"""

from __future__ import annotations

import numpy as np
from scipy.special import fdtrc, ndtr

from fingermodel.arrays import Floats
from fingermodel.diagnosis.posterior.gaussian import Everything
from fingermodel.diagnosis.posterior.hyper import ANATOMY, ANGLE, BUDGET, COMPONENT, DIRECTION, SCATTER
from fingermodel.diagnosis.posterior.optimum import Optimum
from fingermodel.diagnosis.session_model.group_errors import GroupErrors
from fingermodel.diagnosis.settings import P_VALUE
from fingermodel.fitting.reading_errors import OTHER_SCATTER

# Axes whose last value is the most that is thought possible.
_MOST = {
    SCATTER: "scatter of the tensions",
    COMPONENT: OTHER_SCATTER["component"].title,
    DIRECTION: OTHER_SCATTER["direction"].title,
    ANGLE: OTHER_SCATTER["angle_rad"].title,
    BUDGET: "budget",
    ANATOMY: "spread of anatomy",
}
# One chance in twenty is worth a remark: what is so far off should be looked at.
_REMARKED = 0.05
# Readings tell so much of a part of the anatomy at least, in parameters, of which one asks.
_TOLD = 0.5


def far_off(fit: Optimum) -> str:
    """What is said where one error of the rig, or one part of the specimen, is larger than chance makes the largest."""
    found = fit.everything(fit.node)
    return _of_rig(fit, found) or _of_anatomy(fit, found)


def remarkable(fit: Optimum) -> list[str]:
    """What is said of the rig's error that is furthest off, and of the specimen's part, where a verdict stands."""
    found = fit.everything(fit.node)
    return [said for said in (_of_rig(fit, found, _REMARKED), _of_anatomy(fit, found)) if said]


def beyond_priors(fit: Optimum) -> str:
    """What is said where the readings want the most of something that is thought possible."""
    for axis, name in _MOST.items():
        values = fit.hyper.axes[axis].values
        if 0 < len(values) - 1 == fit.best[axis]:
            return f"the readings want the largest {name} that is thought possible, so that something else acts"
    return ""


def _of_rig(fit: Optimum, found: Everything, improbable: float = P_VALUE) -> str:
    table = fit.session.problem.model.parameters
    of_rig = np.flatnonzero(fit.session.problem.free & table.of_kind("budget"))
    off = {f"{table.names[k]} would have to be off by": abs(float(fit.x[k])) for k in of_rig}
    # Of a rig that is worse throughout, one error may be, too.
    chance = {said: 2.0 * ndtr(-times / fit.hyper.values(fit.node).budget) for said, times in off.items()}
    count = len(off)
    # Errors by group may be larger than usual, but no one of them alone.
    usual = GroupErrors.usual(fit.session.model.budget)._asdict()
    for name, span in zip(found.names, fit.spans(found.names), strict=True):
        each = np.abs(found.mean[span])
        if name in usual and each.size:
            where = _in_cases(fit, name, int(np.argmax(each)))
            said = f"one error ({OTHER_SCATTER[name].title}{where}) would have to be"
            off[said] = float(each.max() / usual[name])
            chance[said] = 2.0 * ndtr(-off[said])
            count += each.size
    least = min(chance, key=lambda said: chance[said], default="")
    if not least or chance[least] * count >= improbable:
        return ""
    return f"{least} {off[least]:.3g} times what is stated, or usual"


def _in_cases(fit: Optimum, name: str, column: int) -> str:
    """Cases in which one error by group acts, where they follow one another."""
    session = fit.session
    cases = np.unique(session.rows[session.columns(name)[:, column] != 0.0] // 6)
    if len(cases) < 2 or cases[-1] - cases[0] >= len(cases):
        return ""
    first, last = (session.observations.ids[case] for case in cases[[0, -1]])
    return f", from {first} to {last}"


def _of_anatomy(fit: Optimum, found: Everything) -> str:
    """What is said where one tendon at a joint, or a share of the hood, is far further off than all other parts."""
    table, (index, at) = fit.session.problem.model.parameters, found.parameters
    own = table.of_kind("anatomy")[index]
    multiple, parts = fit.hyper.values(fit.node).anatomy, dict[str, list[int]]()
    for k, place in zip(index[own].tolist(), at[own].tolist(), strict=True):
        parts.setdefault(".".join(table.names[k].split(".")[:3]), []).append(place)
    # Of what the readings do not tell, the prior alone would speak.
    told = np.array([len(p) - np.trace(found.covariance[np.ix_(p, p)]) / multiple**2 for p in parts.values()])
    far = np.array([float((found.mean[p] ** 2).sum()) for p in parts.values()])
    others = told.sum() - told
    asked = (told > _TOLD) & (others > _TOLD)
    if not asked.any():
        return ""
    # A specimen that resembles its file in everything else differs by what is stated all the same.
    usual = np.maximum((far.sum() - far)[asked] / others[asked], 1.0)
    chance = fdtrc(told[asked], others[asked], far[asked] / told[asked] / usual)
    least = int(np.argmin(chance))
    if chance[least] * len(chance) >= P_VALUE:
        return ""
    name = [n for n, is_asked in zip(parts, asked, strict=True) if is_asked][least]
    return f"{_worded(fit, name)} than the rest of the specimen does; look at the finger's file and at the tendon there"


def _worded(fit: Optimum, name: str) -> str:
    """What differs, as a tendon's moment arm where it is one's points."""
    segment, topology = name.removeprefix("point."), fit.session.model.finger.topology
    named = [s.name for s in topology.segments]
    if segment not in named or topology.segments[named.index(segment)].joint not in topology.rotations:
        return f"{name} would have to differ far more from the finger's file"
    k = named.index(segment)
    joint, slip = topology.segments[k].joint, topology.segments[k].slip
    now, stated = (_arm_mm(fit, theta, joint, k) for theta in (fit.theta, fit.session.problem.centre))
    arms = f"a moment arm of {now:.1f} mm instead of {stated:.1f} mm"
    return f"{slip} at the {joint} ({arms}) would have to differ far more from the finger's file"


def _arm_mm(fit: Optimum, theta: Floats, joint: str, segment: int) -> float:
    """Mean moment arm over the session's postures [mm], flexion positive."""
    model = fit.session.model
    row = model.finger.topology.rotations.index(joint)
    postures = fit.session.observations.posture_angles.values()
    return float(np.mean([np.asarray(model.moment_arms(angles, theta))[row, segment] for angles in postures]))
