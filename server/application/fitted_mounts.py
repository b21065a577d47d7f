"""How a fitted error of the cell's mounting goes into the session's description.

A fit says how readings are off: turned, and with moments about the cell's origin where it lies off the load point. The
session says what is done to the readings, which is the inverse.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from daq.sessions import Mount
from daq.signals.calibration import intrinsic_xyz, mount_taking_up
from fingermodel.session import Session

Floats = NDArray[np.float64]

# Groups of parameters that tell of a mounting.
MOUNTING = ("mount_offset", "mounting_rotation", "cell_rotation")


def fitted_mounts(bench: Session, values: Mapping[str, float]) -> dict[str, Mount]:
    """Return the mounts by location that take up what was fitted; none where the session cannot state it.

    It states one mount for a location, so a cell that was moved has none. Averaged forces are in mount axes already.

    Args:
        bench: whose model was fitted.
        values: of parameters, by name.
    """
    session, layout = bench.measured.session, bench.model.layout
    if session.readings is None or not any(tells_of_mounting(name) for name in values):
        return {}

    def vector(group: str) -> Floats:
        return np.array([values.get(f"{group}.{axis}", 0.0) for axis in "xyz"])

    def turn(*groups: str) -> Floats:
        return intrinsic_xyz(np.sum([vector(g) for g in groups], axis=0).tolist())

    known = (
        {} if session.load_cell is None else {str(place): mount for place, mount in session.load_cell.mounts.items()}
    )
    at = [location for location, _ in layout.mountings]
    out: dict[str, Mount] = {}
    for i, location in enumerate(at):
        if at.count(location) == 1:
            place = layout.mounting_name(i)
            # An effect acts before the small errors of every rig.
            first = turn("cell_rotation.common", f"cell_rotation.{place}")
            turned = turn(f"mounting_rotation.{place}") @ first
            away_mm = first.T @ vector(f"mount_offset.{place}")
            out[location] = mount_taking_up(known.get(location), session.specimen.side, turned, away_mm)
    return out


def tells_of_mounting(parameter: str) -> bool:
    """Whether a parameter, by its name, tells how the cell is mounted."""
    return parameter.partition(".")[0] in MOUNTING
