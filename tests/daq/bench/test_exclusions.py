"""Cases that are excluded at the bench, and taken in again."""

from __future__ import annotations

import pytest

from daq.bench.record import BenchRecord
from tests.daq.bench_lines import BEGUN, bench, refused
from tests.daq.bench_plays import case


def test_an_exclusion_needs_a_reason_before_unblinding() -> None:
    played = bench().play([*BEGUN, *case("tip", FDP=950), "next", *case("tip", FDS=950)])
    assert "without a reason" in refused(played, "exclude c001")
    played.press("exclude c001 the hanger touched the table")
    assert "already" in refused(played, "exclude c001 again")
    assert played.run.record.cases["c001"]["excluded"] == "the hanger touched the table"
    assert [r.case for r in played.run.results()] == ["c002"]
    played.press("close")
    for line in ("exclude c002 it does not fit", "repeat", "loaded", "tare", "note x", "close"):
        assert "closed" in refused(played, line)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("exclude", "no case is named; expected one of c001 c002"),
        ("exclude it slipped", "no case it was taken"),
        ("exclude c003 it slipped", "no case c003 was taken"),
        ("exclude C001 it slipped", "no case C001 was taken; expected one of c001 c002. Did you mean c001?"),
        ("exclude c01 it slipped", "Did you mean c001?"),
        ("include", "no case is named; expected one of (none yet)"),
        ("include c001", "no case c001 is excluded"),
    ],
)
def test_no_other_case_is_excluded_than_the_one_that_is_named(line: str, said: str) -> None:
    played = bench().play([*BEGUN, *case("tip", FDP=950), "next", *case("tip", FDS=950)])
    assert said in refused(played, line)
    assert played.run.record.excluded == ()


def test_an_exclusion_can_be_taken_back_and_stays_in_the_notes() -> None:
    played = bench().play([*BEGUN, *case("tip", FDP=950), "next", *case("tip", FDS=950)])
    before = played.run.status().last
    played.press("exclude c002 slipped")
    assert played.run.status().last is None
    assert "no case c001 is excluded; expected one of c002" in refused(played, "include c001")
    played.press("include c002")
    after = played.run.status().last
    assert before is not None
    assert after is not None
    assert after.as_value() == before.as_value()
    assert [r.case for r in played.run.results()] == ["c001", "c002"]
    assert BenchRecord.of(played.said).document() == played.run.record.document()
    notes = [e.get("text") for e in played.run.record.events if e["kind"] == "note"]
    assert notes[-1] == "case c002 was excluded (slipped), and is taken in again"
    assert played.run.status().answers_begin["exclude"] == "c002 "
    played.play(["exclude c001 it touched", "close"])
    assert "closed" in refused(played, "include c001")
