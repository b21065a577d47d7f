"""Lay the lines of FPB, APB and both heads of ADP in `fingers/barry2018_thumb.yaml`.

MyoHand has no such muscles. Each becomes the straight line from the trapezium's frame to the proximal phalanx whose
moment arms at 0 are those quoted in `reference/barry2018.yaml`, with ends as little away as can be (least squares) from
an assumed origin and insertion.

    python data/lay_thumb_lines.py
"""

from __future__ import annotations

import sys

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.optimize import minimize

from daq.locations import data_dir
from fingermodel.fingers.files import read_finger

Floats = NDArray[np.float64]
# Assumed, mm: origin from the CMC centre, insertion from the MP centre; x proximal, y dorsal, z radial.
ASSUMED = {
    "FPB": ((8.3, -15.7, 4.9), (-6.0, -5.8, 5.0)),
    "APB": ((10.4, -9.4, 7.4), (-6.0, -1.8, 7.0)),
    "ADPo": ((8.9, -16.3, -8.2), (-6.0, -4.8, -6.0)),
    "ADPt": ((-10.4, -26.6, -27.0), (-6.0, -4.8, -6.0)),
}


def lines() -> dict[str, tuple[Floats, Floats]]:
    """Origin and insertion (3,) of every such muscle, as the finger file has them [mm]."""
    values = read_finger("barry2018_thumb").values
    axes, mp = np.asarray(values.axis)[:3], np.asarray(values.centre)[1]
    quoted = yaml.safe_load((data_dir() / "reference" / "barry2018.yaml").read_text(encoding="utf-8"))["thumb"]
    centres = np.array([np.zeros(3), np.zeros(3), mp])

    def arms(ends: Floats) -> Floats:
        pull = ends[:3] - (mp + ends[3:])
        pull = pull / np.linalg.norm(pull)
        found: Floats = np.sum(axes * np.cross(mp + ends[3:] - centres, pull), axis=1)
        return found

    laid = {}
    for name, (origin, insertion) in ASSUMED.items():
        start, wanted = np.array([*origin, *insertion]), np.array(quoted["muscles"][name][:3])
        found = minimize(
            lambda ends, start=start: float(np.sum((ends - start) ** 2)),
            start,
            jac=lambda ends, start=start: 2.0 * (ends - start),
            constraints={"type": "eq", "fun": lambda ends, wanted=wanted: arms(ends) - wanted},
            method="SLSQP",
            options={"maxiter": 500, "ftol": 1e-12},
        )
        laid[name] = (found.x[:3], found.x[3:])
    return laid


def main() -> None:
    """Print the points."""
    for name, (origin, insertion) in lines().items():
        moved = [np.linalg.norm(p - np.array(a)) for p, a in zip((origin, insertion), ASSUMED[name], strict=True)]
        sys.stdout.write(
            f"{name}: proximal {origin.round(4).tolist()}, distal {insertion.round(4).tolist()}; "
            f"moved by {moved[0]:.1f} and {moved[1]:.1f} mm\n"
        )


if __name__ == "__main__":
    main()
