"""Load cases, edits and what can be taken back; the catalogue; friction."""

from __future__ import annotations

import numpy as np
import pytest

from daq.errors import InputError
from daq.sessions import read_session
from daq.signals.corrections import measure
from daq.signals.friction import friction
from fingertwin.client import Client, ServiceError

CASE = "c001"


def test_windows_are_moved_and_put_back(twin: Client) -> None:
    session = twin.upload("DEV-01")
    before = session.case(CASE)
    assert before.state == "measured"
    begin, end = before.windows["loaded_s"]
    edit = session.move_windows(CASE, loaded_s=(begin + 0.5, end))
    assert edit.case is not None
    assert edit.case.measured_N is not None
    assert before.measured_N is not None
    assert edit.case.windows["loaded_s"] == [begin + 0.5, end]
    assert not np.array_equal(edit.case.measured_N, before.measured_N)
    session.undo(edit)
    after = session.case(CASE)
    np.testing.assert_array_equal(np.asarray(after.measured_N), before.measured_N)
    first, second = session.edits()
    assert (first.number, first.kind, first.body["author"]) == (edit.number, "windows", "local")
    assert (second.kind, second.body["undoes"]) == ("undo", edit.number)


def test_a_case_that_is_left_out_is_not_compared(twin: Client) -> None:
    session = twin.upload("synek2019_H01")
    names = [case.id for case in session.cases()]
    session.exclude(names[0], "the suture slipped")
    compared = session.compare()
    assert [case.id for case in compared.cases] == names[1:]
    assert compared.excluded == {names[0]: "the suture slipped"}
    session.include(names[0])
    assert len(session.compare().cases) == len(names)
    repeat = {"id": "again", "role": "validation", "posture": "hook", "location": "tip", "masses_g": {"FDP": 950.0}}
    added = session.add_case(repeat | {"force_N": [-2.0, -2.0, 0.1]})
    assert added.case is not None
    assert added.case.state == "measured"
    session.undo(added.number)
    assert [case.id for case in session.cases()] == names


def test_a_block_of_cases_is_amended_and_taken_back(twin: Client) -> None:
    session = twin.upload("synek2019_H01")
    before = {case.id: dict(case.masses_g or {}) for case in session.cases()}
    edit = session.amend("all", "the cables were led to the other pulley", tendons={"FDP": "FDS", "FDS": "FDP"})
    swap = {"FDP": "FDS", "FDS": "FDP"}
    after = {case.id: case.masses_g for case in session.cases()}
    assert after == {case: {swap.get(t, t): g for t, g in hung.items()} for case, hung in before.items()}
    session.undo(edit)
    assert {case.id: case.masses_g for case in session.cases()} == before


def test_what_hung_what_it_weighs_and_where_the_cell_was_is_amended(twin: Client) -> None:
    session = twin.upload("synek2019_H01")
    first, *rest = session.cases()
    ((tendon, grams),) = (first.masses_g or {}).items()
    other = "bone" if first.location == "tip" else "tip"
    session.amend(first.id, "weighed again", masses_g={tendon: grams + 7.5}, location=other)
    session.amend("all", "the set was weighed", weights_g={grams + 7.5: 1.1 * grams})
    shown = {case.id: case for case in session.compare().cases}
    assert (shown[first.id].masses_g, shown[first.id].location) == ({tendon: 1.1 * grams}, other)
    assert {c.id: c.masses_g for c in rest} == {k: c.masses_g for k, c in shown.items() if k != first.id}


def test_a_window_that_is_none_is_refused(twin: Client) -> None:
    session = twin.upload("DEV-01")
    with pytest.raises(InputError, match="of unloaded_s, loaded_s, unloaded_after_s"):
        session.move_windows(CASE, laoded_s=(1.0, 2.0))
    with pytest.raises(ServiceError) as caught:
        session.move_windows(CASE, loaded_s=(2.0, 1.0))
    assert caught.value.status == 422
    assert session.document()["id"] == "DEV-01"


def test_a_session_that_is_deleted_is_gone(twin: Client) -> None:
    session = twin.upload("synek2019_HMEAN")
    assert session.id in [s.id for s in twin.sessions()]
    assert session.close().closed
    session.delete()
    assert session.id not in [s.id for s in twin.sessions()]
    with pytest.raises(ServiceError) as caught:
        session.compare()
    assert caught.value.status == 404


def test_an_effect_of_ones_own_is_kept_once(twin: Client) -> None:
    formula = "torque[PIP] += k * t_EDC * sin(q_PIP)"
    checked = twin.check_effect(formula)
    assert checked.name not in {effect.name for effect in twin.effects()}
    assert twin.add_effect(formula).name == twin.add_effect(formula).name == checked.name
    mine = [effect for effect in twin.effects() if effect.own]
    assert [effect.name for effect in mine] == [checked.name]
    assert "hanger_mass" in {effect.name for effect in twin.effects() if not effect.own}
    # Nothing is kept of what is refused, also where only a name is wrong.
    for refused in ("torque[PIP] += __import__('os')", "torque[PIP] += k * t_XXX"):
        with pytest.raises(ServiceError) as caught:
            twin.add_effect(refused)
        assert caught.value.status == 422
        assert [effect.name for effect in twin.effects() if effect.own] == [checked.name]


def test_friction_is_that_of_the_sessions_at_hand(twin: Client) -> None:
    session = twin.upload("DEV-01")
    local = friction([measure(read_session("DEV-01"))])
    found = twin.friction([session])
    assert found.factor == pytest.approx(local.factor, rel=1e-9)
    assert found.interval == pytest.approx((local.pooled.low, local.pooled.high), rel=1e-9)
    assert len(found.cases) == len(local.cases)
