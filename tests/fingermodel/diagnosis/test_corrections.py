"""What may have been entered wrongly in many cases alike: what counts as another entry, and what does not."""

from __future__ import annotations

from dataclasses import replace
from typing import get_args

import jax.numpy as jnp
import numpy as np
import pytest

from fingermodel.diagnosis.posterior.fitting import Fitter
from fingermodel.diagnosis.posterior.hyper import Hyperparameters
from fingermodel.diagnosis.session_model.candidates import NOTHING, Candidates
from fingermodel.diagnosis.session_model.session import session_of
from fingermodel.diagnosis.verdict.changes import Kind, changes, told
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


@pytest.mark.parametrize(("saying", "sign"), [("while the tare was taken", -1.0), ("besides in all cases", 1.0)])
def test_a_load_that_was_left_hanging_is_told_with_its_weight(saying: str, sign: float) -> None:
    bench = Session.open("DEV-01")
    o, muscles = bench.observations, bench.model.finger.topology.muscles
    session = session_of(bench.model, o)
    about = [c for c in changes(session) if saying in c.saying and " FDP " in c.saying]
    block = about[0].cases
    assert len(about) == (np.unique(o.tared, axis=0, return_counts=True)[1] > 1).sum()
    tension = np.array(o.inputs.tension)
    tension[block, muscles.index("FDP")] += sign * 200.0 * np.asarray(o.inputs.weight)[block]
    read = bench.model.predict(o.inputs._replace(tension=jnp.asarray(tension)), session.problem.centre).reading
    wrong = session_of(bench.model, replace(o, wrench=np.asarray(read)))
    hyper = Hyperparameters.of(wrong)
    fitter = Fitter(wrong, Candidates.of(bench.model), hyper)
    fit = fitter.linearised(NOTHING, wrong.problem.centre, hyper.start(0), frozenset(), 0.0)
    gains = told(fit, fit.node, about)
    assert max(gains, key=lambda of: of[1])[0].cases.tolist() == block.tolist()
    assert "about 200 g hung on FDP" in gains[0][0].words
    # Put right, nothing is left to explain.
    right = Entries(wrong, wrong.problem.centre).put_right(gains[0][0])
    assert np.abs(right.away).max() < 0.02 * np.abs(Entries(wrong, wrong.problem.centre).away).max()


@pytest.mark.parametrize("kind", get_args(Kind))
def test_each_kind_of_fault_says_what_would_settle_it(kind: str) -> None:
    assert FAULT_REMEDY[kind]
