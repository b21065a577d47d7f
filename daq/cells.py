"""Ranges and resolutions of load cells by model and calibration, in the cell's own axes, before any rotation."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Six = tuple[float, float, float, float, float, float]


# Of full scale: from here on a reading tells no more than that the load is at least so large.
FULL_SCALE_SHARE = 0.999


def at_limit(wrench: NDArray[np.float64], full_scale: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Say which readings (…, 6) are at or beyond full scale (6,)."""
    return np.asarray(np.abs(wrench) >= FULL_SCALE_SHARE * full_scale)


@dataclass(frozen=True)
class CellSpec:
    """A calibrated load cell.

    Attributes:
        name: family and calibration.
        range: Fx Fy Fz [N], Tx Ty Tz [N mm] of full scale.
        resolution: the same of its smallest step, as the maker states it.
        source: of the numbers, with their certainty.
    """

    name: str
    range: Six
    resolution: Six
    source: str


# x, y and torque ranges and the 50 N calibration's 70 N in z are those of a real certificate (serial FT14048,
# SI-50-0.5). The z ranges of 12 and 25 N and the resolutions are general knowledge of ATI's catalogue: to be checked
# against the cell's own certificate.
_SOURCE = "ATI catalogue; SI-50-0.5 ranges confirmed by a certificate, z ranges and resolutions not confirmed"


def _nano17(name: str, force: float, force_z: float, torque: float, step_N: float, step_Nmm: float) -> CellSpec:
    return CellSpec(
        name=f"ATI Nano17 {name}",
        range=(force, force, force_z, torque, torque, torque),
        resolution=(step_N, step_N, step_N, step_Nmm, step_Nmm, step_Nmm),
        source=_SOURCE,
    )


_NANO17: Mapping[str, CellSpec] = {
    "12": _nano17("SI-12-0.12", 12.0, 17.0, 120.0, 1 / 320, 1 / 64),
    "25": _nano17("SI-25-0.25", 25.0, 35.0, 250.0, 1 / 160, 1 / 32),
    "50": _nano17("SI-50-0.5", 50.0, 70.0, 500.0, 1 / 80, 1 / 16),
}


def cell_spec(model: str | None) -> CellSpec | None:
    """Return range and resolution of a model with its calibration, None where they are not known.

    Args:
        model: such as `ATI Nano17-E SI-25-0.25`; without the calibration nothing is known.
    """
    text = (model or "").lower()
    if "nano17" not in re.sub(r"[\s-]", "", text):
        return None
    # The titanium version has other ranges.
    if re.search(r"nano[\s-]?17[\s-]*ti", text):
        return None
    match = re.search(r"si[\s-]*(12|25|50)(?!\d)", text)
    return _NANO17[match[1]] if match else None
