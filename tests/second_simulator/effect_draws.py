"""How large an effect is, in which form it acts, and what else of it is a specimen's or rig's own.

The order of the draws within an effect is part of what a seed means.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from tests.second_simulator.finger import MUSCLES, Floats
from tests.second_simulator.protocols import Protocol
from tests.second_simulator.situation import FORMS, Acting

Rng: TypeAlias = np.random.Generator
# A generator and a sign, to the size.
_Sizes: TypeAlias = Callable[[Rng, float], Floats]
_Draws: TypeAlias = Callable[[Rng, float], Acting]

CATALOGUE = (
    "hanger_mass",
    "rig_friction",
    "worn_pulley",
    "sheath_friction",
    "fdp_fds_coupling",
    "lumbrical_on_fdp",
    "hood_shift",
    "lateral_band_slip",
    "bowstringing",
    "intrinsic_bowstring",
    "centre_migration",
    "axis_tilt",
    "segment_length",
    "tip_location",
    "goniometer_bias",
    "clamp_compliance",
    "volar_plate",
    "joint_friction",
    "suture_angle",
    "cell_rotation",
    "cell_crosstalk",
    "zero_offset",
    "tare_drift",
)


def _form(effect: str, rng: Rng) -> str:
    return str(rng.choice(FORMS[effect]))


def _magnitude(rng: Rng, most: float, least: float = 0.25) -> float:
    return float(most * rng.uniform(least, 1.0))


def _vector(rng: Rng, most: float, least: float = 0.25) -> Floats:
    """Three components in any direction; the largest has the drawn size."""
    parts = rng.uniform(-1.0, 1.0, 3)
    return parts / np.abs(parts).max() * most * rng.uniform(least, 1.0)


def _positive(most: float, least: float = 0.25) -> _Sizes:
    return lambda rng, sign: np.array([_magnitude(rng, most, least)])


def _either_sign(most: float, least: float = 0.25) -> _Sizes:
    return lambda rng, sign: np.array([sign * _magnitude(rng, most, least)])


def _by_place(most: float) -> _Sizes:
    return lambda rng, sign: _vector(rng, most)


def _positive_by_place(most: float) -> _Sizes:
    return lambda rng, sign: np.abs(_vector(rng, most))


# Those that have nothing but a form and a size.
_PLAIN: dict[str, _Sizes] = {
    "rig_friction": _either_sign(0.2),  # 1
    "sheath_friction": _positive(0.2),  # 1
    "lumbrical_on_fdp": _positive(1.0, 0.4),  # 1
    "hood_shift": _positive(1.0),  # 1/rad
    "lateral_band_slip": _positive(9.0),  # mm
    "bowstringing": _positive(0.8),  # mm/N
    "intrinsic_bowstring": _positive(10.0),  # mm
    "centre_migration": _by_place(5.0),  # mm/rad
    "axis_tilt": _by_place(np.radians(15.0)),  # rad
    "segment_length": _by_place(0.15),  # 1, of PP, MP, DP
    "tip_location": _either_sign(6.0, 0.4),  # mm
    "goniometer_bias": _by_place(np.radians(12.0)),  # rad
    "clamp_compliance": _positive_by_place(3e-3),  # rad/(N mm)
    "volar_plate": _positive(1.0, 0.3),  # 1
    "joint_friction": _positive_by_place(0.3),  # 1
    "tare_drift": _by_place(1.0),  # N over the session
}


def _about_one(rng: Rng, sd: float) -> dict[str, float]:
    return {m: float(1.0 + sd * rng.standard_normal()) for m in MUSCLES}


def _hanger_mass(rng: Rng, sign: float) -> Acting:
    """Size in kg."""
    form, size = _form("hanger_mass", rng), _magnitude(rng, 0.1)
    return Acting(form, np.array([size]), own=_about_one(rng, 0.08))


def _worn_pulley(rng: Rng, sign: float) -> Acting:
    """The share that one tendon loses, any but the lumbrical."""
    tendon = str(rng.choice(["RI", "UI", "FDP", "FDS", "EDC"]))
    form = _form("worn_pulley", rng)
    return Acting(form, np.array([_magnitude(rng, 0.35)]), at=(tendon,))


def _fdp_fds_coupling(rng: Rng, sign: float) -> Acting:
    """A share; in three of ten, a fifth of it comes back."""
    form, size = _form("fdp_fds_coupling", rng), _magnitude(rng, 0.3)
    back = 0.2 * size if rng.uniform() < 0.3 else 0.0
    return Acting(form, np.array([size]), further=np.array([back]))


def _suture_angle(rng: Rng, sign: float) -> Acting:
    """Two angles in rad, dorsal and radial."""
    angles = rng.uniform(-1.0, 1.0, 2)
    angles = angles / np.abs(angles).max() * np.radians(12.0) * rng.uniform(0.25, 1.0)
    form = _form("suture_angle", rng)
    return Acting(form, angles, own=_about_one(rng, 0.15))


def _cell_rotation(rng: Rng, sign: float) -> Acting:
    """Three angles in rad, at the bone 0.8 to 1.2 times."""
    form, size = _form("cell_rotation", rng), _vector(rng, np.radians(12.0))
    return Acting(form, size, further=np.array([rng.uniform(0.8, 1.2)]))


def _cell_crosstalk(rng: Rng, sign: float) -> Acting:
    """Nine shares, and three of torques in N/(N mm)."""
    leaks = rng.uniform(-1.0, 1.0, (3, 3))
    leaks = leaks / np.abs(leaks).max() * 0.1 * rng.uniform(0.35, 1.0)
    form = _form("cell_crosstalk", rng)
    return Acting(form, leaks, further=rng.uniform(-1.0, 1.0, 3) * 4e-4)


def _zero_offset(rng: Rng, sign: float) -> Acting:
    """Three forces in N at one mount."""
    form, size = _form("zero_offset", rng), _vector(rng, 0.8)
    mount = str(rng.choice(["tip", "bone"]))
    return Acting(form, size, at=(mount,), further=rng.standard_normal((16, 3)))


_WITH_MORE: dict[str, _Draws] = {
    "hanger_mass": _hanger_mass,
    "worn_pulley": _worn_pulley,
    "fdp_fds_coupling": _fdp_fds_coupling,
    "suture_angle": _suture_angle,
    "cell_rotation": _cell_rotation,
    "cell_crosstalk": _cell_crosstalk,
    "zero_offset": _zero_offset,
}


def draw_effect(name: str, rng: Rng) -> Acting:
    """Draw an effect of the catalogue, at a quarter of its plausible range or more."""
    sign = float(rng.choice([-1.0, 1.0]))
    if name in _WITH_MORE:
        return _WITH_MORE[name](rng, sign)
    form = _form(name, rng)
    return Acting(form, _PLAIN[name](rng, sign))


@dataclass(frozen=True)
class Start:
    """What is outside the catalogue before it is brought to size.

    Attributes:
        size: to start from.
        most: that any component of the size may become; none where there is only one size.
        at: as in `Acting`, like own and further.
    """

    size: Floats
    most: float | None
    at: tuple[str, ...] = ()
    own: Mapping[str, float] | None = None
    further: float = 0.0

    def acting(self, name: str) -> Acting:
        """In its only form."""
        return Acting(FORMS[name][0], self.size, self.at, self.own or {}, np.array([self.further]))


def _either(rng: Rng) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _one(size: float) -> Floats:
    return np.array([size])


def _swapped(rng: Rng, plan: Protocol) -> tuple[str, ...]:
    posture = str(rng.choice(plan.fitted_postures))
    return posture, *(("RI", "UI"), ("FDP", "FDS"))[int(rng.integers(2))]


def _catches(rng: Rng, plan: Protocol) -> dict[str, float]:
    """Some of the cases, and when in their windows."""
    return {c.id: float(rng.uniform(-0.3, 0.7)) for c in plan.cases if rng.uniform() < 0.16}


def draw_starts(rng: Rng, plan: Protocol) -> dict[str, Start]:
    """Draw all that is outside the catalogue, so that a seed's later draws do not depend on which of it acts."""

    def tilts() -> dict[str, float]:
        return {p: float(rng.uniform(-1.3, 1.3)) for p in plan.postures_deg}

    def slipped_s() -> float:
        return float(rng.uniform(0.15, 0.55) * plan.end_s)

    return {
        "wrong_mcp_order": Start(_one(0.6), 1.0, further=rng.uniform(-0.12, 0.12)),
        "force_shunt": Start(_one(0.15), 0.3, at=(str(rng.choice(["tip", "bone"])),)),
        "passive_joint_torque": Start(_one(_either(rng) * 8.0), 60.0),
        "edc_subluxation": Start(_one(8.0), 14.0),
        "mislabelled_posture": Start(_one(1.0), None, at=_swapped(rng, plan)),
        "seating": Start(_vector(rng, 0.1, 0.8), 0.3, further=slipped_s()),
        "ri_edc_sagittal_crosstalk": Start(_one(0.3), 0.9),
        "tissue_relaxation": Start(_one(0.2), 0.6, further=rng.uniform(10.0, 60.0)),
        "hand_gravity": Start(_one(0.5), 2.0, own=tilts()),
        "suture_catch": Start(_one(0.3), 0.85, own=_catches(rng, plan)),
        "bony_stop": Start(_one(0.3), 0.95),
        "hysteresis": Start(_one(0.06), 0.14),
        "web_tether": Start(_one(0.5), 0.98),
        "wrong_weight": Start(_one(_either(rng) * 50.0), 100.0),
        "slip_at_high_load": Start(_one(0.4), 0.95, further=rng.uniform(2.5, 4.5)),
        "band_tightening_with_dip": Start(_one(3.0), 14.0),
        "clamp_moment": Start(_one(0.5), 0.95),
        "gain_drift": Start(_one(_either(rng) * 0.12), 0.4),
    }
