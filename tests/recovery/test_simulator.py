"""The simulator of sessions: at rest it is the model, each effect shows, what it writes measures back to its truth."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from daq.checks import check
from daq.sessions import read_session
from daq.signals.corrections import measure
from fingermodel.fingers.files import read_finger
from fingermodel.model import clamp_forces_batch, jax_values
from fingermodel.session import Session
from tests.simulator import CATALOGUE, OUTSIDE, PROTOCOLS, Size, Truth, draw_session, draw_truth
from tests.simulator.finger import ROTATIONS, finger_forces, read_numbers

NAMES = [
    "hanger_mass",
    "rig_friction",
    "worn_pulley",
    "sheath_friction",
    "fdp_fds_coupling",
    "lumbrical_on_fdp",
    "hood_shift",
    "lateral_band_slip",
    "bowstringing",
    "intrinsic_bowstring",
    "centre_migration",
    "axis_tilt",
    "segment_length",
    "tip_location",
    "goniometer_bias",
    "clamp_compliance",
    "volar_plate",
    "joint_friction",
    "suture_angle",
    "cell_rotation",
    "cell_crosstalk",
    "zero_offset",
    "tare_drift",
]


def full(name: str, share: float = 0.5) -> dict[str, Size]:
    """An effect at a share of its range, in all its places."""
    effect = CATALOGUE[name]
    return {name: tuple([share * effect.high] * len(effect.places))}


def change(truth: Truth) -> np.ndarray:
    """What the effects change, (cases, 6)."""
    return np.array([truth.wrench[c] - truth.plain[c] for c in truth.wrench])


def chosen(protocol: str, **wanted: str) -> np.ndarray:
    """Which cases have these attributes; `only` and `one_of` say which tendons are loaded."""
    only, one_of = wanted.pop("only", ""), wanted.pop("one_of", "")
    return np.array(
        [
            all(getattr(c, k) == v for k, v in wanted.items())
            and (not only or set(c.masses_g) == {only})
            and (not one_of or one_of in c.masses_g)
            for c in PROTOCOLS[protocol]().cases
        ]
    )


@pytest.mark.parametrize("protocol", list(PROTOCOLS))
def test_with_nothing_wrong_it_is_the_model(protocol: str, tmp_path: Path) -> None:
    truth = draw_session(tmp_path, 1, protocol=protocol, nuisance_scale=0.0)
    bench = Session.open(tmp_path, catalogue=False)
    predicted = bench.model.predict(bench.observations.inputs)
    ours = np.array([truth.wrench[i] for i in bench.observations.ids])
    assert len(ours) == len(truth.wrench) == len(PROTOCOLS[protocol]().cases)
    assert np.abs(ours - np.asarray(predicted.reading)).max() < 1e-9


def test_tip_and_bone_are_the_models_in_any_posture() -> None:
    rng = np.random.default_rng(3)
    finger, numbers = read_finger("an1979_middle"), read_numbers()
    assert finger.topology.rotations == ROTATIONS
    posture = rng.uniform([-0.6, -0.3, -0.3, -0.3], [0.8, 0.3, 0.9, 0.8], (100, 4))
    tension = rng.uniform(0.0, 9.0, (100, 6))
    forces = clamp_forces_batch(finger.topology, jax_values(finger.values), posture, tension)
    ours = [finger_forces(numbers, q, t) for q, t in zip(posture, tension, strict=True)]
    assert np.abs(np.array([tip for tip, _ in ours]) - np.asarray(forces.tip)).max() < 1e-9
    assert np.abs(np.array([bone for _, bone in ours]) - np.asarray(forces.bone)).max() < 1e-9


def test_every_effect_of_the_catalogue_is_there() -> None:
    assert sorted(CATALOGUE) == sorted(NAMES)
    assert len(OUTSIDE) >= 6
    assert "mcp_axis_order" in OUTSIDE


@pytest.mark.parametrize("name", NAMES)
def test_every_effect_changes_readings_and_none_at_no_size(name: str, tmp_path: Path) -> None:
    truth = draw_session(tmp_path, 2, full(name))
    assert truth.effects == (name,)
    at_tip = chosen("dev", location="tip")
    largest = np.abs(change(truth)).max(axis=0)
    # Where the clamp holds the tip shows in the moment alone.
    assert (largest[5] > 3.0) if name == "tip_location" else (largest[:3].max() > 0.1)
    if name == "suture_angle":
        assert np.abs(change(truth)[at_tip]).max() == 0.0
    nothing = draw_session(tmp_path, 2, full(name, 0.0))
    assert np.abs(change(nothing)).max() < 1e-9
    assert nothing.sizes == {}


@pytest.mark.parametrize("protocol", list(PROTOCOLS))
@pytest.mark.parametrize("name", list(OUTSIDE))
def test_what_is_outside_changes_the_forces_by_what_is_wanted(name: str, protocol: str, tmp_path: Path) -> None:
    for seed in (1, 2):
        truth = draw_session(tmp_path, seed, None, name, protocol)
        assert truth.effects == ()
        assert truth.outside == name
        assert OUTSIDE[name].low <= truth.sizes[name] <= OUTSIDE[name].high
        # Moments betray a clamp that resists twist; its forces hardly change.
        least = 0.03 if name == "clamp_moments" else 0.07
        assert least < truth.change_where_it_acts_N < 0.52
        if name == "clamp_moments":
            assert np.abs(change(truth)[:, 3:5]).max() > 1.0


def test_effects_act_where_they_should(tmp_path: Path) -> None:
    def moved(effects: dict[str, Size], outside: str | None = None) -> np.ndarray:
        truth = draw_session(tmp_path, 5, effects, outside, nuisance_scale=0.0)
        out: np.ndarray = np.linalg.norm(change(truth)[:, :3], axis=1)
        return out

    fds = chosen("dev", one_of="FDS")
    worn = moved({"worn_pulley.FDS": 0.2})
    assert worn[fds].min() > 0.02
    assert worn[~fds].max() < 1e-12
    both = chosen("dev", one_of="FDP") & chosen("dev", one_of="LU")
    assert np.array_equal(moved({"lumbrical_on_fdp": 0.8}) > 1e-9, both)
    at_bone = chosen("dev", location="bone")
    assert np.array_equal(moved({"zero_offset.bone": (0.3, 0.2, -0.1)}) > 1e-9, at_bone)
    plate = moved({"volar_plate": 0.9})
    assert plate[chosen("dev", posture="hyperextension", only="EDC")].min() > 0.1
    assert plate[chosen("dev", only="FDP")].max() < 1e-12
    assert plate[chosen("dev", posture="relaxed")].max() < 1e-3
    edc = moved({}, "edc_subluxation")
    assert edc[~chosen("dev", one_of="EDC")].max() < 1e-12
    shunt = moved({}, "force_shunt") > 1e-9
    assert not (shunt & at_bone).any() or not (shunt & ~at_bone).any()
    drift = moved({"tare_drift": (0.8, 0.0, 0.0)})
    cases = PROTOCOLS["dev"]().cases
    first = [c.id == "c001" for c in cases]
    last = [c.id == "c016" for c in cases]
    assert drift[last].item() > 10 * drift[first].item()


def test_the_balance_of_tip_and_bone_tells_what_torque_effects_leave_alone(tmp_path: Path) -> None:
    """Tissue at the joints moves force from the tip to the bone; the sum stays that of the tendons."""
    for name in ("joint_friction", "volar_plate", "bowstringing", "sheath_friction"):
        truth = draw_session(tmp_path, 4, full(name), nuisance_scale=0.0)
        cases = {c.id: c for c in PROTOCOLS["dev"]().cases}
        by_place = {(c.posture, c.location, str(dict(c.masses_g))): i for i, c in cases.items()}
        pairs = 0
        for (posture, location, masses), i in by_place.items():
            other = by_place.get((posture, "tip", masses))
            if location != "bone" or other is None:
                continue
            pairs += 1
            angles = PROTOCOLS["dev"]().postures_deg[posture]
            total = np.deg2rad(angles["MCP"] + angles["PIP"] + angles["DIP"])
            turn = np.array([[np.cos(total), -np.sin(total), 0], [np.sin(total), np.cos(total), 0], [0, 0, 1]])
            pull = sum(cases[i].masses_g.values()) * 9.81e-3 * 0.835
            assert np.abs(truth.wrench[i][:3] + turn @ truth.wrench[other][:3] - [pull, 0, 0]).max() < 1e-9
        assert pairs > 10


@pytest.mark.parametrize("protocol", list(PROTOCOLS))
@pytest.mark.parametrize("seed", [3, 8, 9])
def test_what_it_writes_passes_every_check(seed: int, protocol: str, tmp_path: Path) -> None:
    draw_session(tmp_path, seed, protocol=protocol, nuisance_scale=1.0)
    report = check(tmp_path)
    assert report.ok
    assert not report.warnings


@pytest.mark.parametrize(
    ("seed", "effects", "outside", "protocol"),
    [
        (11, {}, None, "dev"),
        (12, {}, None, "three_levels"),
        (13, {"hanger_mass": 40.0, "tare_drift": (0.7, -0.4, 0.5)}, None, "dev"),
        (14, {}, "seating", "three_levels"),
    ],
)
def test_readings_measure_back_to_the_truth(
    seed: int, effects: dict[str, Size], outside: str | None, protocol: str, tmp_path: Path
) -> None:
    truth = draw_session(tmp_path, seed, effects, outside, protocol)
    measured = measure(read_session(tmp_path))
    error = np.array([m.wrench - truth.wrench[m.case.id] for m in measured.cases])
    sd = np.sqrt([np.diag(measured.case_covariance(i)) for i in range(len(measured.cases))])
    z = error / sd
    assert np.abs(z).max() < 5.0
    assert 0.5 < np.sqrt(np.mean(z**2)) < 1.6


def test_the_seed_settles_everything(tmp_path: Path) -> None:
    def wrote(name: str, seed: int, effects: dict[str, Size]) -> tuple[Truth, bytes, bytes]:
        folder = tmp_path / name
        truth = draw_session(folder, seed, effects)
        return truth, (folder / "session.yaml").read_bytes(), (folder / "readings.parquet").read_bytes()

    one, one_yaml, one_readings = wrote("a", 21, {"hanger_mass": 30.0})
    two, two_yaml, two_readings = wrote("b", 21, {"hanger_mass": 30.0})
    bare, bare_yaml, _ = wrote("c", 21, {})
    other, _, other_readings = wrote("d", 22, {"hanger_mass": 30.0})
    assert (one_yaml, one_readings) == (two_yaml, two_readings)
    assert all(np.array_equal(one.wrench[c], two.wrench[c]) for c in one.wrench)
    assert one_readings != other_readings
    assert one.nuisance_scale != other.nuisance_scale
    # The same specimen, rig and file beside what the effect does; the file tells nothing of it.
    assert all(np.array_equal(one.plain[c], bare.wrench[c]) for c in one.wrench)
    assert one_yaml == bare_yaml


def test_what_is_hidden_is_drawn_from_the_plausible_ranges() -> None:
    seen: set[str] = set()
    signs: set[float] = set()
    for seed in range(300):
        nothing, one, two, out = (draw_truth(kind, seed) for kind in ("none", "one", "two", "outside"))
        assert nothing == ({}, None)
        assert out.effects == {}
        assert out.outside in OUTSIDE
        assert one.outside is None
        assert len({key.partition(".")[0] for key in two.effects}) == 2
        ((key, size),) = one.effects.items()
        name = key.partition(".")[0]
        effect, largest = CATALOGUE[name], np.abs(np.atleast_1d(size)).max()
        assert 0.3 * effect.high <= largest <= effect.high
        signs |= set(np.sign(np.atleast_1d(size)).tolist()) if effect.low < 0.0 else set()
        assert effect.low < 0.0 or np.min(size) >= 0.0
        seen.add(name)
    assert seen == set(NAMES)
    assert signs == {-1.0, 1.0}
    assert draw_truth("two", 7) == draw_truth("two", 7)


def test_wrong_names_and_sizes_are_refused(tmp_path: Path) -> None:
    with pytest.raises(KeyError, match="not in the catalogue"):
        draw_session(tmp_path, 1, {"gremlins": 1.0})
    with pytest.raises(ValueError, match="goniometer_bias"):
        draw_session(tmp_path, 1, {"goniometer_bias": 3.0})
    with pytest.raises(KeyError, match="gremlins"):
        draw_session(tmp_path, 1, outside="gremlins")


def test_it_shares_no_code_with_the_product() -> None:
    code = "import json, sys, tests.simulator; print(json.dumps(sorted({m.partition('.')[0] for m in sys.modules})))"
    done = subprocess.run(  # noqa: S603
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
        cwd=Path(__file__).parents[2],
    )
    assert set(json.loads(done.stdout)).isdisjoint({"daq", "fingermodel", "server", "jax", "jaxlib", "scipy"})


def test_further_cases_leave_the_readings_before_them_as_they_were(tmp_path: Path) -> None:
    further = [("hook", "tip", {"FDP": 500.0}), ("hook", "bone", {"FDS": 400.0})]
    short = draw_session(tmp_path / "short", 3, {"hanger_mass": 30.0})
    long = draw_session(tmp_path / "long", 3, {"hanger_mass": 30.0}, further=further)
    for name, wrench in short.wrench.items():
        np.testing.assert_array_equal(long.wrench[name], wrench)
    before, after = (pq.read_table(tmp_path / n / "readings.parquet") for n in ("short", "long"))
    assert after.slice(0, len(before)).equals(before)
    session = read_session(tmp_path / "long")
    new = [c for c in session.cases if c.id not in short.wrench]
    assert [(c.posture, c.location, dict(c.masses_g)) for c in new] == further
    assert [c.setting for c in new] == [1, 2]
