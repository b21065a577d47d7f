"""The factor with which a session's tensions are corrected, estimated from its own tip and bone readings.

What `friction` reports is the published mean of c over load cases. A weight of hangers or a zero that the tare missed
adds to it the more, the lighter the load: 20 g beside 45 g are an error of 40 %. Here the balanced force is regressed
on the weight, with a constant force beside it. Light loads then tell the constant force, and heavy loads the factor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from daq.errors import SessionError
from daq.measured import EstimatedTension, MeasuredSession
from daq.signals.balance import Balance, balances

Floats = NDArray[np.float64]

# Synek et al. 2019, mean of three specimens: used, and said, where a session's own cannot be estimated.
PUBLISHED_TENSION_FACTOR = 0.835
# How far pulleys differ from each other, and load cases of the same weights; relative standard uncertainties.
_PULLEY_SD, _CASE_SD = 0.012, 0.01
# A force beside the weights: hangers of 20 g. And the sd of averaged forces that state none.
_CONSTANT_SD_N, _READING_SD_N = 0.2, 0.1


def estimated_tension(measured: MeasuredSession) -> EstimatedTension:
    """Estimate a session's friction correction from its identification cases.

    Raises:
        SessionError: no identification cases of the same posture and weights at tip and bone, or no force at them.
    """
    name = measured.session.id
    kept = [i for i, m in enumerate(measured.cases) if m.case.role == "identification"]
    fitted = replace(
        measured,
        cases=tuple(measured.cases[i] for i in kept),
        tare_weights=measured.tare_weights[kept],
    )
    pairs, _ = balances(fitted)
    if not pairs:
        raise SessionError(
            f"no pair of tip and bone cases for identification with the same posture and masses in {name}",
            "at least one such pair: validation cases are never fitted",
            "Measure a load case at both mounts, or state tension_factor as a number, and how sure it is in "
            "budget.tension_factor_common_sd; 'fingertwin friction' gives both",
        )
    return _regressed(pairs, name)


def _regressed(pairs: Sequence[Balance], session: str) -> EstimatedTension:
    weight = np.array([b.weight_N for b in pairs])
    force = np.array([b.force_N for b in pairs])
    covariance = _covariance(pairs)
    columns = np.column_stack([weight, np.ones(len(pairs))])
    information = columns.T @ np.linalg.solve(covariance, columns) + np.diag([0.0, _CONSTANT_SD_N**-2])
    inverse = np.linalg.inv(information)
    both = inverse @ columns.T @ np.linalg.solve(covariance, force)
    value = float(np.linalg.norm(both[0]))
    if value == 0.0:
        raise SessionError(
            f"tip and bone forces of {session} that are nothing", "forces that grow with the weights", "Check its cases"
        )
    along = both[0] / value
    constant = float(both[1] @ along)
    left = (force - columns @ both) @ along
    chi_square = float(left @ np.linalg.solve(covariance, left)) + (constant / _CONSTANT_SD_N) ** 2
    # Where they scatter by more than that, the estimate is less sure in proportion.
    widened = np.sqrt(max(1.0, chi_square / max(len(pairs) - 1, 1)))
    sd, constant_sd = widened * np.sqrt(inverse.diagonal())
    return EstimatedTension(
        value=value,
        sd=float(sd),
        pairs=len(pairs),
        above_one=sum(b.above_one for b in pairs),
        constant_N=constant,
        constant_sd_N=float(constant_sd),
    )


def _covariance(pairs: Sequence[Balance]) -> Floats:
    """Covariance (n, n) [N²] of the balanced forces: readings, load cases, and pulleys that they share."""
    tendons = sorted({name for b in pairs for name in b.masses_g})
    masses = np.array([[b.masses_g.get(name, 0.0) for name in tendons] for b in pairs])
    tension = np.array([b.tension_N for b in pairs])
    passed = _PULLEY_SD * tension[:, None] * masses / masses.sum(axis=1, keepdims=True)
    reading = np.array([_READING_SD_N**2 if b.variance_N2 is None else b.variance_N2 for b in pairs])
    # The floor [N²] is for forces of nothing that are said to be exact.
    out: Floats = passed @ passed.T + np.diag(np.maximum(reading + (_CASE_SD * tension) ** 2, 1e-12))
    return out
