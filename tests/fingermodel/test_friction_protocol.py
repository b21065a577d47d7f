"""A simulated rig with friction follows the friction protocol, and the force balance finds what it holds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from daq.checks import check
from daq.recordings.readings import open_readings
from daq.sessions import read_session
from daq.sessions.protocols import plan, read_protocol
from daq.signals.corrections import measure
from daq.signals.friction import friction
from daq.standins.simulated import SimulatedCell
from fingermodel.fingers.files import read_finger
from fingermodel.rig import simulate_session
from server.commands.bench import friction_of

C, BAND = 0.835, 0.03


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("friction")
    cell = SimulatedCell(rate_hz=50.0, noise_correlation=0.3)
    simulate_session(
        read_finger("an1979_middle"), read_protocol("friction"), folder, cell=cell, tension_factor=C, friction_band=BAND
    )
    return folder


def test_the_band_is_found_within_its_uncertainty(rig: Path) -> None:
    result = friction([measure(read_session(rig))])
    assert [(d.name, d.n) for d in result.directions] == [("loading", 10), ("unloading", 10), ("tapped", 10)]
    assert [d.factor for d in result.directions] == pytest.approx([C * (1 - BAND), C * (1 + BAND), C], abs=0.002)
    assert len(result.bands) == 10
    z = []
    for band in result.bands:
        assert band.half_difference_sd is not None
        z.append((band.half_difference - C * BAND) / band.half_difference_sd)
    assert np.abs(z).max() < 4.0
    assert result.band is not None
    assert result.band.half_difference == pytest.approx(C * BAND, abs=5e-4)


def test_a_tare_that_both_directions_share_goes_out_of_their_difference(rig: Path) -> None:
    result = friction([measure(read_session(rig))])
    sd = {(c.posture, str(c.masses_g), c.direction): c.factor_sd for c in result.cases}
    for band in result.bands:
        apart = [sd[band.posture, str(band.masses_g), d] for d in ("loading", "unloading")]
        assert band.half_difference_sd is not None
        assert band.half_difference_sd < 0.5 * np.hypot(apart[0] or 0.0, apart[1] or 0.0)


def test_the_session_says_what_was_done_and_stands_the_check(rig: Path) -> None:
    session, (cases, _) = read_session(rig), plan(read_protocol("friction"))
    told = [{k: v for k in ("direction", "note", "repeat_of") if (v := getattr(c, k)) not in (None, "loading")}
            for c in session.cases]  # fmt: skip
    assert told == [c.told() for c in cases]
    report = check(rig)
    assert report.errors == report.warnings == ()
    # The overload is in the readings, and in no window.
    t, force = (np.concatenate(x) for x in zip(*((b.t_s, b.wrench[:, :3]) for b in open_readings(
        rig / "readings.csv.gz").blocks()), strict=True))  # fmt: skip
    over = next(c for c in cases if c.location == "bone" and c.overload_start_s is not None)
    assert over.overload_start_s is not None
    spans = (over.unloaded_s, (over.overload_start_s + 1.0, over.load_start_s), over.loaded_s)
    rest, overloaded, loaded = (force[(t > a) & (t < b)].mean(axis=0) for a, b in spans)
    assert (overloaded - rest)[0] == pytest.approx(1.2 * (loaded - rest)[0], rel=0.02)


def test_the_table_tells_directions_where_there_are_any(rig: Path, capsys: pytest.CaptureFixture[str]) -> None:
    friction_of([str(rig)], None)
    text = " ".join(capsys.readouterr().out.split())
    assert "unloading" in text
    assert "Mean of both directions 0.83" in text
    assert "half difference +0.02" in text
    friction_of(["DEV-01"], None)
    text = capsys.readouterr().out
    assert "unloading" not in text
    assert "direction" not in text
