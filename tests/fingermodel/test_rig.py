"""The simulated rig: what it writes is a good session, and measures back to its own truth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from daq.checks import check
from daq.errors import InputError
from daq.measured import MeasuredCheck
from daq.recordings.readings import open_readings
from daq.sessions.protocols import plan, read_protocol
from daq.signals.corrections import measure
from daq.standins.simulated import LoadStep, SimulatedCell, readings
from fingermodel.comparison.observations import observe
from fingermodel.fingers.files import read_finger
from fingermodel.fitting.identification import refit_map
from fingermodel.rig import simulate_session
from fingermodel.session import Session
from tests.stated import stated_problem

CELL = SimulatedCell(rate_hz=50.0)


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, np.ndarray]]:
    folder = tmp_path_factory.mktemp("rig")
    finger, protocol = read_finger("an1979_middle"), read_protocol("synek2019")
    _, truth = simulate_session(finger, protocol, folder, cell=CELL, seed=4, readings_name="readings.parquet")
    return folder, truth


def test_a_simulated_session_passes_every_check(rig: tuple[Path, dict[str, np.ndarray]]) -> None:
    report = check(rig[0])
    assert report.ok
    assert not report.warnings


def test_it_measures_back_to_its_truth_within_the_stated_uncertainty(rig: tuple[Path, dict[str, np.ndarray]]) -> None:
    folder, truth = rig
    bench = Session.open(folder, catalogue=False)
    error = np.array([m.wrench - truth[m.case.id] for m in bench.measured.cases])
    sd = np.sqrt([np.diag(c) for c in bench.observations.case_covariance])
    z = error / sd
    assert 0.7 < np.sqrt(np.mean(z**2)) < 1.6
    assert np.abs(error[:, :3]).max() < 0.06


def test_an_effect_of_the_truth_acts_in_the_rig(rig: tuple[Path, dict[str, np.ndarray]], tmp_path: Path) -> None:
    """30 g more at every hanger pull as much as 30 g more in the protocol: the tip's force is linear in the weight."""
    finger, protocol = read_finger("an1979_middle"), read_protocol("synek2019")
    _, truth = simulate_session(finger, protocol, tmp_path, cell=CELL, seed=4, truth={"hanger_mass.m0": 30.0})
    alone = [c for c in plan(protocol)[0] if len(c.masses_g) == 1]
    assert len(alone) > 10
    for case in alone:
        (mass,) = case.masses_g.values()
        np.testing.assert_allclose(truth[case.id], rig[1][case.id] * (1.0 + 30.0 / mass), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(
    ("truth", "said"),
    [
        ({"hanger_mass": 30.0}, "no parameter 'hanger_mass' in this rig; expected hanger_mass.m0 [g], "),
        ({"hanger_mas.m0": 30.0}, "Did you mean hanger_mass.m0?"),
        ({"hanger_mass.m0": 1e4}, "hanger_mass.m0 is 10000; expected from 0 to 200 g"),
        ({"hanger_mass.m0": float("nan")}, "hanger_mass.m0 is nan"),
        ({"zero.bone.x": float("inf")}, "zero.bone.x is inf"),
    ],
)
def test_a_truth_that_no_rig_has_is_refused_in_one_line(truth: dict[str, float], said: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        simulate_session(read_finger("an1979_middle"), read_protocol("synek2019"), tmp_path / "s", truth=truth)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "s").exists()


def test_the_same_seed_writes_the_same_readings(tmp_path: Path) -> None:
    finger, protocol = read_finger("synek2019_optimised"), read_protocol("synek2019")
    texts = []
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        folder = tmp_path / name
        simulate_session(finger, protocol, folder, cell=CELL, seed=seed, readings_name="readings.csv")
        texts.append((folder / "readings.csv").read_bytes())
    assert texts[0] == texts[1]
    assert texts[0] != texts[2]


def test_a_session_of_any_length_is_written_in_blocks_of_one_size() -> None:
    steps = [LoadStep(0.0, np.zeros(6)), LoadStep(100.0, np.ones(6))]
    sizes = [len(block.t_s) for block in readings(CELL, steps, 1000.0, seed=0)]
    assert sum(sizes) == 50_000
    assert max(sizes) == 3000


def test_blocks_join_without_a_seam() -> None:
    """Noise and drift go on across blocks: the same record whatever the block's length, and no jump at a seam."""
    cell = replace(
        CELL, noise_sd=(0.0,) * 6, noise_correlation=0.9, resolution=(0.0,) * 6, drift_per_sqrt_hour=(0.5,) * 6
    )
    steps = [LoadStep(0.0, np.zeros(6))]
    record = np.concatenate([b.wrench for b in readings(cell, steps, 600.0, seed=3, block_s=60.0)])
    jumps = np.abs(np.diff(record, axis=0))
    seams = jumps[2999::3000]
    assert seams.max() < 6 * jumps.std()


def test_a_cell_saturates_at_its_full_scale() -> None:
    steps = [LoadStep(0.0, np.array([40.0, -40.0, 0, 0, 0, 900.0]))]
    block = next(iter(readings(CELL, steps, 10.0, seed=0)))
    assert block.wrench[:, 0].max() == pytest.approx(25.0, abs=0.01)
    assert block.wrench[:, 1].min() == pytest.approx(-25.0, abs=0.01)
    assert block.wrench[:, 5].max() == pytest.approx(250.0, abs=0.1)


def test_windows_keep_clear_of_every_change_of_load() -> None:
    protocol = read_protocol("levels")
    cases, end_s = plan(protocol, repeats=2)
    changes = np.array(sorted({c.load_start_s for c in cases} | {c.block_start_s for c in cases} | {end_s}))
    for c in cases:
        for start, end in (c.unloaded_s, c.loaded_s):
            assert start < end
            assert not np.any((changes > start) & (changes < end))
            assert np.min(np.abs(changes - end)) >= protocol.timing.guard_s - 1e-9
    assert len({c.id for c in cases}) == len(cases)


def test_readings_of_the_session_are_the_ones_it_names(rig: tuple[Path, dict[str, np.ndarray]]) -> None:
    source = open_readings(rig[0] / "readings.parquet")
    t = np.concatenate([b.t_s for b in source.blocks()])
    assert np.allclose(np.diff(t), 1 / 50.0)


@pytest.mark.parametrize(
    "text",
    [
        "format: protocol/2",
        "[1, 2]",
        "format: protocol/1\nid: x\npostures_deg: {}\ntiming: {tare_s: 1, load_s: 1, settle_s: 2, guard_s: 0}",
        "{",
    ],
)
def test_bad_protocols_get_one_line(text: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read_protocol(str(path))
    assert "\n" not in str(caught.value)


def test_known_weights_on_the_cell_enter_the_fit(rig: tuple[Path, dict[str, np.ndarray]]) -> None:
    """A cell that reads 1 % too much in y: the certificate's prior alone cannot know, a known weight can."""
    bench = Session.open(rig[0], catalogue=False)
    known = np.array([0.0, -19.62, 0.0])
    weighed = MeasuredCheck(
        force_N=known,
        wrench=np.concatenate([known * 1.01, np.zeros(3)]),
        covariance=np.diag([0.003**2] * 3 + [0.1**2] * 3),
        when="before",
        mount="tip",
        mass_g=2000.0,
    )
    before = _gain(bench, ())
    after = _gain(bench, (weighed,))
    assert after[0] == pytest.approx(0.01, abs=0.0015)
    assert after[1] < 0.5 * before[1]


def _gain(bench: Session, checks: tuple[MeasuredCheck, ...]) -> tuple[float, float]:
    measured = replace(measure(bench.measured.session), checks=checks)
    model = bench.model
    fit = refit_map(stated_problem(model, observe(measured, model.finger, replace(model.budget, cell_gain_sd=0.02))))
    gain = fit.parameter("cell_gain.Fy")
    assert gain.sd is not None
    return gain.value, gain.sd
