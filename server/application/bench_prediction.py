"""Predictions of a bench's cases, with bands so wide that only a mistake leaves them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.bench.forces import Predict
from daq.bench.record import BenchSetup
from daq.sessions.models import LoadCase, TensionEstimate
from daq.signals.corrections import assemble
from daq.signals.tension_estimate import PUBLISHED_TENSION_FACTOR
from fingermodel.comparing import compare
from fingermodel.compiled.compilation import prepare_jax
from fingermodel.session import Session

Floats = NDArray[np.float64]
Masses = tuple[tuple[str, float], ...]
Key = tuple[str, str, Masses]

# Fingers differ from the model's by some tenths of a force (the published error is 11 % of it, 0.11 N a component);
# a wrong tendon, weight or tare by more.
BAND_SHARE, BAND_N = 0.4, 0.3
# In half widths of the band: from where a force is far from its case, how near another one has to be; and how many
# times nearer than its own.
FAR, NEAR, TIMES = 0.6, 0.35, 3.0


def predictor(setup: BenchSetup, model: str | None = None) -> Predict:
    """Return what predicts the planned cases and their repeats; nothing for others.

    Args:
        setup: of the bench.
        model: a revision, a finger file or a shipped finger; by default the setup's own finger.

    Raises:
        InputError: the model cannot be used, or not with these cases.
    """
    from fingermodel.budget import budget_of
    from fingermodel.comparison.observations import layout_of, observe
    from fingermodel.model_files import load_model

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
    bench = Session(measured, observe(measured, loaded.model.finger, loaded.model.budget), loaded)
    forces = [np.asarray(c.predicted_N) for c in compare(bench).cases]
    return Planned(dict(zip(map(_key, session.cases), forces, strict=True)))


@dataclass(frozen=True, eq=False)
class Planned:
    """Predictions of the planned cases."""

    table: Mapping[Key, Floats]  # force (3,) [N] of each

    def __call__(self, case: LoadCase) -> tuple[Floats, Floats] | None:
        """Return the force (3,) and the half width (3,) of its band [N]."""
        force = self.table.get(_key(case))
        return None if force is None else (force, np.full(3, _band(force)))

    def like(self, case: LoadCase, force_N: Floats) -> str:
        """Ask what hangs, where a force (3,) resembles another planned case's, or none at all."""
        own = self.table.get(_key(case))
        if own is None:
            return ""
        posture, location, masses = _key(case)
        away = _away(force_N, own)
        others = {"hardly any force: does the weight hang, and was the tare taken without it?": np.zeros(3)}
        for (where, at, hung), force in self.table.items():
            if at != location:
                continue
            if where == posture and hung != masses:
                said = " and ".join(f"{tendon} {grams:g} g" for tendon, grams in hung) or "no weight"
                others[f"like {said}: {_question(hung, masses)}?"] = force
            elif where != posture and hung == masses:
                others[f"like the posture {where}: is it set to {posture}?"] = force
        best, least = min(((words, _away(force_N, force)) for words, force in others.items()), key=lambda o: o[1])
        return f"reads {best}" if away >= FAR and least <= min(NEAR, away / TIMES) else ""


def _band(force: Floats) -> float:
    return BAND_SHARE * float(np.linalg.norm(force)) + BAND_N


def _away(force: Floats, predicted: Floats) -> float:
    """Return the distance of a force from a prediction, in half widths of its band."""
    return float(np.linalg.norm(force - predicted)) / _band(predicted)


def _question(hung: Masses, entered: Masses) -> str:
    """Return the question to ask about an entry, given the load that the force resembles."""
    tendons = [t for t, _ in hung if t not in dict(entered)]
    if tendons:
        return f"is a weight on {tendons[0]}"
    return "are these the weights" if dict(hung).keys() == dict(entered).keys() else "is a weight lacking"


def _key(case: LoadCase) -> Key:
    return case.posture, case.location, tuple(sorted((t, m) for t, m in case.masses_g.items() if m > 0.0))
