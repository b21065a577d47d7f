"""Tip and bone readings of the same posture and weights, set against each other: what the tendons pulled in all.

The tip force turned into the metacarpal's axes and the bone force together balance the tendons (Synek et al. 2019,
PeerJ 7:e7470, Eq 1). Readings on loading, on unloading and after tapping the rig are kept apart.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.measured import MeasuredSession
from daq.sessions.models import LoadCase, Posture
from daq.sessions.protocols import TAPPED

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Balance:
    """The tip and bone cases of one posture and set of weights.

    Attributes:
        posture, direction: of them.
        masses_g: by loaded tendon; gravity_m_s2: where they hang.
        tip, bone: indices of the cases in the session.
        turn: (3, 3) tip axes to the metacarpal's.
        force_N: (3,) R F_tip + F_bone in the metacarpal's axes; its length is the tendons' tension.
        variance_N2: of the readings, along it; None where a case states no uncertainty.
    """

    posture: str
    direction: str
    masses_g: Mapping[str, float]
    gravity_m_s2: float
    tip: tuple[int, ...]
    bone: tuple[int, ...]
    turn: Floats
    force_N: Floats
    variance_N2: float | None

    @property
    def weight_N(self) -> float:  # noqa: N802 - N is the unit
        """All that hangs [N]."""
        return sum(self.masses_g.values()) * 1e-3 * self.gravity_m_s2

    @property
    def tension_N(self) -> float:  # noqa: N802 - N is the unit
        """Length of the balanced force [N]."""
        return float(np.linalg.norm(self.force_N))

    @property
    def above_one(self) -> bool:
        """Whether more was pulled than hangs, which friction cannot explain of a load that was raised."""
        return self.tension_N > self.weight_N and self.direction != "unloading"

    @property
    def direction_of_pull(self) -> Floats:
        """Unit vector (3,) along it; zeros without any force."""
        return _unit(self.force_N)


def balances(measured: MeasuredSession) -> tuple[list[Balance], list[str]]:
    """Return a session's balances, and words for each bone case that lacks a tip case."""
    session = measured.session
    groups: dict[tuple[Any, ...], dict[str, list[int]]] = {}
    for i, m in enumerate(measured.cases):
        masses = tuple(sorted((k, v) for k, v in m.case.masses_g.items() if v > 0.0))
        if masses:
            key = (m.case.posture, masses, direction_of(m.case))
            groups.setdefault(key, {"tip": [], "bone": []})[m.case.location].append(i)
    found, alone = [], []
    for (posture, masses, direction), at in groups.items():
        if not (at["tip"] and at["bone"]):
            # Single tendons are measured at the tip alone by plan; only a lone bone reading is worth a word.
            if at["bone"]:
                loads = ", ".join(f"{t} {g:g} g" for t, g in masses) + (f", {direction}" * (direction != "loading"))
                alone.append(f"{session.id}: {posture}, {loads}: no tip case")
            continue
        turn = tip_to_metacarpal(session.postures_deg[posture])
        tip, tip_covariance = _average(measured, at["tip"])
        bone, bone_covariance = _average(measured, at["bone"])
        force = turn @ tip + bone
        unit = _unit(force)
        stated = all(measured.cases[i].noise_stated for i in (*at["tip"], *at["bone"]))
        variance = float(unit @ (turn @ tip_covariance @ turn.T + bone_covariance) @ unit)
        found.append(
            Balance(
                posture=posture,
                direction=direction,
                masses_g=dict(masses),
                gravity_m_s2=session.gravity_m_s2,
                tip=tuple(at["tip"]),
                bone=tuple(at["bone"]),
                turn=turn,
                force_N=force,
                variance_N2=variance if stated else None,
            )
        )
    return found, alone


def tip_to_metacarpal(posture: Posture) -> Floats:
    """Return the rotation (3, 3) that takes a vector of the distal phalanx into the metacarpal's axes.

    Rz(MCP) Ry(abduction) Rz(PIP + DIP): abduction carried by flexion. Without abduction, Rz of the summed flexion.
    """
    mcp, rest, abduction = np.deg2rad([posture.MCP, posture.PIP + posture.DIP, posture.abduction])
    ry = np.array(
        [[np.cos(abduction), 0.0, np.sin(abduction)], [0.0, 1.0, 0.0], [-np.sin(abduction), 0.0, np.cos(abduction)]]
    )
    out: Floats = _about_z(float(mcp)) @ ry @ _about_z(float(rest))
    return out


def _about_z(angle_rad: float) -> Floats:
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def direction_of(case: LoadCase) -> str:
    """How a load came to hang: loading, unloading or tapped."""
    return "tapped" if (case.note or "").startswith(TAPPED) else case.direction


def _unit(vector: Floats) -> Floats:
    length = float(np.linalg.norm(vector))
    return vector / length if length > 0.0 else np.zeros(3)


def _average(measured: MeasuredSession, indices: list[int]) -> tuple[Floats, Floats]:
    """Return the mean force (3,) of repeats and its covariance (3, 3)."""
    n = len(indices)
    force = np.mean([measured.cases[i].wrench[:3] for i in indices], axis=0)
    blocks = measured.covariance(indices).reshape(n, 6, n, 6)[:, :3, :, :3]
    return force, blocks.sum(axis=(0, 2)) / n**2
