"""When nothing in the catalogue fits: where the residual lives, and small formulas that would explain it.

Every formula is linear in its one coefficient, dimensionally sound, and written in the language of the user's own
effects, so that it can be added as it stands. Their slopes come from statics alone: a torque at a joint answers at the
clamps through the finger's Jacobian, a tension through the slope with respect to its own loss, a force is itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from fingermodel.arrays import Floats
from fingermodel.diagnosis.posterior.gaussian import gain_of_each
from fingermodel.diagnosis.posterior.hyper import Node
from fingermodel.diagnosis.posterior.optimum import Optimum
from fingermodel.diagnosis.session_model.reading_changes import CaseChanges

# A formula is worth saying from this gain on.
WORTH = 3.0
MOST = 5


class Formula(NamedTuple):
    """A law with one coefficient k."""

    stage: str  # at which it acts
    joint: str | None  # at which, None for tensions and readings
    text: str  # in the language of the user's own effects
    unit: str  # of k
    scale: float  # half of a plausible range of k
    slopes: Floats  # (cases, 6) change of every reading per unit of k


@dataclass(frozen=True, eq=False)
class Hint:
    """One formula that would explain some of what is left."""

    law: Formula
    k: float  # most probable value
    log_evidence_gain: float  # over the model as it is
    left_out_gain: float  # log density that it adds to the cases, each predicted from all others

    def as_dict(self) -> dict[str, Any]:
        """As the answer gives it, with an effect document that can be added."""
        stage, joint, formula, unit, scale, _ = self.law
        left = formula.partition("=")[0].rstrip("+* ")
        name = "hint_" + "".join(c if c.isalnum() else "_" for c in left).strip("_")
        place = f"at the {joint} joint" if joint else f"at stage {stage}"
        return {
            "stage": stage,
            "joint": joint,
            "formula": formula.split("= ", 1)[1] if stage == "torque" else formula,
            "log_evidence_gain": self.log_evidence_gain,
            "left_out_gain": self.left_out_gain,
            "text": f"{formula} with k about {self.k:.3g} {unit} ({place}) explains part of what is left; "
            "adding it shows whether the error of the validation cases falls",
            "effect": {
                "format": "fingertwin-effect/1",
                "name": name.lower(),
                "title": f"a term that the data ask for {place}",
                "source": "a hint of fingertwin diagnose",
                "formula": formula,
                "parameters": {"k": {"unit": unit, "range": [-2.0 * scale, 2.0 * scale]}},
            },
        }


def hints(fit: Optimum, node: Node) -> tuple[Hint, ...]:
    """Search the library of formulas beside an explanation; first what predicts cases best that it is not learned from.

    Args:
        fit: what acts besides; all that it leaves open is marginalised.
        node: of the hyperparameters, without anything unknown.
    """
    session = fit.session
    rows = session.rows[session.fitted]
    terms = list(library(session.changes, fit.theta))
    columns = np.array([term.slopes.reshape(-1)[rows] * term.scale for term in terms]).T
    a, s = fit.asked(columns, node)
    spread = float(np.sqrt(max(fit.misfit(node) / max(len(rows), 1), 1.0)))
    a, s = a / spread**2, s / spread**2
    gain, left_out = gain_of_each(a, s), fit.left_out_gains(columns, node, spread)
    out: list[Hint] = []
    for i in np.argsort(-np.where(gain >= WORTH, left_out, -np.inf))[:MOST]:
        if gain[i] < WORTH or left_out[i] <= 0.0:
            break
        k = float(terms[i].scale * s[i] / (1.0 + a[i]))
        out.append(Hint(terms[i], k, float(gain[i]), float(left_out[i])))
    return tuple(out)


def library(changes: CaseChanges, theta: Floats) -> Iterator[Formula]:
    """Formulas of up to three factors."""
    topology, inputs = changes.model.finger.topology, changes.inputs
    tension, posture = np.asarray(inputs.tension), np.asarray(inputs.posture)
    answer = changes.torque_answer
    angles = {r: posture[:, k] for k, r in enumerate(topology.rotations)}
    joints = [j for j in topology.joints if j.flexion >= 0]
    total = " + ".join(f"t_{m}" for m in topology.muscles)
    pulls = [(f"t_{m}", tension[:, k]) for k, m in enumerate(topology.muscles)]
    pulls.append((f"({total})", tension.sum(axis=1)))
    # What two tendons do only together, and what grows faster than the load.
    muscles = list(enumerate(topology.muscles))
    for (i, a), (j, b) in combinations(muscles, 2):
        if np.any((tension[:, i] > 0.0) & (tension[:, j] > 0.0)):
            pulls.append((f"min(t_{a}, t_{b})", np.minimum(tension[:, i], tension[:, j])))
    squares = [(f"t_{m} * t_{m}", tension[:, k] ** 2) for k, m in muscles]
    for row, rotation in enumerate(topology.rotations):
        for words, pull in pulls:
            for shape, values in _shapes(joints, angles):
                formula = f"torque[{rotation}] += k * {words}{shape}"
                yield Formula("torque", rotation, formula, "mm", 2.0, answer[:, row] * (pull * values)[:, None])
        for words, pull in squares:
            formula = f"torque[{rotation}] += k * {words}"
            yield Formula("torque", rotation, formula, "mm/N", 0.3, answer[:, row] * pull[:, None])
    by_tension = changes.by_tension(theta)
    slopes = {m: by_tension[:, :, k] for k, m in enumerate(topology.muscles) if by_tension[:, :, k].any()}
    for m, slope in slopes.items():
        for shape, values in _shapes(joints, angles):
            yield Formula("tension", None, f"tension[{m}] *= 1 + k{shape}", "1", 0.1, slope * values[:, None])
    reading = changes.readings(theta)
    for place, at in (("tip", ~np.asarray(inputs.at_bone)), ("bone", np.asarray(inputs.at_bone))):
        if not at.any():
            continue
        for i, a in enumerate("xyz"):
            unit_force = np.zeros((len(at), 6))
            unit_force[:, i] = at
            for j, b in enumerate("xyz"):
                yield Formula(
                    "reading", None, f"force.{place}[{a}] += k * F_{b}", "1", 0.1, unit_force * reading[:, [j]]
                )
            clock = np.asarray(inputs.elapsed)[:, None]
            yield Formula("reading", None, f"force.{place}[{a}] += k * elapsed", "N", 0.5, unit_force * clock)


def _shapes(joints: list[Any], angles: dict[str, Floats]) -> Iterator[tuple[str, Floats]]:
    one = np.ones(len(next(iter(angles.values()))))
    yield "", one
    for joint in joints:
        rotation = joint.rotations[joint.flexion]
        yield f" * sin(q_{rotation})", np.sin(angles[rotation])
        yield f" * q_{rotation}", angles[rotation]
