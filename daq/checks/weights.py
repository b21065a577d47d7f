"""Compare known weights hung on the cell with what the cell read: gain, axis, sign, crosstalk, and their change."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from daq.findings import Finding, finding
from daq.measured import MeasuredCheck

# A calibrated cell keeps 0.4 % of gain and 0.6° of rotation; beyond five and three times that something is wrong.
GAIN_LIMIT = 0.02
CROSSTALK_LIMIT = 0.03
CHANGE_LIMIT = 0.01
# With less than a tenth of a weight, its direction says nothing.
_ABSENT = 0.1
_NAMES = "xyz"


@dataclass(frozen=True)
class WeightResult:
    """Result of one known weight.

    Attributes:
        when, mount, mass_g: of the weight.
        expected_N: (3,) its pull in mount axes; measured_N: (3,) what the cell read.
        gain: component of the reading along the pull over the pull; gain_sd: its standard uncertainty.
        crosstalk: length of the component across over the pull; crosstalk_sd: its standard uncertainty.
        axis: axis of the largest component of the reading, with its sign.
    """

    when: str
    mount: str
    mass_g: float
    expected_N: tuple[float, ...]
    measured_N: tuple[float, ...]
    gain: float
    gain_sd: float
    crosstalk: float
    crosstalk_sd: float
    axis: str


def weigh(check: MeasuredCheck) -> WeightResult:
    """Compare one known weight with its reading."""
    pull = float(np.linalg.norm(check.force_N))
    along = check.force_N / pull
    force, covariance = check.wrench[:3], check.covariance[:3, :3]
    across = force - (force @ along) * along
    length = float(np.linalg.norm(across))
    unit = across / length if length > 0.0 else np.zeros(3)
    k = int(np.argmax(np.abs(force)))
    return WeightResult(
        when=check.when,
        mount=check.mount,
        mass_g=check.mass_g,
        expected_N=tuple(check.force_N.tolist()),
        measured_N=tuple(force.tolist()),
        gain=float(force @ along) / pull,
        gain_sd=float(np.sqrt(along @ covariance @ along)) / pull,
        crosstalk=length / pull,
        crosstalk_sd=float(np.sqrt(unit @ covariance @ unit)) / pull,
        axis=f"{'-' if force[k] < 0 else '+'}{_NAMES[k]}",
    )


def weight_findings(checks: Sequence[MeasuredCheck]) -> tuple[list[Finding], list[dict[str, Any]]]:
    """Judge the known weights.

    Returns:
        findings, and each weight's result as plain data.
    """
    results = [weigh(c) for c in checks]
    out: list[Finding] = []
    for i, r in enumerate(results):
        where = f"checks[{i}] ({r.when}, {r.mount}, {r.mass_g:g} g)"
        strongest = int(np.argmax(np.abs(r.expected_N)))
        wanted = f"{'-' if r.expected_N[strongest] < 0 else '+'}{_NAMES[strongest]}"
        slanted = np.sort(np.abs(r.expected_N))[-2] > 0.7 * abs(r.expected_N[strongest])
        if np.hypot(r.gain, r.crosstalk) < _ABSENT + 3.0 * np.hypot(r.gain_sd, r.crosstalk_sd):
            out.append(
                finding(
                    "error",
                    "weight_absent",
                    where,
                    f"the cell reads {100.0 * np.hypot(r.gain, r.crosstalk):.1f} % of the weight",
                    "all of it",
                    "Did it hang on the cell while it was read? If so, check the units",
                )
            )
        elif r.gain < -0.5:
            out.append(
                finding(
                    "error",
                    "weight_sign",
                    where,
                    f"the cell reads {r.gain:.3f} of the weight along its pull",
                    "1: the force on the cell, positive along the pull",
                    "Turn the sign of the readings, or correct the direction",
                )
            )
        elif r.axis != wanted and not slanted:
            out.append(
                finding(
                    "error",
                    "weight_axis",
                    where,
                    f"the cell reads it along {r.axis}",
                    wanted,
                    "Correct the mount's rotation, or the direction",
                )
            )
        else:
            out += _gain_and_crosstalk(r, where)
        out.append(
            finding(
                "note",
                "weight",
                where,
                f"gain {r.gain:.4f} ± {r.gain_sd:.4f}, across {100 * r.crosstalk:.2f} % ± {100 * r.crosstalk_sd:.2f} %",
            )
        )
    out += _changes(results)
    return out, [_plain(r) for r in results]


def _gain_and_crosstalk(r: WeightResult, where: str) -> list[Finding]:
    out = []
    if abs(r.gain - 1.0) > GAIN_LIMIT + 3.0 * r.gain_sd:
        out.append(
            finding(
                "warning",
                "weight_gain",
                where,
                f"gain {r.gain:.4f} ± {r.gain_sd:.4f}",
                f"1 within {100 * GAIN_LIMIT:g} %",
                "Check the mass and the calibration's serial number and units",
            )
        )
    if r.crosstalk > CROSSTALK_LIMIT + 3.0 * r.crosstalk_sd:
        out.append(
            finding(
                "warning",
                "weight_crosstalk",
                where,
                f"{100 * r.crosstalk:.1f} % of the weight is read across its pull",
                f"at most {100 * CROSSTALK_LIMIT:g} %",
                "Was the cell or the weight's string askew? Correct the mount's rotation",
            )
        )
    return out


def _changes(results: Sequence[WeightResult]) -> list[Finding]:
    groups: dict[tuple[Any, ...], list[WeightResult]] = defaultdict(list)
    order = {"before": 0, "during": 1, "after": 2}
    for r in results:
        direction = tuple(np.round(np.array(r.expected_N) / np.linalg.norm(r.expected_N), 3).tolist())
        groups[r.mount, direction].append(r)
    out = []
    for (mount, _), members in groups.items():
        for a, b in pairwise(sorted(members, key=lambda r: order[r.when])):
            if a.when == b.when:
                continue
            change, sd = b.gain - a.gain, float(np.hypot(a.gain_sd, b.gain_sd))
            turned = np.array(b.measured_N) / b.mass_g - np.array(a.measured_N) / a.mass_g
            shift = float(np.linalg.norm(turned)) * a.mass_g / float(np.linalg.norm(a.expected_N))
            if abs(change) > CHANGE_LIMIT + 3.0 * sd or shift > 2.0 * CHANGE_LIMIT + 3.0 * sd:
                out.append(
                    finding(
                        "warning",
                        "weight_change",
                        f"checks at {mount}",
                        f"between {a.when} and {b.when} the gain went from {a.gain:.4f} to {b.gain:.4f}, and the "
                        f"reading changed by {100 * shift:.1f} % of the weight",
                        f"a change of at most {100 * CHANGE_LIMIT:g} % in gain",
                        "The cell, its clamp or its calibration changed during the session",
                    )
                )
    return out


def _plain(r: WeightResult) -> dict[str, Any]:
    return {
        "when": r.when,
        "mount": r.mount,
        "mass_g": r.mass_g,
        "expected_N": list(r.expected_N),
        "measured_N": list(r.measured_N),
        "gain": r.gain,
        "gain_sd": r.gain_sd,
        "crosstalk": r.crosstalk,
        "crosstalk_sd": r.crosstalk_sd,
        "axis": r.axis,
    }
