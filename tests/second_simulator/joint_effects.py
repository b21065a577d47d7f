"""What may be otherwise about the joint torques: the catalogue from the volar plate to the clamp that gives."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tests.second_simulator.finger import FLEXIONS, Floats
from tests.second_simulator.situation import Acting, Situation, form

_WITH_NEIGHBOURS = np.array([[1.0, 0.12, 0.0], [0.12, 1.0, 0.12], [0.0, 0.12, 1.0]])
# So that the search for the posture under load settles.
_GIVES_AT_MOST = 0.6


def _plate_takes(s: Situation, share: Callable[[float, float], float]) -> None:
    """A share, by the hyperextension in degrees and the torque, of a torque that extends the MCP."""
    extending = max(-float(s.torque[0]), 0.0)
    if s.flexion[0] < 0.0:
        s.torque[0] += share(-float(np.degrees(s.flexion[0])), extending) * extending


@form("volar_plate", "torque")
def plate_over_16_degrees(s: Situation, a: Acting) -> None:
    """It tightens smoothly over 16°."""

    def share(degrees: float, extending: float) -> float:
        x = min(degrees / 16.0, 1.0)
        return a.value * (x * x * (3.0 - 2.0 * x))

    _plate_takes(s, share)


@form("volar_plate", "torque")
def plate_exponentially(s: Situation, a: Acting) -> None:
    """It tightens as 1 - exp(-degrees/9)."""
    _plate_takes(s, lambda degrees, extending: a.value * (1.0 - float(np.exp(-degrees / 9.0))))


@form("volar_plate", "torque")
def plate_under_load(s: Situation, a: Acting) -> None:
    """It tightens as 1 - exp(-degrees/7), and takes less of torques of a few N mm."""

    def share(degrees: float, extending: float) -> float:
        return a.value * (1.0 - float(np.exp(-degrees / 7.0))) * (extending / (extending + 4.0))

    _plate_takes(s, share)


def _lose(s: Situation, a: Acting, counted: Callable[[Floats], Floats]) -> None:
    torque = s.torque[FLEXIONS]
    s.torque[FLEXIONS] = torque - np.sign(torque) * a.size * counted(np.abs(torque))


@form("joint_friction", "torque")
def friction_saturates(s: Situation, a: Acting) -> None:
    """The loss is f |τ|/(1 + |τ|/250 N mm)."""
    _lose(s, a, lambda torque: torque / (1.0 + torque / 250.0))


@form("joint_friction", "torque")
def friction_grows(s: Situation, a: Acting) -> None:
    """The loss is f |τ| (0.8 + 0.2 |τ|/(|τ| + 15 N mm))."""
    _lose(s, a, lambda torque: torque * (0.8 + 0.2 * torque / (torque + 15.0)))


@form("clamp_compliance", "give")
def clamp_stiffens(s: Situation, a: Acting) -> None:
    """It gives k τ/(1 + |τ|/150 N mm)."""
    torque = s.torque[FLEXIONS]
    s.give = np.clip(a.size * torque / (1.0 + np.abs(torque) / 150.0), -_GIVES_AT_MOST, _GIVES_AT_MOST)


@form("clamp_compliance", "give")
def clamp_couples(s: Situation, a: Acting) -> None:
    """It gives in proportion to the torque, and by 12 % of what each neighbouring joint would give."""
    s.give = np.clip(_WITH_NEIGHBOURS @ (a.size * s.torque[FLEXIONS]), -_GIVES_AT_MOST, _GIVES_AT_MOST)
