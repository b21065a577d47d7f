"""Sessions of several specimens together: a fault of the rig is found in all, what one specimen has in it alone."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.recorded import Recorded
from benchmarks.session_faults import tendons
from fingermodel.diagnosis.posterior.optimum import Optimum
from fingermodel.diagnosis.several_sessions import several
from fingermodel.diagnosis.several_sessions.several import Pooled, diagnose_pooled
from fingermodel.session import Session
from tests.simulator import draw_session


def pooled_of(folder: Path, drawn: Mapping[int, Mapping[str, Any]], outside: str | None = None) -> Pooled:
    """Sessions of specimens, each with what acts in it, diagnosed together."""
    sessions = []
    for specimen, effects in drawn.items():
        own = folder / str(specimen)
        own.mkdir()
        draw_session(own, specimen, dict(effects) or None, outside, protocol="short", nuisance_scale=0.8)
        sessions.append(Session.open(own))
    return diagnose_pooled(sessions)


@pytest.mark.full
def test_a_fault_of_the_rig_shows_in_all_its_specimens(tmp_path: Path) -> None:
    fault = {"zero_offset.bone": (0.3, 0.2, -0.2)}
    pooled = pooled_of(tmp_path, {21: fault, 22: fault})
    assert (pooled.verdict.kind, pooled.verdict.names) == ("found", ("zero_offset.bone",))
    best = pooled.ranking[0]
    assert best.one_size
    assert best.value == pytest.approx([0.3, 0.2, -0.2], abs=0.08)


def test_a_session_with_a_fault_is_corrected_first(tmp_path: Path) -> None:
    """Else whatever makes up for the fault in one session would be shared by the others, which need nothing."""
    for seed in (21, 22):
        (tmp_path / str(seed)).mkdir()
        draw_session(tmp_path / str(seed), seed, None, protocol="short", nuisance_scale=0.8)
    entered = Recorded(tmp_path / "22")
    tendons(entered, np.random.default_rng(22))
    entered.write()
    pooled = diagnose_pooled([Session.open(tmp_path / str(seed)) for seed in (21, 22)])
    assert pooled.verdict.kind == "undecided"
    assert pooled.verdict.sentence.startswith("Undecided: correct SIM-00022 first, or leave it out: in SIM-00022 ")
    assert "were exchanged throughout" in pooled.verdict.sentence
    assert (pooled.ranking, pooled.p_apart, pooled.shared) == ((), None, None)


@pytest.mark.full
def test_a_fault_of_the_rig_shows_beside_what_is_a_specimens_own(tmp_path: Path) -> None:
    # By itself it explains the second session no better than chance: there the flexors bowstring besides.
    pooled = pooled_of(tmp_path, {21: {"hanger_mass": 25.0}, 22: {"hanger_mass": 25.0, "bowstringing": 0.4}})
    assert (pooled.verdict.kind, pooled.verdict.names) == ("found", ("hanger_mass",)), pooled.verdict
    best = pooled.ranking[0]
    # The simulator's hangers differ from tendon to tendon, and in every session anew: their mean is one, they are not.
    assert best.value[0] == pytest.approx(25.0, abs=3.0)
    assert abs(best.log_evidence_shared - best.log_evidence_own) < 5.0
    assert [each.own for each in best.each] == [(), ("bowstringing",)]
    assert "bowstringing in SIM-00022" in pooled.verdict.sentence


@pytest.mark.full
def test_what_only_all_together_show_is_known_in_each_where_a_further_law_is_looked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fits: list[Optimum] = []
    monkeypatch.setattr(several, "shared_finding", lambda _sessions, _of, known, *_: fits.extend(known))
    pooled = pooled_of(tmp_path, {specimen: {"rig_friction": 0.025} for specimen in (21, 22, 23)})
    assert (pooled.verdict.kind, pooled.verdict.names) == ("found", ("rig_friction",))
    assert not any(d.verdict.kind == "found" for d in pooled.diagnoses)
    assert [fit.explanation.names for fit in fits] == [("rig_friction",)] * 3


@pytest.mark.full
def test_what_one_specimen_has_is_not_called_shared(tmp_path: Path) -> None:
    pooled = pooled_of(tmp_path, {21: {}, 22: {"bowstringing": 0.4}, 23: {}})
    assert (pooled.verdict.kind, pooled.verdict.names) == ("undecided", ())
    assert "in SIM-00022 bowstringing acts" in pooled.verdict.sentence
    assert (pooled.p_apart or 0.0) > 0.9


@pytest.mark.full
def test_what_no_effect_describes_lends_itself_to_none_that_is_shared(tmp_path: Path) -> None:
    assert not pooled_of(tmp_path, {21: {}, 22: {}}, "tissue_relaxation").verdict.names
