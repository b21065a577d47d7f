"""The stand-in that writes gauge voltages: by a made-up calibration or another, up to the end of the gauges' range."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from daq import drivers, standins
from daq.drivers.base import Samples
from daq.errors import DriverError
from daq.signals.gauges import read_calibration
from daq.standins.base import Floats, StandIn
from tests.daq.cal_files import nano17, numbers, write_cal

LOAD: Floats = np.random.default_rng(2).uniform(-1.0, 1.0, (50, 6)) * np.repeat([12.0, 90.0], 3)


def set_up(**given: float | str) -> StandIn:
    device = standins.stand_in("gauge-volts")()
    device.set_up(given)
    return device


def read(device: StandIn, wrench: Floats) -> Samples:
    count = np.arange(len(wrench))
    lines = device.encode(wrench, count, count.astype(np.float64))
    return drivers.driver(device.name)(device.driver_settings).decoder().feed(b"\n" + b"".join(lines))


def test_the_made_up_calibration_is_a_sound_one_of_no_real_cell() -> None:
    found = read_calibration(str(standins.stand_in("gauge-volts").settings["calibration"]))
    assert (found.serial, found.range_V, found.notes) == ("STAND-IN", 10.0, ())
    # As with real ones: each axis alone fits into the range of the gauges, all together do not.
    inverse = np.linalg.inv(found.matrix)
    alone = np.abs(inverse * found.full_scale).max()
    assert 5.0 < alone < 10.0 < (np.abs(inverse) @ found.full_scale).max()


@pytest.mark.parametrize(
    "given",
    [
        {},
        {"decimal": "comma"},
        {"columns": 9, "first_gauge": 3},
        {"volts_per_unit": 0.001},
        {"volts_per_unit": 5.0},
        {"zero_V": "0.5 -1 0.25 0 2 -0.1"},
        {"columns": 8, "first_gauge": 2, "decimal": "comma", "volts_per_unit": 0.001, "zero_V": "1 1 1 1 1 1"},
    ],
)
def test_what_it_writes_is_read_with_the_same_settings(given: dict[str, float | str], tmp_path: Path) -> None:
    for calibration in ({}, {"calibration": str(nano17(tmp_path))}):
        got = read(set_up(**calibration, **given), LOAD)
        assert got.rejected == 0
        assert not got.overload.any()
        # A millionth of a volt is some hundredths of a thousandth of a newton.
        assert got.wrench == pytest.approx(LOAD, abs=2e-4)


def test_beyond_its_range_a_gauge_stays_at_its_end_and_is_an_overload() -> None:
    wrench = np.zeros((3, 6))
    wrench[1:, 2] = 1e4, -1e4
    got = read(set_up(), wrench)
    assert got.overload.tolist() == [False, True, True]
    assert (np.abs(got.wrench[1:, 2]) < 300.0).all()


def test_what_cannot_be_set_is_said_in_one_line(tmp_path: Path) -> None:
    singular = numbers("nano17_FT14048")
    singular.pop("axis")
    singular["user_axis"]["Tz"] = singular["user_axis"]["Ty"]
    cases: list[tuple[str, dict[str, str], str]] = [
        ("gauge-volts", {"colour": "red"}, "has no setting colour"),
        ("gauge-volts", {"calibration": str(tmp_path / "none.cal")}, "none.cal cannot be read"),
        ("gauge-volts", {"calibration": str(write_cal(tmp_path / "flat.cal", singular))}, "six axes apart"),
        ("robotiq-ft300", {"calibration": "x"}, "for robotiq-ft300 has no setting calibration"),
    ]
    for name, given, said in cases:
        device = standins.stand_in(name)()
        with pytest.raises(DriverError, match=said) as caught:
            device.set_up(given)
        assert "\n" not in str(caught.value)
        # It stays as it was.
        assert device.driver_settings == dict(device.settings)
