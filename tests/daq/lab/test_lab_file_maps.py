"""Mappings of a lab's files: made from names, confirmed by a person, and refused where they cannot hold."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daq.errors import DriverError, ReadingsError
from daq.lab.files import (
    AXES,
    Increment,
    Taken,
    convert_recording,
    open_recording,
    read_mapping,
    write_mapping,
)
from daq.lab.proposals import grounds, propose_mapping
from daq.recordings.readings import open_readings
from tests.daq.cal_files import nano17, numbers, write_cal
from tests.daq.lab_files import (
    FROM_VOLTS,
    UNITS,
    VOLT_ROWS,
    VOLTAGES,
    WRENCH,
    gauges,
    lvm,
    mapped,
    resolved,
    tdms,
    together,
)


def test_a_mapping_is_refused_until_it_was_confirmed(tmp_path: Path) -> None:
    path = resolved(tmp_path / "a.tdms", wf_increment=0.25)
    proposed = propose_mapping(path)
    assert not proposed.confirmed
    assert {k: (t.channel, t.unit) for k, t in proposed.channels.items()} == {
        a: (f"ATI/{a}", u) for a, u in zip(AXES, UNITS, strict=True)
    }
    assert proposed.time == Increment(increment_s="file")
    assert any("tool transformation" in d for d in proposed.doubts)
    file = write_mapping(tmp_path / "map.yaml", proposed)
    target = tmp_path / "readings.csv"
    with pytest.raises(ReadingsError, match="was not confirmed"):
        convert_recording(path, file, target)
    assert not target.exists()
    file.write_text(file.read_text("utf-8").replace("confirmed: false", "confirmed: true"), "utf-8")
    convert_recording(path, file, target)
    t_s, wrench = together(list(open_readings(target).blocks()))
    assert t_s.tolist() == [0.0, 0.25, 0.5]
    np.testing.assert_array_equal(wrench, WRENCH)


def test_a_calibration_lies_beside_its_mapping(tmp_path: Path) -> None:
    folder = tmp_path / "maps"
    folder.mkdir()
    nano17(folder)
    path = lvm(tmp_path / "a.lvm", VOLT_ROWS)
    proposed = propose_mapping(path, "FT14048.cal")
    assert [t.channel for t in proposed.channels.values()] == list(VOLTAGES)
    assert {t.unit for t in proposed.channels.values()} == {"Volts"}
    assert proposed.time == Taken(channel="X_Value", unit="s")
    assert any("order of the gauges" in d for d in proposed.doubts)
    assert any("without load" in d for d in proposed.doubts)
    file = write_mapping(folder / "map.yaml", proposed.model_copy(update={"confirmed": True}))
    convert_recording(path, file, tmp_path / "readings.parquet")
    _, wrench = together(list(open_readings(tmp_path / "readings.parquet").blocks()))
    assert wrench[0] == pytest.approx(FROM_VOLTS)


def test_what_names_leave_open_is_a_doubt(tmp_path: Path) -> None:
    columns = {"Forces/Force X (N)": WRENCH[:, 0], "Forces/Force Y (N)": WRENCH[:, 1], "Forces/Force Z": WRENCH[:, 2]}
    columns |= {f"Forces/M{a} [N-m]": WRENCH[:, i] for i, a in enumerate("xyz", 3)}
    columns |= {"Forces/Time (ms)": np.arange(3.0), "Other/Time": np.arange(3.0)}
    proposed = propose_mapping(tdms(tmp_path / "a.tdms", columns))
    assert proposed.channels["Fx"] == Taken(channel="Forces/Force X (N)", unit="N")
    assert proposed.channels["Tz"] == Taken(channel="Forces/Mz [N-m]", unit="N-m")
    assert proposed.channels["Fz"].unit is None
    assert proposed.time == Taken(channel="Forces/Time (ms)", unit="ms")
    assert any("which time is meant" in d for d in proposed.doubts)
    assert any("the unit of Fz (Forces/Force Z)" in d for d in proposed.doubts)
    # A unit that is not known cannot be confirmed away.
    with pytest.raises(ReadingsError, match="Forces/Force Z no unit"):
        open_recording(tmp_path / "a.tdms", proposed.model_copy(update={"confirmed": True}))


def test_gauges_are_taken_in_the_order_of_their_numbers_not_of_the_file(tmp_path: Path) -> None:
    order = [3, 0, 5, 1, 2, 4]
    columns = {f"Untitled/Dev1_ai{k}": np.full(2, float(k)) for k in order}
    with pytest.raises(ReadingsError, match=r"do not tell which is which"):
        propose_mapping(tdms(tmp_path / "a.tdms", columns, wf_increment=0.1))
    columns = {f"Untitled/ai{k}": np.full(2, float(k)) for k in order}
    proposed = propose_mapping(tdms(tmp_path / "b.tdms", columns, wf_increment=0.1))
    assert [t.channel for t in proposed.channels.values()] == [f"Untitled/ai{k}" for k in range(6)]
    assert any("which calibration" in d for d in proposed.doubts)


def test_names_that_tell_nothing_are_taken_by_their_place_in_doubt_or_not_at_all(tmp_path: Path) -> None:
    path = tdms(tmp_path / "six.tdms", {f"g/{w}": [1.0] for w in "abcdef"}, wf_increment=0.1)
    proposed = propose_mapping(path)
    assert [t.channel for t in proposed.channels.values()] == [f"g/{w}" for w in "abcdef"]
    assert {t.unit for t in proposed.channels.values()} == {None}
    assert "their names tell nothing" in proposed.doubts[0]
    found = grounds(path, proposed)
    assert all(found[axis].by_place and found[axis].sure == 0.0 for axis in AXES)
    units = {f"g/{w}": "N" if w < "d" else "Nm" for w in "abcdef"}
    path = tdms(tmp_path / "units.tdms", {f"g/{w}": [1.0] for w in "abcdef"}, units, wf_increment=0.1)
    assert not any(ground.by_place for ground in grounds(path, propose_mapping(path)).values())
    # Neither is what one name contradicts, nor more than six.
    for names in (("a", "b", "c", "d", "e", "Fx"), "abcdefgh"):
        with pytest.raises(ReadingsError, match="do not tell which is which"):
            propose_mapping(tdms(tmp_path / "c.tdms", {f"g/{w}": [1.0] for w in names}, wf_increment=0.1))
    path = tdms(tmp_path / "a.tdms", {f"g/{w}": [1.0] for w in "abcdefg"}, wf_increment=0.1)
    with pytest.raises(ReadingsError, match=r"g/a \[\?\], g/b .* do not tell which is which"):
        propose_mapping(path)
    path = resolved(tmp_path / "b.tdms")
    with pytest.raises(ReadingsError, match="no channel of time and states no increment"):
        propose_mapping(path)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"format": "lab-file-map/2"}, "format"),
        ({"confirmed": "yes"}, "confirmed"),
        ({"channels": {"Fx": {"channel": "a"}}}, "channels are Fx"),
        ({"time": {"increment_s": 0.0}}, "time"),
        ({"unknown": 1}, "unknown"),
    ],
)
def test_a_mapping_that_is_none_is_refused(tmp_path: Path, change: dict[str, Any], said: str) -> None:
    import yaml

    plain = mapped().model_dump(mode="json", exclude_none=True) | change
    file = tmp_path / "map.yaml"
    file.write_text(yaml.safe_dump(plain), "utf-8")
    with pytest.raises(ReadingsError, match=said) as fault:
        read_mapping(file)
    assert "\n" not in str(fault.value)
    with pytest.raises(ReadingsError, match="cannot be read"):
        read_mapping(tmp_path / "none.yaml")


def test_gauges_need_their_calibration_and_say_when_their_range_is_unknown(tmp_path: Path) -> None:
    path = lvm(tmp_path / "a.lvm", VOLT_ROWS)
    with pytest.raises(ReadingsError, match="gauges and no calibration"):
        open_recording(path, gauges(tmp_path, VOLTAGES).model_copy(update={"calibration": None}))
    with pytest.raises(DriverError, match="cannot be read"):
        open_recording(path, gauges(tmp_path / "none.cal", VOLTAGES))
    delta = write_cal(tmp_path / "delta.cal", numbers("delta_FT8506"))
    recording = open_recording(path, gauges(delta, VOLTAGES))
    assert any("saturation was not looked for" in n for n in recording.notes)
    assert [b.status for b in recording.blocks()] == [None]
