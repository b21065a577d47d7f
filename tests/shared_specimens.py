"""Specimens that share a law which no catalogue has: one torque, of one size, in sessions of different fingers."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fingermodel.comparison.observations import Observations
from fingermodel.session import Session
from tests.simulator import draw_session

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class TorqueLaw:
    """A torque at a joint that a tendon exerts besides: `k_mm` times its tension times the sine of an angle.

    Attributes:
        joint: whose rotation is turned.
        muscle: whose tension.
        angle: rotation whose sine; none where empty.
        k_mm: moment arm [mm].
    """

    joint: str
    muscle: str
    angle: str
    k_mm: float

    @property
    def formula(self) -> str:
        """In the language of users' effects."""
        return f"torque[{self.joint}] += k * t_{self.muscle}" + (f" * sin(q_{self.angle})" if self.angle else "")


def specimen(folder: Path, seed: int, laws: tuple[TorqueLaw, ...], size: float = 0.8) -> tuple[Session, Observations]:
    """Draw a session of a specimen in which some laws act.

    Args:
        folder: to write into.
        seed: of specimen, rig and noise.
        laws: that act besides.
        size: of specimen and rig against the budget.
    """
    draw_session(folder, seed, {}, nuisance_scale=size)
    bench = Session.open(folder)
    observations, topology = bench.observations, bench.model.finger.topology
    wrench = observations.wrench.copy()
    posture, tension = np.asarray(observations.inputs.posture), np.asarray(observations.inputs.tension)
    for law in laws:
        pull = law.k_mm * tension[:, topology.muscles.index(law.muscle)]
        if law.angle:
            pull = pull * np.sin(posture[:, topology.rotations.index(law.angle)])
        wrench += _answer(bench, topology.rotations.index(law.joint)) * pull[:, None]
    return bench, replace(observations, wrench=wrench)


def _answer(bench: Session, rotation: int) -> Floats:
    """Change (cases, 6) of all readings per N mm of torque about a rotation, by virtual work on the stated finger."""
    from fingermodel.diagnosis.session_model.session import session_of

    return session_of(bench.model, bench.observations).changes.torque_answer[:, rotation]
