"""A law that three specimens share and no catalogue has is found, said where it lives, and helps the one left out."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from fingermodel.diagnosis.posterior.optimum import Optimum
from fingermodel.diagnosis.search.beginning import Beginner
from fingermodel.diagnosis.session_model.candidates import Candidates
from fingermodel.diagnosis.session_model.session import session_of
from fingermodel.diagnosis.several_sessions.shared_finding import SharedFinding, shared_finding
from tests.shared_specimens import TorqueLaw, specimen

LAW = TorqueLaw("PIP", "FDS", "MCP", -2.5)
OTHERS = (TorqueLaw("DIP", "FDP", "", 0.8), TorqueLaw("MCP", "EDC", "PIP", 2.0))


def base_fit(folder: Path, seed: int, laws: tuple[TorqueLaw, ...]) -> Optimum:
    """The base model as a diagnosis of the session has it."""
    bench, observations = specimen(folder, seed, laws)
    return Beginner(session_of(bench.model, observations), Candidates.of(bench.model)).grossly().nothing


def found_in(
    tmp_path: Path, laws: dict[int, tuple[TorqueLaw, ...]], specimens: Sequence[str] | None = None
) -> SharedFinding:
    fits = [base_fit(tmp_path / str(seed), seed, acting) for seed, acting in laws.items()]
    names = [str(s) for s in laws]
    found = shared_finding(names, specimens or names, fits, permutations=99)
    assert found is not None
    return found


@pytest.mark.full
def test_a_shared_law_is_found_where_it_lives_and_by_its_formula(tmp_path: Path) -> None:
    found = found_in(tmp_path, dict.fromkeys((61, 62, 63), (LAW,)))
    assert found.is_shared, found.sentence
    assert found.permutation_p is not None
    assert found.permutation_p <= 0.02
    assert found.lacking == ()
    assert found.curve.stage == "arms"
    body = found.as_dict()
    assert (body["carried_by"][0]["muscle"], body["carried_by"][0]["joint"]) == ("FDS", "PIP")
    law = found.laws[0]
    assert LAW.formula in (law.name, *law.rivals)
    if law.name == LAW.formula:
        # The finger that it acts on is linearised, and was refitted without it.
        assert law.value == pytest.approx(LAW.k_mm, rel=0.05)
    assert (law.left_out_gain > 0.0).all()
    for errors in law.unseen:
        before, after = errors["tip"]
        assert after < before
    # The curve is the law's, within its band and what the anatomy may hide.
    part = found.curve.parts.index(("FDS", "PIP"))
    truth = LAW.k_mm * np.sin(found.curve.postures[:, found.curve.rotations.index("MCP")])
    assert np.corrcoef(truth, found.curve.mean[part])[0, 1] > 0.9
    assert body["laws"][0]["effect"]["source"].startswith("learned from 61, 62, 63")


@pytest.mark.full
def test_what_the_sessions_of_one_specimen_have_alone_is_chance(tmp_path: Path) -> None:
    laws = {61: (LAW,), 62: (LAW,), 63: (LAW,), 67: ()}
    found = found_in(tmp_path, laws, specimens=("A", "A", "A", "B"))
    # Of four specimens, three with the law would be no chance.
    assert found.permutation_p is not None
    assert found.permutation_p > 0.2
    assert not found.is_shared
    # What the law-less specimen shows says against it by far; a curve that is no law is worth about nothing elsewhere.
    gains = dict(zip(found.sessions, found.curve.left_out_gain, strict=True))
    assert gains["67"] < -5.0
    assert "67" in found.lacking
    assert min(gains[s] for s in ("61", "62", "63")) > -1.0


@pytest.mark.full
def test_what_each_has_of_its_own_is_not_shared(tmp_path: Path) -> None:
    found = found_in(tmp_path, {64: (LAW,), 65: (OTHERS[0],), 66: (OTHERS[1],)})
    assert not found.is_shared
    assert "nothing that stands out" in found.sentence


def test_nothing_is_shared_where_nothing_acts(tmp_path: Path) -> None:
    found = found_in(tmp_path, dict.fromkeys((67, 68, 69), ()))
    assert not found.is_shared
    # By chance each session's own errors resemble some law; none is offered.
    assert found.as_dict()["laws"] == []
