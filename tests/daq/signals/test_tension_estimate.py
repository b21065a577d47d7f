"""The friction correction that a session's own cases give, and how sure it is."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daq.checks import check
from daq.errors import SessionError
from daq.measured import EstimatedTension, MeasuredSession
from daq.sessions import Posture, Session, parse_session, read_session
from daq.signals.balance import tip_to_metacarpal
from daq.signals.corrections import measure
from daq.signals.friction import friction
from tests.daq.benches import averaged, bench, record, recorded

ESTIMATE = {"estimate": "force_balance"}
LOADS: tuple[dict[str, float], ...] = ({"LU": 45}, {"EDC": 400}, {"RI": 650}, {"FDP": 950}, {"FDP": 665, "FDS": 665})


def rig(
    factors: Sequence[float] = (0.8,) * 5,
    beside: Sequence[float] = (0.0, 0.0, 0.0),
    role: str = "identification",
    loads: Sequence[dict[str, float]] = LOADS,
) -> Session:
    """A session whose tip and bone forces balance c m g along the metacarpal, and a force (3,) [N] beside it."""
    data: dict[str, Any] = averaged() | {"tension_factor": ESTIMATE, "cases": []}
    turn = tip_to_metacarpal(Posture.model_validate(data["postures_deg"]["hook"]))
    for k, (masses, factor) in enumerate(zip(loads, factors, strict=True)):
        pull = np.array([factor * sum(masses.values()) * 9.81e-3, 0.0, 0.0])
        tip = -0.2 * pull[[0, 0, 1]]
        common = {"role": role, "posture": "hook", "masses_g": masses, "force_sd_N": 0.01}
        data["cases"] += [
            {"id": f"t{k}", "location": "tip", "force_N": tip.tolist(), **common},
            {"id": f"b{k}", "location": "bone", "force_N": (pull + beside - turn @ tip).tolist(), **common},
        ]
    session, faults = parse_session(data, None)
    assert session is not None, faults
    return session


def estimated(session: Session) -> EstimatedTension:
    found = measure(session).estimated_tension
    assert found is not None
    return found


def recorded_session(name: str) -> MeasuredSession:
    """A shipped session whose factor is to be estimated."""
    document = read_session(name)
    asked, _ = parse_session(document.model_dump(exclude_none=True) | {"tension_factor": ESTIMATE}, document.folder)
    assert asked is not None
    return measure(asked)


def test_forces_that_balance_give_the_factor_and_say_how_sure_it_is() -> None:
    measured = measure(rig())
    found = measured.estimated_tension
    assert found is not None
    assert found.value == measured.tension_factor == pytest.approx(0.8, abs=1e-9)
    assert (found.pairs, found.above_one) == (5, 0)
    assert 0.004 < found.sd < 0.02
    assert measured.tension_factor_rel_sd == pytest.approx(found.sd / 0.8)
    assert measured.tension_factor_source == f"estimated by force balance from 5 pairs of cases, ± {found.sd:.3f}"


@pytest.mark.parametrize("beside", [(0.25, 0.0, 0.0), (0.3, 0.1, -0.4)])
def test_a_force_beside_the_weights_is_no_friction(beside: tuple[float, float, float]) -> None:
    session = rig(beside=beside)
    assert friction([measure(session)]).factor > 0.88
    found = estimated(session)
    assert found.value == pytest.approx(0.8, abs=0.002)
    assert found.constant_N == pytest.approx(beside[0], abs=0.01)
    assert found.above_one == 1
    answer = {f.code: f.text for f in check(session).warnings}
    assert "1 of 5 pairs of tip and bone cases pull more than the weights" in answer["more_than_weights"]
    assert f"a force of {found.constant_N:.2g} ± " in answer["more_than_weights"]


@pytest.mark.parametrize(("session", "mean", "factor"), [("DEV-02", 0.9195, 0.838), ("DEV-08", 0.9732, 0.835)])
def test_a_light_load_does_not_make_the_factor(session: str, mean: float, factor: float) -> None:
    measured = recorded_session(session)
    assert friction([measured]).factor == pytest.approx(mean, abs=5e-5)
    assert measured.tension_factor == pytest.approx(factor, abs=5e-4)
    assert 0.004 < measured.tension_factor_rel_sd < 0.01


def test_loads_that_disagree_make_it_less_sure() -> None:
    apart = estimated(rig((0.9, 0.7, 0.9, 0.7, 0.8)))
    assert apart.value == pytest.approx(0.8, abs=2.0 * apart.sd)
    assert apart.sd > 4.0 * estimated(rig()).sd


def test_one_load_alone_is_no_sure_factor() -> None:
    one = measure(rig((0.8,), loads=({"FDP": 950},)))
    assert one.tension_factor == pytest.approx(0.8, abs=1e-3)
    # Twenty grams of hanger that nobody weighed would be as much.
    assert 0.02 < one.tension_factor_rel_sd < 0.04
    assert "from one pair of cases" in one.tension_factor_source


def test_validation_cases_have_no_part_in_it() -> None:
    with pytest.raises(SessionError, match=r"no pair .* for identification .*validation cases are never fitted"):
        measure(rig(role="validation"))
    with pytest.raises(SessionError, match="no pair of tip and bone cases for identification"):
        recorded_session("synek2019_H02")
    mixed = rig((0.8, 0.8, 0.8, 0.8, 0.2))
    last = [c.model_copy(update={"role": "validation"}) for c in mixed.cases[-2:]]
    found = estimated(mixed.model_copy(update={"cases": (*mixed.cases[:-2], *last)}))
    assert found.pairs == 4
    assert found.value == pytest.approx(0.8, abs=1e-9)


@pytest.mark.parametrize(("factor", "unusual"), [(0.7, True), (0.8, False), (0.9, False), (0.97, True)])
def test_a_factor_that_no_specimen_had_is_said(factor: float, unusual: bool) -> None:
    codes = {f.code for f in check(rig((factor,) * 5)).warnings}
    assert ("unusual_tension_factor" in codes) is unusual
    assert "more_than_weights" not in codes


def test_forces_of_nothing_give_no_factor() -> None:
    with pytest.raises(SessionError, match="are nothing"):
        measure(rig((0.0,) * 5))


def test_a_factor_that_cannot_be_estimated(tmp_path: Path) -> None:
    data = recorded() | {"tension_factor": ESTIMATE}
    with pytest.raises(SessionError, match="no pair of tip and bone"):
        measure(bench(tmp_path / "s", data, record([np.zeros(6), np.ones(6)])))
