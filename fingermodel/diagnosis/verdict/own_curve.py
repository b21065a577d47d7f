"""Where a misfit lives that nothing in the catalogue explains: a smooth curve of one session's own readings."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.special import logsumexp

from fingermodel.diagnosis.posterior.curves import STAGES, WHAT, Curves, Said, SmoothCurve, described, gain
from fingermodel.diagnosis.posterior.hyper import Node
from fingermodel.diagnosis.posterior.optimum import Optimum
from fingermodel.diagnosis.settings import SHARED_SIZES


def own_curves(fit: Optimum, node: Node) -> tuple[SmoothCurve, ...]:
    """Curves of moment arms, tensions and forces beside an explanation, the most evident first.

    Args:
        fit: what acts besides; all that it leaves open is marginalised.
        node: of the hyperparameters, without anything unknown.
    """
    curves, out = Curves([fit]), []
    for stage in STAGES:
        curve, sizes = curves.of(fit, stage), SHARED_SIZES[stage]
        said = [Said(0.0, *fit.information(curve.columns, node))]
        gains = [gain(said, size) for size in sizes]
        evidence = float(logsumexp(gains) - np.log(len(sizes)))
        out.append(described(curves, curve, said, sizes[int(np.argmax(gains))], evidence))
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
