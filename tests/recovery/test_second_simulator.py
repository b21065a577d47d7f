"""The second simulator of sessions: it repeats itself, the project reads what it writes, and each effect shows."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from daq.sessions import read_session
from tests.second_simulator import Kind, write_session
from tests.second_simulator.draws import OUTSIDE, draw
from tests.second_simulator.effect_draws import CATALOGUE

FIRST_OF = {"a": 0, "b": 1, "c": 3}


@pytest.mark.parametrize("kind", ["two", "outside"])
def test_the_same_seed_gives_the_same_session(tmp_path: Path, kind: Kind) -> None:
    once, again = (write_session(tmp_path / name, kind, 7) for name in ("once", "again"))
    assert (once.effects, once.outside, once.rms_change_N) == (again.effects, again.outside, again.rms_change_N)
    for name in ("session.yaml", "readings.csv.gz"):
        assert (tmp_path / "once" / name).read_bytes() == (tmp_path / "again" / name).read_bytes()
    assert sorted(p.name for p in (tmp_path / "once").iterdir()) == ["readings.csv.gz", "session.yaml"]


@pytest.mark.parametrize("protocol", FIRST_OF)
def test_the_project_reads_its_sessions(tmp_path: Path, protocol: str) -> None:
    truth = write_session(tmp_path, "none", FIRST_OF[protocol])
    session = read_session(tmp_path)
    assert truth.protocol == protocol
    assert [c.id for c in session.cases] == list(truth.wrench)
    assert len(session.cases) == 96


def test_plain_sessions_differ_by_small_errors_only() -> None:
    """By some tenths of a newton, and by less where both are drawn from a smaller budget."""
    plain = [truth for truth in (draw("none", seed).truth for seed in range(9)) if truth.protocol == "a"]
    for one, other in combinations(plain, 2):
        differ = np.array([one.wrench[c] - other.wrench[c] for c in one.wrench])[:, :3]
        off = np.hypot(one.budget_factor, other.budget_factor)
        assert 0.01 < np.sqrt(np.mean(differ**2)) < 0.4 * off
        assert np.median(np.abs(differ)) < 0.4


@pytest.mark.parametrize("seed", range(len(CATALOGUE)), ids=CATALOGUE)
def test_each_effect_shows(seed: int) -> None:
    truth = draw("one", seed).truth
    assert truth.effects == (CATALOGUE[seed],)
    name = CATALOGUE[seed]
    assert truth.rms_change_N[name] > 1e-3 or truth.rms_change_Nmm[name] > 0.1


@pytest.mark.parametrize("seed", range(len(OUTSIDE)), ids=OUTSIDE)
def test_what_is_outside_shows(seed: int) -> None:
    truth = draw("outside", seed).truth
    assert (truth.outside, truth.effects) == (OUTSIDE[seed], ())
    assert truth.rms_change_N[OUTSIDE[seed]] > 0.05
