"""The finger in the load case that an effect changes most: measured, predicted with it, and predicted without it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fingermodel import comparing
from fingermodel.fingers import PLANES
from fingermodel.session import Session
from server.figures import graph_objects as go
from server.figures.bench_finger import Hung, finger_figure
from server.figures.style import NothingToDrawError


def effect_on_finger(bench: Session, effects: Sequence[str], case: str | None = None) -> go.Figure:
    """Draw the finger with the weights of a case, its measured force, and the predictions with and without effects.

    Args:
        bench: the session with a model that was fitted with the effects.
        effects: names of effects, of their candidates or parameters; what else was fitted beside them stays.
        case: id; by default the one whose force the effects change most.

    Raises:
        NothingToDrawError: no such case, or the effects change nothing.
    """
    within, without = comparing.compare(bench).cases, comparing.compare(bench.without(effects)).cases
    count = PLANES[bench.model.finger.judged_in]
    changes = {
        a.id: round(float(np.linalg.norm((a.predicted_N - b.predicted_N)[:count])), 3)
        for a, b in zip(within, without, strict=True)
    }
    chosen = min(changes, key=lambda i: (-changes[i], i), default=None) if case is None else case
    if chosen is None or chosen not in changes or not max(changes.values()):
        raise NothingToDrawError("The effect changes no force of these load cases.")
    finger = bench.model.finger.replace_values(**bench.model.values_at(bench.theta)._asdict())
    one, other = (next(c for c in cases if c.id == chosen) for cases in (within, without))
    beside = (f"predicted without {' + '.join(effects)}", other.predicted_N)
    forces = (one.measured_N, one.measured_sd_N, one.predicted_N)
    hung = Hung(one.masses_g, one.location, one.id, one.role, *forces, beside=beside)
    angles = bench.observations.posture_angles[one.posture]
    return finger_figure(finger, finger.values, one.posture, angles, hung, bench.loaded.name)
