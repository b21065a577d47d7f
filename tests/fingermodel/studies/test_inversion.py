"""Inverse analysis of a session: what it finds of a load that is known, and its uncertainty."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest

from fingermodel import Session
from fingermodel.studies.inversion import invert_bench
from fingermodel.studies.inverted import Inversion

SESSION = "DEV-01"  # nothing is missing from its model
PUBLISHED = "synek2019_H01"  # forces alone, as published
Invert = Callable[[str], Inversion]


@pytest.fixture(scope="module")
def bench() -> Session:
    return Session.open(SESSION, catalogue=False)


@pytest.fixture(scope="module")
def inverted(bench: Session) -> Invert:
    return cache(partial(invert_bench, bench))


def test_every_case_at_the_tip_is_inverted(bench: Session, inverted: Invert) -> None:
    at_tip = [
        i for i, place, role in zip(
            bench.observations.ids, bench.observations.locations, bench.observations.roles, strict=True
        ) if place == "tip" and role != "check"
    ]  # fmt: skip
    for closure in ("minimal", "chao"):
        inversion = inverted(closure)
        assert [c.id for c in inversion.cases] == at_tip
        assert inversion.left_out == ()


def test_what_hung_is_found_where_the_closure_can_hold_it(inverted: Invert) -> None:
    """FDP alone meets every law of both closures; its load is then the answer, within its uncertainty."""
    for closure, flexor in (("minimal", "PF"), ("chao", "FDP")):
        alone = [c for c in inverted(closure).cases if {m for m, g in c.masses_g.items() if g} == {"FDP"}]
        assert len(alone) > 5
        z = [(c.muscles[flexor].force_N - (c.muscles[flexor].hung_N or 0.0)) / c.muscles[flexor].sd_N for c in alone]
        assert np.abs(z).max() < 3.0


def test_a_load_on_fds_alone_is_not_found_by_closures_that_merge_it(inverted: Invert) -> None:
    """An inverse analysis that fits every force exactly may still assign the wrong muscles."""
    alone = [c for c in inverted("chao").cases if {m for m, g in c.masses_g.items() if g} == {"FDS"}]
    assert alone
    assert any(abs(c.muscles["RI"].force_N) > 3.0 * c.muscles["RI"].sd_N for c in alone)
    assert any("RI" in c.pushes for c in alone)


def test_least_stress_never_pushes_and_says_what_it_cannot_hold(inverted: Invert) -> None:
    inversion = inverted("least_squares")
    assert all(not c.pushes for c in inversion.cases)
    assert all(a.force_N >= 0.0 for c in inversion.cases for a in c.muscles.values())
    short = [c for c in inversion.cases if c.unbalanced_Nmm > 0.0]
    assert any(f"In {len(short)} of {len(inversion.cases)} cases no tensions that pull" in n for n in inversion.notes)
    assert any(n.startswith("PCSA: Chao") for n in inversion.notes)


@pytest.mark.parametrize("closure", ["minimal", "chao"])
def test_a_push_is_reported_and_never_clipped(closure: str, inverted: Invert) -> None:
    inversion = inverted(closure)
    for case in inversion.cases:
        assert set(case.pushes) == {m for m, a in case.muscles.items() if a.force_N < -1e-9}
    for summary in inversion.muscles:
        assert summary.pushes == sum(summary.name in c.pushes for c in inversion.cases)
        assert summary.pushes_beyond_2sd <= summary.pushes
    assert any(c.pushes for c in inversion.cases)


def test_contact_forces_of_the_hung_load_are_the_models(bench: Session, inverted: Invert) -> None:
    inputs = bench.observations.inputs
    joint = np.asarray(bench.model.predict(inputs, bench.theta).joint)
    topology = bench.model.finger.topology
    for case in inverted("chao").cases[:8]:
        row = bench.observations.ids.index(case.id)
        for k, name in enumerate(j.name for j in topology.joints):
            assert case.contacts[name].hung_N == pytest.approx(float(np.linalg.norm(joint[row, k])), rel=1e-9)
            assert case.contacts[name].force_N == pytest.approx(float(np.linalg.norm(case.contacts_N[name])))


def test_published_forces_without_moments_are_inverted_by_least_stress() -> None:
    """32 measured tip forces: the moment that nobody read is free, and every one of them is balanced."""
    inversion = invert_bench(Session.open(PUBLISHED, "an1979_middle", catalogue=False), "least_squares")
    assert len(inversion.cases) == 32
    assert all(c.unread == ("Tz",) for c in inversion.cases)
    assert inversion.notes[0].startswith("Tz was not read in 32 of 32 cases")
    assert all(a.force_N >= 0.0 for c in inversion.cases for a in c.muscles.values())
    assert inversion.found > 10


def test_what_lacks_a_moment_is_left_out_and_named(bench: Session) -> None:
    observations = bench.observations
    wrench = observations.wrench.copy()
    wrench[2:, 5] = np.nan  # Tz, of all but the first two
    some = replace(bench, observations=replace(observations, wrench=wrench))
    chao, least = invert_bench(some, "chao"), invert_bench(some, "least_squares")
    assert [c.id for c in chao.cases] == list(observations.ids[:2])
    assert {c.id for c in least.cases} == {*observations.ids[:2], *chao.left_out}
    assert any(chao.left_out[0] in note for note in chao.notes)
    assert [c.unread for c in least.cases] == [(), (), *[("Tz",)] * (len(least.cases) - 2)]
    assert least.left_out == ()
