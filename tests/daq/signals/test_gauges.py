"""ATI calibration files: two real ones give the maker's numbers, and what cannot be used is said in one line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daq.errors import DriverError
from daq.signals.gauges import read_calibration, saturated, voltages
from tests.daq.cal_files import SIX, nano17, numbers, write_cal


def test_the_nano17_gives_the_makers_matrix(tmp_path: Path) -> None:
    cal = read_calibration(nano17(tmp_path))
    truth = numbers("nano17_FT14048")
    np.testing.assert_array_equal(cal.matrix, [truth["user_axis"][a] for a in SIX])
    np.testing.assert_array_equal(cal.full_scale, [50.0, 50.0, 70.0, 500.0, 500.0, 500.0])
    assert (cal.serial, cal.model, cal.range_V) == ("FT14048", "ATI Nano17 SI-50-0.5", 10.0)
    assert cal.notes == ()


def test_axis_scale_and_transform_alone_reproduce_it(tmp_path: Path) -> None:
    truth = numbers("nano17_FT14048")
    rows = truth.pop("user_axis")
    user = np.array([rows[a] for a in SIX])
    truth["attributes"]["CalFileVersion"] = "1.0"
    cal = read_calibration(write_cal(tmp_path / "old.cal", truth))
    # The maker rounds UserAxis to five decimals.
    assert np.abs(cal.matrix - user).max() < 2e-5


def test_the_delta_of_version_1_0_in_metres_comes_in_millimetres(tmp_path: Path) -> None:
    truth = numbers("delta_FT8506")
    cal = read_calibration(write_cal(tmp_path / "FT8506.cal", truth))
    np.testing.assert_array_equal(cal.full_scale, [660.0, 660.0, 1980.0, 60e3, 60e3, 60e3])
    # By hand, for gauge 2: Fx and Fy from the rows, Tx += Dz Fy, Ty -= Dz Fx, with N m as N mm.
    fx, fy = -0.13597 / 0.430878160557695, 39.47401 / 0.430878160557695
    assert cal.matrix[0, 1] == pytest.approx(fx, rel=1e-12)
    assert cal.matrix[3, 1] == pytest.approx(1e3 * (-0.00586 / 8.13428824249133 + 0.0120142 * fy), rel=1e-12)
    assert cal.matrix[4, 1] == pytest.approx(1e3 * (-1.2513 / 8.13428824249133 - 0.0120142 * fx), rel=1e-12)
    assert cal.matrix[5, 1] == pytest.approx(1e3 * -19.86633 / 7.26448104045155, rel=1e-12)
    # What this source does not quote is not assumed.
    assert cal.range_V is None
    assert cal.limit_V is None
    assert "OutputRange" in cal.notes[0]


def test_pounds_and_inches(tmp_path: Path) -> None:
    truth = numbers("nano17_FT14048")
    metric = read_calibration(nano17(tmp_path))
    # The same cell as a US calibration would state it.
    pound, inch = 4.4482216152605, 25.4
    for tag in ("axis", "user_axis"):
        for a in SIX:
            truth[tag][a] = [v / (pound if a[0] == "F" else pound * inch) * 100.0 for v in truth[tag][a]]
    truth["max"] = [100.0] * 6
    truth["basic_transform"][2] = 6.096 / inch
    truth["attributes"] |= {"ForceUnits": "lbf", "TorqueUnits": "lbf-in", "DistUnits": "in"}
    cal = read_calibration(write_cal(tmp_path / "us.cal", truth))
    np.testing.assert_allclose(cal.matrix, 100.0 * metric.matrix, rtol=1e-3, atol=2e-2)
    assert cal.full_scale == pytest.approx([444.82216] * 3 + [11298.48] * 3, rel=1e-6)


def test_the_zero_is_taken_off_the_volts(tmp_path: Path) -> None:
    cal = read_calibration(nano17(tmp_path))
    zero = np.array([0.1, -0.2, 0.3, 0.0, 0.5, -0.6])
    volts = zero + np.array([[1.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, -2.0]])
    got = cal.wrench(volts, zero)
    assert got[0] == pytest.approx([-0.0028, -0.16194, 7.63129, -1.07922, -48.5243, -0.43239])
    assert got[1] == pytest.approx([-13.262, 7.46382, 0.0624, 44.66938, 81.68658, -56.06922])
    # Row by row or together, to the last bit.
    assert (np.concatenate([cal.wrench(v[None, :], zero) for v in volts]) == got).all()


def test_full_scale_on_all_axes_at_once_saturates_a_gauge(tmp_path: Path) -> None:
    cal = read_calibration(nano17(tmp_path))
    assert cal.limit_V is not None
    volts = np.asarray(np.linalg.solve(cal.matrix, cal.full_scale), dtype=np.float64)
    assert np.abs(volts).max() > 10.0
    assert saturated(volts[None, :], cal.limit_V)[0] != 0
    # One axis at a time is within what the certificate grants.
    singles = np.asarray(np.linalg.solve(cal.matrix, np.diag(cal.full_scale)).T, dtype=np.float64)
    assert (saturated(singles, cal.limit_V) == 0).all()


def test_saturation_names_the_gauges(tmp_path: Path) -> None:
    limit = read_calibration(nano17(tmp_path)).limit_V
    assert limit is not None
    volts = np.zeros((4, 6))
    volts[1, 0], volts[2, 5], volts[3, [1, 2]] = 10.0, -9.9951, 9.98
    # -9.9951 V is the last code of a 12-bit converter.
    assert saturated(volts, limit).tolist() == [0, 1, 32, 0]


def changed(**attributes: str) -> dict[str, Any]:
    truth = numbers("nano17_FT14048")
    truth["attributes"] |= attributes
    return truth


@pytest.mark.parametrize(
    ("attributes", "said"),
    [
        ({"CalFileVersion": "2.0"}, "CalFileVersion 2.0; expected version 1.0 or 1.1"),
        ({"ForceUnits": "dyn"}, "ForceUnits is 'dyn'; expected one of N kN lbf"),
        ({"TorqueUnits": "N"}, "TorqueUnits is 'N'; expected one of Nm Nmm"),
        ({"DistUnits": "furlong"}, "DistUnits is 'furlong'; expected one of m mm"),
        ({"NumGages": "7"}, "NumGages is 7; expected 6"),
        ({"GainMultiplier": "2"}, "GainMultiplier is 2; expected 1"),
        ({"OutputRange": "wide"}, "OutputRange is 'wide'; expected a number"),
    ],
)
def test_what_is_not_understood_is_refused_in_one_line(tmp_path: Path, attributes: dict[str, str], said: str) -> None:
    path = write_cal(tmp_path / "a.cal", changed(**attributes))
    with pytest.raises(DriverError) as fault:
        read_calibration(path)
    assert said in str(fault.value)
    assert "\n" not in str(fault.value)


def test_missing_rows_are_named(tmp_path: Path) -> None:
    truth = numbers("nano17_FT14048")
    del truth["user_axis"]["Ty"]
    with pytest.raises(DriverError, match="lacks UserAxis Ty"):
        read_calibration(write_cal(tmp_path / "a.cal", truth))
    truth["user_axis"] = {}
    with pytest.raises(DriverError, match="lacks UserAxis rows"):
        read_calibration(write_cal(tmp_path / "a.cal", truth))
    truth["axis"] = {}
    with pytest.raises(DriverError, match="has no rows"):
        read_calibration(write_cal(tmp_path / "a.cal", truth))


def test_one_digit_wrong_is_found(tmp_path: Path) -> None:
    truth = numbers("nano17_FT14048")
    truth["user_axis"]["Fz"][2] = 7.93947
    with pytest.raises(DriverError, match="UserAxis Fz is off"):
        read_calibration(write_cal(tmp_path / "a.cal", truth))


def test_a_turned_frame_needs_the_makers_own_rows(tmp_path: Path) -> None:
    truth = numbers("delta_FT8506")
    truth["basic_transform"][5] = 30.0
    with pytest.raises(DriverError, match="turns the axes"):
        read_calibration(write_cal(tmp_path / "a.cal", truth))
    turned = numbers("nano17_FT14048")
    turned["basic_transform"][5] = 30.0
    assert read_calibration(write_cal(tmp_path / "b.cal", turned)).matrix[0, 0] == -0.0028


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "is not XML"),
        (b"<FTSensor", "is not XML"),
        (b"<config/>", "holds <config>"),
        (b'<!DOCTYPE a [<!ENTITY b "c">]><FTSensor>&b;</FTSensor>', "declares its own markup"),
        (bytes(range(256)), "is not XML"),
    ],
)
def test_other_files_are_refused(tmp_path: Path, content: bytes, said: str) -> None:
    path = tmp_path / "a.cal"
    path.write_bytes(content)
    with pytest.raises(DriverError, match=said):
        read_calibration(path)
    with pytest.raises(DriverError, match="cannot be read"):
        read_calibration(tmp_path / "none.cal")


@pytest.mark.parametrize("text", ["", "1 2 3 4 5", "1 2 3 4 5 x", "1 2 3 4 5 nan"])
def test_a_zero_is_six_voltages(text: str) -> None:
    with pytest.raises(DriverError, match="six voltages"):
        voltages(text, "zero_V")
