"""How far tensions scatter from case to case, as a session's own forces tell it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from daq.measured import MeasuredSession
from daq.sessions import parse_session
from daq.signals.corrections import measure
from fingermodel.session import Session
from tests.daq.benches import Floats, averaged

NOISE_N = 0.002
# What a kilogram on each tendon does at the tip [N].
PER_KG = {"FDP": (-1.2, -2.4, 0.1), "FDS": (-0.4, -1.6, -0.2), "EDC": (0.3, 1.5, 0.1), "RI": (0.6, -0.7, 0.5)}
LOADS: tuple[dict[str, float], ...] = (
    {"FDP": 380}, {"FDP": 950}, {"FDS": 380}, {"FDS": 950}, {"EDC": 160}, {"EDC": 400}, {"RI": 260}, {"RI": 650},
    {"FDP": 665, "FDS": 665}, {"FDP": 500, "EDC": 300},
)  # fmt: skip


def rig(
    scatter: float,
    times: int = 6,
    *,
    role: str = "identification",
    hanger_g: float = 0.0,
    zero_N: Any = 0.0,
    slip: bool = False,
    **entries: Any,
) -> MeasuredSession:
    """A session whose loads hang several times while posture and cell stand; with a slip the first is half as heavy."""
    rng = np.random.default_rng(3)
    data: dict[str, Any] = averaged() | {"budget": "estimate", "cases": []} | entries
    for k, masses in enumerate(LOADS * times):
        force: Floats = np.zeros(3) + zero_N + NOISE_N * rng.standard_normal(3)
        for tendon, mass in masses.items():
            pulled = (
                1e-3 * (mass + hanger_g) * (1.0 + scatter * rng.standard_normal()) * (0.5 if slip and k == 0 else 1.0)
            )
            force += pulled * np.array(PER_KG[tendon])
        case = {"id": f"c{k}", "role": role, "posture": "hook", "location": "tip", "masses_g": masses}
        data["cases"].append(case | {"force_N": force.tolist(), "force_sd_N": NOISE_N})
    session, faults = parse_session(data, None)
    assert session is not None, faults
    return measure(session)


def case_sd(measured: MeasuredSession) -> float:
    """The scatter in the budget of the opened session."""
    return Session.of(measured, catalogue=False).model.budget.tension_factor_case_sd


@pytest.mark.parametrize("scatter", [0.01, 0.02, 0.03])
def test_loads_that_hang_again_tell_how_far_tensions_scatter(scatter: float) -> None:
    measured = rig(scatter, times=20)
    assert measured.tension_case_sd == pytest.approx(scatter, rel=0.4)
    assert case_sd(measured) == measured.tension_case_sd
    note = f"tensions scatter by {100 * measured.tension_case_sd:.1f} % from case to case"
    assert any(note in n for n in measured.notes)


def test_a_quiet_session_has_the_certificate_s_budget() -> None:
    quiet, certified = (
        Session.of(rig(0.0, budget=name), catalogue=False).model.budget.as_dict()
        for name in ("estimate", "certificate")
    )
    assert (quiet.pop("name"), certified.pop("name")) == ("estimate", "certificate")
    assert quiet == certified


@pytest.mark.parametrize(
    ("fault", "most"),
    [
        ({"hanger_g": 60.0}, 0.001),
        ({"zero_N": (0.4, -0.3, 0.5)}, 0.001),
        ({"tension_factor": 0.6}, 0.001),
        ({"slip": True}, 0.008),
    ],
    ids=str,
)
def test_a_fault_is_no_scatter(fault: dict[str, Any], most: float) -> None:
    assert rig(0.0, **fault).tension_case_sd < most
    assert 0.005 < rig(0.02, **fault).tension_case_sd < 0.03


@pytest.mark.parametrize("few", [{"times": 1}, {"role": "validation"}], ids=str)
def test_too_few_repeats_leave_the_certificate(few: dict[str, Any]) -> None:
    measured = rig(0.05, **few)
    assert measured.tension_case_sd == 0.0
    assert any("the certificate stands" in n for n in measured.notes)


def test_a_scatter_that_is_stated_stands() -> None:
    base = {"base": "estimate", "angle_sd_deg": 2.0}
    estimated = Session.of(rig(0.02, budget=base), catalogue=False).model.budget
    assert estimated.angle_sd_deg == 2.0
    assert estimated.tension_factor_case_sd == pytest.approx(0.02, rel=0.35)
    stated = rig(0.02, budget=base | {"tension_factor_case_sd": 0.01})
    assert case_sd(stated) == 0.01
    assert stated.notes == ()


def test_nothing_is_estimated_unless_it_is_asked_for() -> None:
    assert rig(0.02, budget="certificate").tension_case_sd == 0.0
