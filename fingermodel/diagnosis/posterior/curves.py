"""Smooth curves beside all that acts: an error of moment arms, tensions or forces, of each tendon, over postures.

A session says of a curve's weights what its readings do, as a quadratic whose value is that without the curve; what
several sessions say of the same weights adds up.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy.special import logsumexp

from fingermodel.arrays import Floats, Ints
from fingermodel.diagnosis.posterior.gaussian import Quadratic
from fingermodel.diagnosis.posterior.hyper import Node
from fingermodel.diagnosis.posterior.optimum import Optimum
from fingermodel.diagnosis.session_model.discrepancy import smooth_over

Stage = Literal["arms", "tension", "force"]
STAGES: tuple[Stage, ...] = ("arms", "tension", "force")
UNITS: dict[Stage, str] = {"arms": "mm", "tension": "1", "force": "N"}
WHAT: dict[Stage, str] = {"arms": "moment arms", "tension": "tensions", "force": "forces"}
# Sizes of a curve: error of a moment arm, a tension, a force at the largest load; each is as probable as any other.
SIZES: dict[Stage, tuple[float, ...]] = {
    "arms": (0.25, 0.5, 1.0, 2.0, 4.0),
    "tension": (0.01, 0.02, 0.04, 0.08, 0.16),
    "force": (0.01, 0.02, 0.04, 0.08, 0.16),
}
# Smallest variance of a posture's feature that is kept, of a largest of 1 a posture.
_LEAST_FEATURE = 1e-3


def gain(said: Sequence[Quadratic], size: float, kept: Ints | None = None) -> float:
    """Log evidence that weights of a size add to what some sessions say, all other things integrated out.

    Args:
        said: by each session.
        size: of the weights, in their unit.
        kept: indices of the weights that may act; by default all.
    """
    if not said:
        return 0.0
    whole = Quadratic.of_all(said)
    widths = np.zeros(len(whole.gradient))
    widths[slice(None) if kept is None else kept] = size
    return whole.freed(widths, np.zeros(len(widths)), 0).log_evidence + 0.5 * whole.value


@dataclass(frozen=True, eq=False)
class Curve:
    """Columns by which a shared curve changes a session's readings."""

    stage: Stage  # at which it acts
    parts: tuple[tuple[str, str], ...]  # (tendon, joint or mount and axis) of each group of weights
    columns: Floats  # (fitted readings, weights) [N, N mm] per unit; groups one after another, features within


class Curves:
    """The curves of several sessions, over all their postures, beside whatever is known to act in each by itself."""

    def __init__(self, fits: Sequence[Optimum]) -> None:
        self._fits = fits
        angles = np.concatenate([np.array(list(f.session.observations.posture_angles.values())) for f in fits])
        self.postures: Floats = np.unique(angles.round(6), axis=0)
        root = smooth_over(self.postures)
        strong = (root**2).sum(axis=0) > _LEAST_FEATURE
        self.root: Floats = root[:, strong]
        self.rotations: tuple[str, ...] = tuple(fits[0].session.model.finger.topology.rotations)

    def at(self, fit: Optimum) -> Floats:
        """(cases, features) of each case's posture; 0 for a check."""
        observations = fit.session.observations
        angles = np.asarray(observations.inputs.posture).round(6)
        place = np.argmin(((angles[:, None, :] - self.postures) ** 2).sum(axis=2), axis=1)
        loaded = np.array([bool(p) for p in observations.postures])
        return np.where(loaded[:, None], self.root[place], 0.0)

    def of(self, fit: Optimum, stage: Stage) -> Curve:
        """The columns of one session."""
        session, features = fit.session, self.at(fit)
        rows, of_parts = session.rows[session.fitted], dict(_unit_changes(fit, stage))
        columns = [change.reshape(-1)[rows, None] * features[rows // 6] for change in of_parts.values()]
        return Curve(stage, tuple(of_parts), np.concatenate(columns, axis=1))


def _unit_changes(fit: Optimum, stage: Stage) -> Iterator[tuple[tuple[str, str], Floats]]:
    """Change (cases, 6) of all readings per unit of each tendon's error: 1 mm of an arm, all of a tension, 1 N."""
    session = fit.session
    topology, inputs = session.model.finger.topology, session.observations.inputs
    tension = np.asarray(inputs.tension)
    share = tension / np.maximum(tension.max(axis=0), 1e-9)
    if stage == "arms":
        answer = session.changes.torque_answer
        for k, muscle in enumerate(topology.muscles):
            for joint in topology.joints:
                if joint.flexion >= 0:
                    row = topology.rotations.index(joint.rotations[joint.flexion])
                    yield (muscle, joint.name), answer[:, row] * tension[:, [k]]
    elif stage == "tension":
        by_tension = session.changes.by_tension(fit.theta)
        for k, muscle in enumerate(topology.muscles):
            yield (muscle, ""), by_tension[:, :, k]
    else:
        at_bone, loaded = np.asarray(inputs.at_bone), np.array([bool(p) for p in session.observations.postures])
        axes = "xy" if session.plane == "sagittal" else "xyz"
        for k, muscle in enumerate(topology.muscles):
            for place, here in (("tip", ~at_bone & loaded), ("bone", at_bone)):
                for axis, name in enumerate(axes):
                    change = np.zeros((len(tension), 6))
                    change[:, axis] = share[:, k] * here
                    yield (muscle, f"{place} {name}"), change


@dataclass(frozen=True, eq=False)
class SmoothCurve:
    """A curve at one stage, as readings have it."""

    stage: Stage  # moment arms [mm], tensions [relative] or forces [N]
    parts: tuple[tuple[str, str], ...]  # tendon, and joint or mount and axis, of each of its groups
    size: float  # likeliest amplitude, in the stage's unit
    log_evidence: float  # that it acts, over what else explains the readings
    log_evidence_lost: Floats  # (parts,) without each group
    postures: Floats  # (postures, rotations) [rad]
    rotations: tuple[str, ...]  # names of the rotations
    mean: Floats  # (parts, postures), in the stage's unit
    sd: Floats  # (parts, postures)

    @property
    def where(self) -> str:
        """The two groups that carry most of it, in words."""
        most = [self.parts[i] for i in np.argsort(-self.log_evidence_lost)[:2]]
        return " and ".join(f"{m} {'at' if self.stage != 'tension' else ''} {part}".strip() for m, part in most)

    def carriers(self) -> list[dict[str, Any]]:
        """Groups without which evidence is lost, the most needed first."""
        return [
            {"muscle": self.parts[i][0], "joint": self.parts[i][1], "log_evidence_lost": float(lost)}
            for i, lost in sorted(enumerate(self.log_evidence_lost.tolist()), key=lambda p: -p[1])
            if lost > 0.0
        ]

    def as_dict(self) -> dict[str, Any]:
        """As an answer gives it."""
        return {
            "stage": self.stage,
            "unit": UNITS[self.stage],
            "size": self.size,
            "postures_deg": [
                dict(zip(self.rotations, angles, strict=True)) for angles in np.rad2deg(self.postures).round(3).tolist()
            ],
            "parts": [
                {
                    "muscle": muscle,
                    "joint": joint,
                    "log_evidence_lost": float(self.log_evidence_lost[i]),
                    "mean": self.mean[i].tolist(),
                    "sd": self.sd[i].tolist(),
                }
                for i, (muscle, joint) in enumerate(self.parts)
            ],
        }


def values_of(curves: Curves, said: Sequence[Quadratic], size: float) -> tuple[Floats, Floats]:
    """Mean and standard deviation (parts, postures) of a curve, in the stage's unit."""
    root, features = curves.root, curves.root.shape[1]
    whole = Quadratic.of_all(said)
    found = whole.of_size(size, len(whole.gradient))
    mean = found.mean.reshape(-1, features) @ root.T
    blocks = found.covariance.reshape(-1, features, len(found.mean) // features, features)
    variance = np.einsum("pf,kfkg,pg->kp", root, blocks, root)
    return mean, np.sqrt(np.maximum(variance, 0.0))


def described(curves: Curves, curve: Curve, said: Sequence[Quadratic], size: float, log_evidence: float) -> SmoothCurve:
    """Describe a curve of some size by what sessions say."""
    count, features, whole = len(curve.parts), curves.root.shape[1], gain(said, size)
    every = np.arange(count * features).reshape(count, features)
    lost = np.array([whole - gain(said, size, np.delete(every, p, axis=0).reshape(-1)) for p in range(count)])
    mean, sd = values_of(curves, said, size)
    return SmoothCurve(curve.stage, curve.parts, size, log_evidence, lost, curves.postures, curves.rotations, mean, sd)


def own_curves(fit: Optimum, node: Node) -> tuple[SmoothCurve, ...]:
    """Curves of moment arms, tensions and forces beside an explanation, the most evident first.

    Args:
        fit: what acts besides; all that it leaves open is marginalised.
        node: of the hyperparameters, without anything unknown.
    """
    curves, out = Curves([fit]), []
    for stage in STAGES:
        curve, sizes = curves.of(fit, stage), SIZES[stage]
        said = fit.quadratic_of(curve.columns, node)
        gains = [said.of_size(size).log_evidence for size in sizes]
        evidence = float(logsumexp(gains) - np.log(len(sizes)))
        out.append(described(curves, curve, [said], sizes[int(np.argmax(gains))], evidence))
    return tuple(sorted(out, key=lambda c: -c.log_evidence))


def curve_answer(curves: tuple[SmoothCurve, ...]) -> dict[str, Any] | None:
    """The most evident curve as the answer gives it; None where none is more evident than not."""
    if not curves or curves[0].log_evidence <= 0.0:
        return None
    curve = curves[0]
    others = ", ".join(f"{WHAT[c.stage]} {c.log_evidence:+.1f}" for c in curves[1:])
    sentence = (
        f"What is left is smooth over postures as an error of {WHAT[curve.stage]}, most in {curve.where} "
        f"(ln evidence {curve.log_evidence:+.1f}; {others})."
    )
    return curve.as_dict() | {
        "log_evidence": curve.log_evidence,
        "carried_by": curve.carriers(),
        "sentence": sentence,
    }
