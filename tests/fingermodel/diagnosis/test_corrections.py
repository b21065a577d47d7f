"""What may have been entered wrongly in many cases alike: what counts as another entry, and what does not."""

from __future__ import annotations

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest

from fingermodel.diagnosis.session_model.session import session_of
from fingermodel.diagnosis.verdict.changes import Kind
from fingermodel.diagnosis.verdict.corrections import Entries
from fingermodel.diagnosis.verdict.instruments import FAULT_REMEDY
from fingermodel.session import Session

ONE_TARE = "one tare of each mount serves all its cases"


@pytest.mark.parametrize(("apart_N", "offered"), [(0.0, False), (0.01, False), (0.3, True)])
def test_tares_that_differ_by_no_more_than_noise_are_as_good_as_one(apart_N: float, offered: bool) -> None:
    """The first may fit better by chance; that is no fault, and would keep a true effect from being found."""
    bench = Session.open("DEV-01")
    rng, o = np.random.default_rng(1), bench.observations
    tared = np.ones((len(o.ids), 6))
    tared[:, :3] += apart_N * rng.standard_normal((len(o.ids), 3))
    tared[:, 3:] += 10.0 * apart_N * rng.standard_normal((len(o.ids), 3))
    session = session_of(bench.model, replace(o, tared=tared))
    words = {c.words for c in Entries(session, session.problem.centre).corrected()}
    assert (ONE_TARE in words) is offered
    assert any("taken away twice" in said for said in words)


def test_a_fault_of_tares_is_held_against_readings_with_as_little_noise() -> None:
    """Without their tares readings have less noise: that alone would speak for any fault of these."""
    bench = Session.open("DEV-01")
    rng, o = np.random.default_rng(1), bench.observations
    step = np.array([0.1, 0.3])[np.arange(len(o.ids)) * 2 // len(o.ids)][:, None]
    tared = step + 0.004 * rng.standard_normal((len(o.ids), 6))
    session = session_of(bench.model, replace(o, tared=tared))
    faults = [c for c in Entries(session, session.problem.centre).corrected() if c.kind == "tare"]
    assert {c.words for c in faults} >= {ONE_TARE}
    for fault in faults:
        assert fault.sound is not None
        off = o.wrench + tared - fault.sound.wrench - step
        assert np.nanmax(np.abs(off)) < 0.004


@pytest.mark.parametrize("kind", get_args(Kind))
def test_each_kind_of_fault_says_what_would_settle_it(kind: str) -> None:
    assert FAULT_REMEDY[kind]
