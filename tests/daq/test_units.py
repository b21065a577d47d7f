"""Units by the words of labs and instruments."""

from __future__ import annotations

import pytest

from daq.units import COMMON, Kind, factor_of

# NIST SP 811: 1 lbf = 4.4482216152605 N, 1 in = 25.4 mm, 1 kgf = 9.80665 N.
LBF, IN = 4.4482216152605, 25.4
KNOWN: list[tuple[Kind, str, float]] = [
    *(("force", name, 1.0) for name in ("N", "newton", "Newtons", "[N]")),
    *(("force", name, LBF) for name in ("lbf", "lb", "lbs", "Pounds", "PoundForce", "pounds-force", "pound force")),
    *(("force", name, 9.80665) for name in ("kgf", "kg", "kp", "KilogramForce")),
    *(("force", name, 9.80665e-3) for name in ("g", "gf", "grams")),
    ("force", "ozf", LBF / 16),
    ("force", "kN", 1e3),
    ("force", "cN", 1e-2),
    *(("torque", name, 1.0) for name in ("Nmm", "N-mm", "N·mm", "mNm", "NewtonMillimeters")),
    *(("torque", name, 1e3) for name in ("Nm", "N-m", "N.m", "N*m", "N m", "NewtonMeters", "Newton-meters")),
    *(("torque", name, LBF * IN) for name in ("lbf-in", "in-lb", "inlbf", "lbin", "InchPounds", "pound force inch")),
    *(("torque", name, LBF * 12 * IN) for name in ("ft-lb", "lbfft", "FootPounds")),
    *(("torque", name, LBF / 16 * IN) for name in ("oz-in", "ozfin", "InchOunces")),
    ("torque", "kgf-cm", 98.0665),
    ("torque", "gcm", 98.0665e-3),
    *(("time", name, 1e-3) for name in ("ms", "milliseconds")),
    *(("time", name, 1e-6) for name in ("us", "\u00b5s", "\u03bcs")),
    ("time", "min", 60.0),
    ("voltage", "Volts", 1.0),
    ("voltage", "mV", 1e-3),
]


@pytest.mark.parametrize(("kind", "name", "factor"), KNOWN)
def test_a_unit_by_its_names(kind: Kind, name: str, factor: float) -> None:
    assert factor_of(name, kind) == pytest.approx(factor, rel=1e-14)


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        ("force", "N/m"), ("force", "mV/V"), ("force", "V"), ("force", "Nm"), ("force", "counts"), ("force", ""),
        ("force", "S"), ("force", "N(N"), ("force", "N**9"), ("force", "__import__"), ("torque", "N"), ("torque", "Pa"),
        ("torque", "N/mm"), ("force", "nan"), ("time", "inf"), ("time", "Hz"), ("time", "N"), ("voltage", "mV/V"),
    ],
)  # fmt: skip
def test_what_is_no_unit_of_that_kind_is_none(kind: Kind, name: str) -> None:
    assert factor_of(name, kind) is None


def test_what_is_offered_is_known() -> None:
    assert all(factor_of(name, kind) for kind, names in COMMON.items() for name in names)
