"""What the model says beforehand of a bench's cases, with a band so wide that only a mistake leaves it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from daq.bench.forces import Predict
from daq.bench.record import BenchSetup
from daq.bench.result import PUBLISHED_TENSION_FACTOR
from daq.session_models import LoadCase, TensionEstimate

Floats = NDArray[np.float64]
Key = tuple[str, str, tuple[tuple[str, float], ...]]

# Fingers differ from the model's by some tenths of a force (the published error is 11 % of it, 0.11 N a component);
# a wrong tendon, weight or tare by more.
BAND_SHARE, BAND_N = 0.4, 0.3


def predictor(setup: BenchSetup, model: str | None = None) -> Predict:
    """Return what predicts the planned cases and their repeats; nothing for others.

    Args:
        setup: of the bench.
        model: a revision, a finger file or a shipped finger; by default the setup's own finger.

    Raises:
        InputError: the model cannot be used, or not with these cases.
    """
    table = _predicted(setup, model)

    def predict(case: LoadCase) -> tuple[Floats, Floats] | None:
        force = table.get(_key(case))
        return None if force is None else (force, np.full(3, BAND_SHARE * float(np.linalg.norm(force)) + BAND_N))

    return predict


def _predicted(setup: BenchSetup, model: str | None) -> Mapping[Key, Floats]:
    from daq.corrections import assemble
    from fingermodel.budget import budget_of
    from fingermodel.model_files import load_model
    from fingermodel.observations import layout_of, observe
    from server.workflow import Bench, compare_bench, prepare_jax

    prepare_jax()
    planned = setup.require_sound()
    factor = planned.tension_factor
    if isinstance(factor, TensionEstimate):
        factor = PUBLISHED_TENSION_FACTOR
    # Forces of nothing stand where forces will be: only what is predicted counts.
    session = planned.model_copy(update={"checks": (), "tension_factor": factor})
    measured = assemble(session, {})
    layout, budget = layout_of(measured), budget_of(session.budget)
    loaded = load_model(model, session.id, session.finger, session.folder, layout, budget)
    bench = Bench(measured, observe(measured, loaded.model.finger, loaded.model.budget), loaded)
    forces = [np.asarray(c.predicted_N) for c in compare_bench(bench).cases]
    return dict(zip(map(_key, session.cases), forces, strict=True))


def _key(case: LoadCase) -> Key:
    return case.posture, case.location, tuple(sorted((t, m) for t, m in case.masses_g.items() if m > 0.0))
