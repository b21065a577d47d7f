from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daq.errors import ReadingsError, SessionError
from daq.measured import MeasuredSession
from daq.recordings.readings import ReadingBlock, open_readings, write_readings
from daq.recordings.windows import gather
from daq.sessions import parse_session, read_session
from daq.signals.corrections import assemble, measure, windows_of
from tests.daq.benches import RATE_HZ, SEGMENT_S, WRENCH, Floats, averaged, bench, creeping, in_blocks, record, recorded

TRUTH = Path(__file__).parents[2] / "truth"
ZERO = np.array([0.4, -1.2, 3.0, 7.0, -5.0, 2.0])


def residuals(name: str) -> tuple[MeasuredSession, Floats]:
    measured = measure(read_session(name))
    truth = {c["id"]: c["wrench"] for c in json.loads((TRUTH / f"{name}.json").read_text())["cases"]}
    return measured, np.array([m.wrench - truth[m.case.id] for m in measured.cases])


def test_the_tare_is_taken_away_exactly(tmp_path: Path) -> None:
    session = bench(tmp_path / "s", recorded(2), record([ZERO, ZERO + WRENCH, 2 * ZERO, 2 * ZERO - WRENCH]))
    measured = measure(session)
    np.testing.assert_allclose(measured.cases[0].wrench, WRENCH, atol=1e-12)
    np.testing.assert_allclose(measured.cases[1].wrench, -WRENCH, atol=1e-12)
    np.testing.assert_array_equal(measured.tare_weights, np.eye(2))
    assert measured.cases[0].has_torque
    assert measured.cases[0].noise_stated
    assert measured.tension_factor == 0.835


@pytest.mark.parametrize(("turned", "unread"), [({}, [4]), ({"rotation_deg": [0, 0, 30]}, [3, 4])])
def test_a_moment_that_never_changes_is_not_read(turned: dict[str, Any], unread: list[int], tmp_path: Path) -> None:
    data = recorded(2)
    data["load_cell"]["mounts"]["tip"] |= turned
    levels = [ZERO, ZERO + WRENCH, 2 * ZERO, 2 * ZERO - WRENCH]
    live = measure(bench(tmp_path / "live", data, record(levels, noise=0.02)))
    block = record(levels, noise=0.02)
    block.wrench[:, 4] = 1.5
    dead = measure(bench(tmp_path / "dead", data, block))
    read = np.setdiff1d(np.arange(6), unread)
    for case, whole in zip(dead.cases, live.cases, strict=True):
        assert whole.has_torque
        assert not case.has_torque
        assert np.flatnonzero(np.isnan(case.wrench)).tolist() == unread
        np.testing.assert_allclose(case.wrench[read], whole.wrench[read], atol=1e-12)


def test_a_force_that_never_changes_is_told_to_whoever_would_fit_it(tmp_path: Path) -> None:
    levels = [ZERO, ZERO + WRENCH, 2 * ZERO, 2 * ZERO - WRENCH]
    block = record(levels, noise=0.02)
    measure(bench(tmp_path / "live", recorded(2), block)).require_forces()
    block.wrench[:, 1] = 0.0
    dead = measure(bench(tmp_path / "dead", recorded(2), block))
    assert dead.dead_forces == ("Fy_N",)
    with pytest.raises(SessionError, match="Fy_N never changes in any window; expected the noise of a live channel"):
        dead.require_forces()


@pytest.mark.parametrize("share", [0.0, 0.1, -0.05])
def test_creep_within_the_windows_is_a_share_of_the_force(share: float, tmp_path: Path) -> None:
    data, block = creeping(share)
    start, end = data["cases"][0]["loaded_s"]
    measured = measure(bench(tmp_path / "s", data, block))
    assert measured.creep == pytest.approx(share * (end - start) / SEGMENT_S, rel=0.1, abs=1e-12)


def test_a_force_that_never_changes_stays_as_it_was_read(tmp_path: Path) -> None:
    block = record([ZERO, ZERO + WRENCH], noise=0.02)
    block.wrench[:, 1] = 1.5
    assert measure(bench(tmp_path / "s", recorded(1), block)).cases[0].wrench[1] == pytest.approx(0.0, abs=1e-9)


def test_two_tares_take_a_straight_drift_away_exactly(tmp_path: Path) -> None:
    def drift(t: Floats) -> Floats:
        return np.outer(t, [0.05, -0.1, 0.02, 1.0, 0.3, -0.7])

    data = recorded(3, after=True)
    levels = [ZERO, ZERO + WRENCH] * 3 + [ZERO]
    measured = measure(bench(tmp_path / "s", data, record(levels, drift=drift)))
    for m in measured.cases:
        np.testing.assert_allclose(m.wrench, WRENCH, atol=1e-9)
    np.testing.assert_allclose(measured.tare_weights.sum(axis=1), 1.0)
    np.testing.assert_allclose(measured.tare_weights[1, 1:3], 0.5)
    assert len(measured.tares) == 4


def test_shared_tares_correlate_cases_and_bracketing_adds_what_the_zero_wanders(tmp_path: Path) -> None:
    data = recorded(3)
    for case in data["cases"]:
        case["unloaded_s"] = data["cases"][0]["unloaded_s"]
    levels = [ZERO, ZERO + WRENCH, ZERO, ZERO + WRENCH, ZERO, ZERO + WRENCH, ZERO]
    block = record(levels, noise=0.05)
    measured = measure(bench(tmp_path / "one", data, block))
    C = measured.covariance().reshape(3, 6, 3, 6)
    tare = measured.tares[0].covariance
    np.testing.assert_allclose(C[0, :, 2, :], tare)
    np.testing.assert_allclose(C[1, :, 1, :], measured.cases[1].covariance + tare)
    np.testing.assert_allclose(measured.covariance([2, 0])[:6, :6], measured.case_covariance(2))
    assert np.linalg.eigvalsh(measured.covariance()).min() > 0.0

    bracketed = measure(bench(tmp_path / "two", recorded(3, after=True), block))
    i = 1
    t0, t1 = bracketed.tares[1].mid_s, bracketed.tares[2].mid_s
    rate = (bracketed.tares[2].mean - bracketed.tares[1].mean) ** 2 / (t1 - t0)
    plateau = bracketed.cases[i].plateau
    assert plateau is not None
    added = np.diag(bracketed.cases[i].covariance - plateau.covariance)
    assert np.all(added >= rate * (t1 - t0) / 4 - 1e-12)
    both = bracketed.case_covariance(i) - bracketed.cases[i].covariance
    np.testing.assert_allclose(both, 0.25 * (bracketed.tares[1].covariance + bracketed.tares[2].covariance))


@pytest.mark.parametrize("rows", [1, 7, 250, 100_000])
def test_the_size_of_blocks_changes_nothing(rows: int) -> None:
    session, _ = parse_session(recorded(2, after=True), None)
    assert session is not None
    block = record([ZERO, ZERO + WRENCH] * 2 + [ZERO], noise=0.05)
    windows = windows_of(session)
    whole = assemble(session, gather([block], windows, "r").plateaus)
    cut = assemble(session, gather(in_blocks(block, rows), windows, "r").plateaus)
    for a, b in zip(whole.cases, cut.cases, strict=True):
        np.testing.assert_array_equal(a.wrench, b.wrench)
        np.testing.assert_array_equal(a.covariance, b.covariance)
    np.testing.assert_array_equal(whole.covariance(), cut.covariance())


@given(st.lists(st.tuples(st.floats(0, 19), st.floats(0.2, 10)), min_size=1, max_size=8), st.integers(1, 900))
@settings(max_examples=30, deadline=None)
def test_any_windows_are_gathered_whole(spans: list[tuple[float, float]], rows: int) -> None:
    block = record([ZERO, WRENCH] * 3, noise=0.05)
    windows = {(a, min(a + length, 23.9)): "w" for a, length in spans}
    plateaus = gather(in_blocks(block, rows), windows, "r").plateaus
    for (start, end), plateau in plateaus.items():
        inside = (block.t_s >= start) & (block.t_s <= end)
        assert plateau.readings == inside.sum()
        # To the rounding errors of what is summed: a mean may be next to nothing.
        size = np.abs(block.wrench[inside]).max(axis=0)
        assert (np.abs(plateau.mean - block.wrench[inside].mean(axis=0)) <= 1e-12 * size).all()


def test_both_ends_of_a_window_belong_to_it() -> None:
    block = record([ZERO])
    plateau = gather([block], {(1.0, 2.0): "w"}, "r").plateaus[1.0, 2.0]
    assert plateau.readings == round(RATE_HZ) + 1
    assert (plateau.start_s, plateau.end_s) == (1.0, 2.0)


def test_progress_runs_to_one(tmp_path: Path) -> None:
    session = bench(tmp_path / "s", recorded(), record([ZERO, WRENCH]))
    seen: list[float] = []
    measure(session, seen.append)
    assert seen == sorted(seen)
    assert seen[-1] == 1.0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"loaded_s": [7.0, 9.5]}, ["case c001: loaded_s", "[7, 9.5] s", "outside the recording", "0 to 7.99 s"]),
        ({"loaded_s": [100.0, 101.0]}, ["case c001: loaded_s", "outside the recording"]),
        ({"unloaded_s": [-5.0, -1.0]}, ["case c001: unloaded_s", "outside the recording"]),
        ({"unloaded_s": [-1.0, 2.0]}, ["case c001: unloaded_s", "outside the recording"]),
        ({"loaded_s": [5.001, 5.036]}, ["case c001: loaded_s", "holds 3 readings", "at least 5"]),
    ],
)
def test_windows_that_cannot_be_read(change: dict[str, Any], words: list[str], tmp_path: Path) -> None:
    data = recorded()
    data["cases"][0].update(change)
    session = bench(tmp_path / "s", data, record([ZERO, WRENCH]))
    with pytest.raises(ReadingsError) as caught:
        measure(session)
    assert all(word in str(caught.value) for word in words)


@pytest.mark.parametrize("at", [1, 399, 400])
def test_time_that_does_not_increase(at: int, tmp_path: Path) -> None:
    block = record([ZERO, WRENCH])
    block.t_s[at] = block.t_s[at - 1]
    session = bench(tmp_path / "s", recorded(), block)
    with pytest.raises(ReadingsError, match=rf"in row {at + 1} of readings\.csv"):
        measure(session)
    with pytest.raises(ReadingsError, match=rf"in row {at + 1} of"):
        gather(in_blocks(block, 100), {}, "r")


def test_the_load_must_lie_between_its_tares(tmp_path: Path) -> None:
    data = recorded(2, after=True)
    data["cases"][0]["unloaded_s"] = [12.5, 15.5]
    data["cases"][0]["unloaded_after_s"] = [16.5, 19.5]
    session = bench(tmp_path / "s", data, record([ZERO, WRENCH] * 2 + [ZERO]))
    with pytest.raises(SessionError, match="case c001: loaded_s does not lie between"):
        measure(session)


def test_excluded_cases_are_left_out_even_with_bad_windows(tmp_path: Path) -> None:
    data = recorded(2)
    data["cases"][1].update(excluded="weight touched the frame", loaded_s=[500, 501])
    measured = measure(bench(tmp_path / "s", data, record([ZERO, WRENCH])))
    assert [m.case.id for m in measured.cases] == ["c001"]
    assert measured.covariance().shape == (6, 6)


def test_averaged_forces_keep_their_uncertainty_or_say_that_there_is_none() -> None:
    data = averaged()
    data["cases"][0].update(force_sd_N=[0.1, 0.2, 0.3], torque_Nmm=[1, 2, 3])
    more = [dict(data["cases"][0], id="c003"), dict(data["cases"][0], id="c004")]
    del more[0]["force_sd_N"]
    more[0]["force_cov_N2"] = [[0.01, 0.001, 0], [0.001, 0.01, 0], [0, 0, 0.01]]
    more[1]["force_sd_N"] = 0.05
    data["cases"] += more
    session, _ = parse_session(data, None)
    assert session is not None
    measured = measure(session)
    first, second, third, fourth = measured.cases
    np.testing.assert_allclose(first.wrench, [-0.9, -2.0, 0.05, 1, 2, 3])
    np.testing.assert_allclose(np.diag(first.covariance), [0.01, 0.04, 0.09, 0, 0, 0])
    assert first.noise_stated
    assert not second.noise_stated
    assert np.isnan(second.wrench[3:]).all()
    assert not second.has_torque
    assert third.covariance[0, 1] == 0.001
    assert fourth.covariance[2, 2] == pytest.approx(0.0025)
    assert measured.tare_weights.shape == (4, 0)
    assert measured.covariance().shape == (24, 24)


def test_known_weights_are_measured_in_mount_axes(tmp_path: Path) -> None:
    data = recorded(2)
    data["load_cell"]["mounts"]["tip"] = {"rotation_deg": [0, 0, 90]}
    data["specimen"]["side"] = "right"
    first, second = data["cases"]
    data["checks"] = [
        {
            "when": "before",
            "mount": "tip",
            "mass_g": 200,
            "direction": "palmar",
            "unloaded_s": first["unloaded_s"],
            "loaded_s": first["loaded_s"],
        }
    ]
    data["cases"] = [second]
    pull = 0.2 * 9.81
    # R takes the cell's -x to the mount's -y.
    on_cell = np.array([-pull, 0, 0, 0, 0, 0])
    measured = measure(bench(tmp_path / "s", data, record([ZERO, ZERO + on_cell, ZERO, ZERO])))
    (check,) = measured.checks
    np.testing.assert_allclose(check.force_N, [0, -pull, 0], atol=1e-12)
    np.testing.assert_allclose(check.wrench[:3], check.force_N, atol=1e-12)
    assert (check.when, check.mount, check.mass_g) == ("before", "tip", 200)


def test_other_units_give_the_same_forces(tmp_path: Path) -> None:
    block = record([ZERO, ZERO + WRENCH], noise=0.02)
    expected = measure(bench(tmp_path / "a", recorded(), block)).cases[0].wrench
    folder = tmp_path / "b"
    write_readings(folder / "readings.csv", [ReadingBlock(block.t_s * 1e3, block.wrench / 4.4482216152605)])
    path = folder / "readings.csv"
    text = path.read_text().replace(
        "t_s,Fx_N,Fy_N,Fz_N,Tx_Nmm,Ty_Nmm,Tz_Nmm", "t_ms,Fx_lbf,Fy_lbf,Fz_lbf,Tx_a,Ty_a,Tz_a"
    )
    path.write_text(text.replace("_a", "_Nmm"))
    measured = measure(bench(folder, recorded()))
    np.testing.assert_allclose(measured.cases[0].wrench[:3], expected[:3], rtol=1e-9)
    assert any("Fx_lbf × 4.448221615 = Fx_N" in note for note in measured.notes)


def test_damaged_readings_are_refused(tmp_path: Path) -> None:
    session = bench(tmp_path / "s", recorded(), record([ZERO, WRENCH]))
    path = tmp_path / "s" / "readings.csv"
    path.write_text(path.read_text()[:-9] + "\n")
    with pytest.raises(ReadingsError):
        measure(session)
    assert open_readings(path).kind == "csv"


def test_stated_uncertainties_of_the_simulated_sessions_come_true() -> None:
    """Whitened residuals against the truth: not too small, not too large. DEV-10's truth leaves its drift out."""
    whitened = []
    for k in [*range(1, 10), 11, 12]:
        measured, error = residuals(f"DEV-{k:02d}")
        whitened.append(np.linalg.solve(np.linalg.cholesky(measured.covariance()), error.ravel()).reshape(-1, 6))
    z2 = np.concatenate(whitened) ** 2
    assert 0.93 < z2.mean() < 1.10
    np.testing.assert_allclose(z2.mean(axis=0), 1.0, atol=0.15)
    assert np.mean(z2 > 1.96**2) == pytest.approx(0.05, abs=0.015)


def test_drift_is_left_in_the_readings_of_a_session_with_single_tares() -> None:
    measured, error = residuals("DEV-10")
    since = np.array([m.loaded_mid_s - m.unloaded_mid_s for m in measured.cases if m.loaded_mid_s and m.unloaded_mid_s])
    early = np.array([m.loaded_mid_s is not None and m.loaded_mid_s < 84 for m in measured.cases])
    assert np.corrcoef(since[early], error[early, 2])[0, 1] > 0.9


def test_segments_are_as_the_tests_assume() -> None:
    assert SEGMENT_S * RATE_HZ == 400
