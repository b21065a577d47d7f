"""The covariance of readings by its parts is that of all of them, and grows with their number only."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray

from fingermodel import refit
from fingermodel.comparison.reading_noise import Noise, SharedTare
from fingermodel.session import Session

DATA = Path(__file__).parents[3] / "data"


@pytest.fixture(scope="module", params=["DEV-01", "synek2019_H01"])
def bench(request: pytest.FixtureRequest) -> Session:
    return Session.open(request.param, catalogue=False)


def test_the_parts_are_the_covariance_of_the_measured_session(bench: Session) -> None:
    observations, n = bench.observations, 6 * len(bench.measured.cases)
    spread = np.diag([bench.model.budget.reading_sd_N**2] * 3 + [(10 * bench.model.budget.reading_sd_N) ** 2] * 3)
    stated = np.array([0.0 if m.noise_stated else 1.0 for m in bench.measured.cases])
    expected = bench.measured.covariance() + np.kron(np.diag(stated), spread)
    whole = _whole(observations.noise)
    np.testing.assert_allclose(whole[:n, :n], expected, rtol=1e-9, atol=1e-15)
    apart = whole - observations.shared_tares @ observations.shared_tares.T
    blocks = np.kron(np.eye(len(observations.ids)), np.ones((6, 6)))
    np.testing.assert_allclose(apart * (1 - blocks), 0.0, atol=1e-15)
    every = np.arange(6)
    for k, own in enumerate(observations.noise.alone):
        np.testing.assert_allclose(apart[6 * k + every[:, None], 6 * k + every], own, atol=1e-15)


def test_an_averaged_moment_beside_a_stated_force_has_the_uncertainty_of_the_budget(tmp_path: Path) -> None:
    document = yaml.safe_load((DATA / "sessions/synek2019_H01/session.yaml").read_text(encoding="utf-8"))
    for case in document["cases"]:
        case.update(force_sd_N=0.05, torque_Nmm=[0.1, -0.2, 3.0])
    (tmp_path / "session.yaml").write_text(yaml.safe_dump(document), encoding="utf-8")
    session = Session.open(tmp_path, catalogue=False)
    sd = 10 * session.model.budget.reading_sd_N
    variance = session.observations.noise.variance.reshape(-1, 6)
    np.testing.assert_allclose(variance, np.tile([0.05**2] * 3 + [sd**2] * 3, (len(variance), 1)))
    assert refit(session).outcome == "converged"


def test_some_readings_have_their_part_of_the_covariance(bench: Session) -> None:
    noise = bench.observations.noise
    whole, rows = _whole(noise), np.arange(6 * len(noise.blocks))[1::5]
    np.testing.assert_allclose(noise.of(rows), whole[np.ix_(rows, rows)], rtol=1e-12, atol=1e-18)
    np.testing.assert_allclose(noise.variance, np.diag(whole), rtol=1e-12)


def _whole(noise: Noise) -> NDArray[np.float64]:
    return noise.of(np.arange(6 * len(noise.blocks)))


def test_readings_that_are_turned_have_the_covariance_turned() -> None:
    rng = np.random.default_rng(0)
    half, turn = rng.normal(size=(4, 6, 6)), rng.normal(size=(4, 6, 6))
    shared = (SharedTare(np.array([0, 2, 3]), rng.normal(size=(3, 6, 6))), SharedTare(np.array([1, 2]), half[:2]))
    blocks = half @ np.swapaxes(half, 1, 2)
    for tare in shared:
        blocks[tare.cases] += tare.columns @ np.swapaxes(tare.columns, 1, 2)
    noise = Noise(blocks, shared)
    whole = np.zeros((24, 24))
    for k, one in enumerate(turn):
        whole[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] = one
    turned = noise.turned(turn)
    after = _whole(turned)
    np.testing.assert_allclose(after, whole @ _whole(noise) @ whole.T)
    np.testing.assert_allclose(turned.tares, whole @ noise.tares)
    np.testing.assert_allclose(turned.blocks, [after[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] for k in range(4)])
