"""Recordings of LabVIEW and other programs of a lab: what they hold is read, and what is wrong with them is said."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daq.errors import InputError, ReadingsError
from daq.lab.files import (
    AXES,
    Increment,
    Taken,
    open_recording,
)
from daq.lab.opened import open_channels
from daq.lab.proposals import propose_mapping
from tests.daq.cal_files import nano17
from tests.daq.lab_files import FROM_VOLTS, VOLT_ROWS, VOLTAGES, WRENCH, gauges, lvm, mapped, resolved, tdms, together


def test_tdms_in_resolved_units_with_an_increment(tmp_path: Path) -> None:
    path = resolved(tmp_path / "a.tdms", wf_increment=0.25, wf_start_offset=2.0)
    recording = open_recording(path, mapped())
    t_s, wrench = together(list(recording.blocks()))
    assert t_s.tolist() == [2.0, 2.25, 2.5]
    np.testing.assert_array_equal(wrench, WRENCH)
    assert recording.conversions == ()
    assert "saturation was not looked for" in recording.notes[0]


def test_units_are_converted_and_said(tmp_path: Path) -> None:
    units = ("lbf", "lbf", "lbf", "N-m", "N-m", "N-m")
    path = resolved(tmp_path / "a.tdms", WRENCH, units, wf_increment=0.001)
    channels = {a: Taken(channel=f"ATI/{a}", unit=u) for a, u in zip(AXES, units, strict=True)}
    recording = open_recording(path, mapped(channels=channels))
    _, wrench = together(list(recording.blocks()))
    np.testing.assert_allclose(wrench, WRENCH * ([4.4482216152605] * 3 + [1000.0] * 3), rtol=1e-12)
    assert "ATI/Fx [lbf] × 4.448221615 = Fx_N" in recording.conversions


@pytest.mark.parametrize("kind", ["ms", "timestamp"])
def test_tdms_with_a_channel_of_time(tmp_path: Path, kind: str) -> None:
    dates = np.datetime64("2024-05-01T12:00:00.000000", "us") + np.array([0, 1500, 4000], dtype="timedelta64[us]")
    columns: dict[str, Any] = {"ATI/Time": dates if kind == "timestamp" else [100.0, 101.5, 104.0]}
    columns |= {f"ATI/{a}": WRENCH[:, i] for i, a in enumerate(AXES)}
    path = tdms(tmp_path / "a.tdms", columns)
    recording = open_recording(path, mapped(Taken(channel="ATI/Time", unit=kind)))
    t_s, _ = together(list(recording.blocks()))
    start = 0.0 if kind == "timestamp" else 0.1
    assert t_s - start == pytest.approx([0.0, 0.0015, 0.004], abs=1e-9)


def test_many_blocks_are_one_recording(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("daq.lab.tdms.BLOCK_ROWS", 7)
    monkeypatch.setattr("daq.lab.lvm.BLOCK_ROWS", 7)
    wrench = np.random.default_rng(1).normal(size=(30, 6))
    path = resolved(tmp_path / "a.tdms", wrench, wf_increment=0.5)
    blocks = list(open_recording(path, mapped()).blocks())
    assert [len(b) for b in blocks] == [7, 7, 7, 7, 2]
    t_s, got = together(blocks)
    np.testing.assert_array_equal(got, wrench)
    assert t_s.tolist() == [0.5 * k for k in range(30)]
    rows = [f"{0.001 * k:.6f}\t" + "\t".join(repr(float(v)) for v in row) for k, row in enumerate(wrench)]
    text = lvm(tmp_path / "a.lvm", rows, " ".join(AXES), unit="N")
    channels = {a: Taken(channel=a, unit="N" if a[0] == "F" else "Nmm") for a in AXES}
    # LabVIEW labels all alike, torques too; but two units of force contradict each other.
    wrong = channels | {"Fz": Taken(channel="Fz", unit="mN")}
    with pytest.raises(ReadingsError, match="states Fz in 'N', its mapping in 'mN'"):
        open_recording(text, mapped(channels=wrong))
    blocks = list(open_recording(text, mapped(Taken(channel="X_Value", unit="s"), channels=channels)).blocks())
    assert [len(b) for b in blocks] == [7, 7, 7, 7, 2]
    np.testing.assert_array_equal(together(blocks)[1], wrench)


def test_lvm_volts_by_a_calibration(tmp_path: Path) -> None:
    path = lvm(tmp_path / "a.lvm", VOLT_ROWS)
    recording = open_recording(path, gauges(nano17(tmp_path), VOLTAGES))
    (block,) = recording.blocks()
    assert block.t_s.tolist() == [0.0, 0.001]
    assert block.wrench[0] == pytest.approx(FROM_VOLTS)
    assert block.status is not None
    assert block.status.tolist() == [0, 2]
    assert "ATI Nano17 SI-50-0.5, FT14048" in recording.conversions[0]
    assert any("tare" in n for n in recording.notes)
    (zeroed,) = open_recording(path, gauges(nano17(tmp_path), VOLTAGES, zero_V=(1.0, 0, 0, 0, 0, -2.0))).blocks()
    assert zeroed.wrench[0] == pytest.approx([0.0] * 6, abs=1e-12)


def test_lvm_with_decimal_commas_without_times_in_a_western_code_page(tmp_path: Path) -> None:
    rows = [("\t" + r.split("\t", 1)[1]).replace(".", ",") for r in VOLT_ROWS]
    path = lvm(tmp_path / "a.lvm", rows, x_columns="No", decimal=",", delta="0,001000", encoding="cp1252")
    assert "X_Value" not in [c.name for c in open_channels(path).channels]
    recording = open_recording(path, gauges(nano17(tmp_path), VOLTAGES, time=Increment(increment_s="file")))
    (block,) = recording.blocks()
    assert block.t_s.tolist() == [0.0, 0.001]
    assert block.wrench[0] == pytest.approx(FROM_VOLTS)
    # Six decimals of a millisecond.
    assert any("rounded: time may be off by 0.05 %" in n for n in recording.notes)


def test_a_rounded_increment_can_be_corrected_and_an_exact_one_cannot(tmp_path: Path) -> None:
    cal = nano17(tmp_path)
    text = lvm(tmp_path / "a.lvm", VOLT_ROWS, delta="0.000333")
    (block,) = open_recording(text, gauges(cal, VOLTAGES, time=Increment(increment_s=1.0 / 3000.0))).blocks()
    assert block.t_s[1] == 1.0 / 3000.0
    path = resolved(tmp_path / "a.tdms", wf_increment=0.000333)
    with pytest.raises(ReadingsError, match=r"states an increment of 0\.000333 s"):
        open_recording(path, mapped(Increment(increment_s=1.0 / 3000.0)))


def test_lvm_segments_go_on_by_their_times_only(tmp_path: Path) -> None:
    cal = nano17(tmp_path)
    again = ["", "Channels\t6", "Delta_X" + "\t0.001000" * 6, "***End_of_Header***"]
    headings = "X_Value\t" + "\t".join(VOLTAGES) + "\tComment"
    later = VOLT_ROWS[0].replace("0.000000", "5.000000", 1)
    path = lvm(tmp_path / "a.lvm", [*VOLT_ROWS, *again, headings, later])
    t_s, _ = together(list(open_recording(path, gauges(cal, VOLTAGES)).blocks()))
    assert t_s.tolist() == [0.0, 0.001, 5.0]
    with pytest.raises(ReadingsError, match="pauses between them"):
        open_recording(path, gauges(cal, VOLTAGES, time=Increment(increment_s="file")))
    back = lvm(tmp_path / "b.lvm", [*VOLT_ROWS, *again, headings, VOLT_ROWS[0]])
    with pytest.raises(ReadingsError, match="reading 3: time goes back"):
        list(open_recording(back, gauges(cal, VOLTAGES)).blocks())
    other = lvm(tmp_path / "c.lvm", [*VOLT_ROWS, *again, headings.replace("_5", "_6"), later])
    with pytest.raises(ReadingsError, match="a segment has other channels"):
        list(open_recording(other, gauges(cal, VOLTAGES)).blocks())


def test_lvm_segments_in_other_units_are_no_one_recording(tmp_path: Path) -> None:
    again = ["", "Channels\t6", "Y_Unit_Label" + "\tmV" * 6, "***End_of_Header***"]
    headings = "X_Value\t" + "\t".join(VOLTAGES) + "\tComment"
    path = lvm(tmp_path / "a.lvm", [*VOLT_ROWS, *again, headings, "5" + VOLT_ROWS[0]])
    with pytest.raises(ReadingsError, match=r"a segment has Y_Unit_Label mV mV .*; expected Volts Volts .*Split"):
        list(open_recording(path, gauges(nano17(tmp_path), VOLTAGES)).blocks())


@pytest.mark.parametrize("x_columns", ["One", "No"])
def test_lvm_states_the_unit_of_its_time(tmp_path: Path, x_columns: str) -> None:
    path = lvm(tmp_path / "a.lvm", VOLT_ROWS, x_columns=x_columns, delta="1.000")
    stated = path.read_bytes().replace(b"X_Dimension", b"X_Unit_Label" + b"\tms" * 6 + b"\r\nX_Dimension")
    path.write_bytes(stated.replace(b"\r\n0.001000", b"\r\n1.000000"))
    times: list[Taken | Increment] = [Increment(increment_s="file")]
    if x_columns == "One":
        times.append(Taken(channel="X_Value", unit="ms"))
        with pytest.raises(ReadingsError, match="states X_Value in 'ms', its mapping in 's'"):
            open_recording(path, gauges(nano17(tmp_path), VOLTAGES))
    for time in times:
        (block,) = open_recording(path, gauges(nano17(tmp_path), VOLTAGES, time=time)).blocks()
        assert block.t_s == pytest.approx([0.0, 0.001])


@pytest.mark.parametrize("delta", ["0.000", "-0.001"])
def test_lvm_that_does_not_go_on_by_its_increment_states_none(tmp_path: Path, delta: str) -> None:
    path = lvm(tmp_path / "a.lvm", VOLT_ROWS, x_columns="No", delta=delta)
    with pytest.raises(ReadingsError, match="states no increment"):
        open_recording(path, gauges(nano17(tmp_path), VOLTAGES, time=Increment(increment_s="file")))


@pytest.mark.parametrize(("comment", "read"), [(",hung FDP", True), ("", True), (",7", False)])
def test_lvm_with_a_comma_too_many_is_not_read_as_other_channels(tmp_path: Path, comment: str, read: bool) -> None:
    path = lvm(tmp_path / "a.lvm", [*VOLT_ROWS, "0.002\t1\t2\t3\t4\t5\t6" + comment])
    path.write_bytes(path.read_bytes().replace(b"\t", b",").replace(b"Separator,Tab", b"Separator,Comma"))
    recording = open_recording(path, gauges(nano17(tmp_path), VOLTAGES))
    if read:
        assert len(together(list(recording.blocks()))[0]) == 3
    else:
        with pytest.raises(ReadingsError, match=r"line 28: a number stands in cell 8; .*separators of thousands"):
            list(recording.blocks())


@pytest.mark.parametrize("cut", [0, 5])
@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be", "utf-8-sig"])
def test_lvm_that_an_editor_saved_in_unicode(tmp_path: Path, encoding: str, cut: int) -> None:
    path = lvm(tmp_path / "a.lvm", VOLT_ROWS, encoding=encoding)
    path.write_bytes(path.read_bytes()[: -cut or None])
    recording = open_recording(path, gauges(nano17(tmp_path), VOLTAGES))
    t_s, wrench = together(list(recording.blocks()))
    assert t_s.tolist() == ([0.0] if cut else [0.0, 0.001])
    assert wrench[0] == pytest.approx(FROM_VOLTS)
    assert any("is cut off" in n for n in recording.notes) == bool(cut)


@pytest.mark.parametrize(
    ("row", "said"),
    [
        ("0.002\t1\t2\t3\t4_0\t5\t6", "line 28: Voltage_3 is '4_0'"),
        ("0.002\t1\t2\t3,5\t4\t5\t6", "line 28: Voltage_2 is '3,5'; .*Decimal_Separator .: correct it there"),
        ("0.001\t1\t2\t3\t4\t5\t6", "reading 3: time stands still"),
        ("0.002\t1\t2\t3\t4\t5", "line 28: Voltage_5 is missing"),
        ("0.002\t1\t2\t\t4\t5\t6", "line 28: Voltage_2 is ''"),
        ("0.002\t1\t2\tNaN\t4\t5\t6", "line 28: Voltage_2 is 'NaN'"),
        ("\t1\t2\t3\t4\t5\t6", "line 28: X_Value is ''"),
    ],
)
def test_a_bad_row_is_named(tmp_path: Path, row: str, said: str) -> None:
    path = lvm(tmp_path / "a.lvm", [*VOLT_ROWS, row])
    with pytest.raises(ReadingsError, match=said):
        list(open_recording(path, gauges(nano17(tmp_path), VOLTAGES)).blocks())


def test_a_torn_last_line_is_not_read_as_a_whole_one(tmp_path: Path) -> None:
    path = lvm(tmp_path / "a.lvm", [*VOLT_ROWS, "0.002\t1\t2\t3\t4\t5\t-1.234"])
    path.write_bytes(path.read_bytes()[:-4])
    recording = open_recording(path, gauges(nano17(tmp_path), VOLTAGES))
    (block,) = recording.blocks()
    assert block.t_s.tolist() == [0.0, 0.001]
    assert any("is cut off" in n for n in recording.notes)


def test_a_torn_tdms_file_is_said(tmp_path: Path) -> None:
    path = resolved(tmp_path / "a.tdms", wf_increment=0.1)
    path.write_bytes(path.read_bytes()[:60])
    with pytest.raises(ReadingsError, match=r"a\.tdms"):
        list(open_recording(path, mapped()).blocks())


def test_a_tdms_file_that_ends_in_the_middle_says_so(tmp_path: Path) -> None:
    path = resolved(tmp_path / "a.tdms", wf_increment=0.1)
    whole = path.read_bytes()
    path.write_bytes(whole + resolved(tmp_path / "b.tdms", wf_increment=0.1).read_bytes()[:-20])
    recording = open_recording(path, mapped())
    assert any("is cut off" in n for n in recording.notes)
    # One channel after the other was written, so the last lacks what the others have.
    _, wrench = together(list(recording.blocks()))
    np.testing.assert_array_equal(wrench, WRENCH)
    path.write_bytes(whole)
    assert not any("is cut off" in n for n in open_recording(path, mapped()).notes)


def test_tdms_faults_are_said(tmp_path: Path) -> None:
    holed = WRENCH.copy()
    holed[1, 3] = np.nan
    path = resolved(tmp_path / "a.tdms", holed, wf_increment=0.1)
    with pytest.raises(ReadingsError, match="reading 2: ATI/Tx is nan"):
        list(open_recording(path, mapped()).blocks())
    columns: dict[str, Any] = {f"ATI/{a}": WRENCH[: 3 - (a == "Tz"), i] for i, a in enumerate(AXES)}
    path = tdms(tmp_path / "b.tdms", columns, wf_increment=0.1)
    with pytest.raises(ReadingsError, match="channels of different length"):
        list(open_recording(path, mapped()).blocks())
    path = tdms(tmp_path / "c.tdms", columns | {"ATI/Tz": ["a", "b", "c"]}, wf_increment=0.1)
    with pytest.raises(ReadingsError, match="Tz holds"):
        list(open_recording(path, mapped()).blocks())
    path = resolved(tmp_path / "d.tdms")
    with pytest.raises(ReadingsError, match="states no increment"):
        open_recording(path, mapped())
    with pytest.raises(ReadingsError, match="has 0 channels 'ATI/Time'; expected one of ATI/Fx"):
        open_recording(path, mapped(Taken(channel="ATI/Time", unit="s")))


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"0.0\t1\t2\r\n",
        b"LabVIEW Measurement",
        b"LabVIEW Measurement\nSeparator\tTab\n***End_of_Header***\n",
        b"LabVIEW Measurement\n***End_of_Header***\nChannels\t1\n***End_of_Header***",
        b"LabVIEW Measurement\nSeparator,Comma\nDecimal_Separator,,\n***End_of_Header***\n",
        b"TDSm",
        b"TDSm" + bytes(range(256)),
        b"TDSm\x0e\x00\x00\x00\x69\x12\x00\x00" + b"\xff" * 40,
    ],
)
def test_other_and_torn_files_are_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.dat"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"a\.dat") as fault:
        list(open_recording(path, mapped()).blocks())
    assert "\n" not in str(fault.value)


# What a file says by itself, and would be read wrongly without a look


def test_a_scale_that_is_not_known_is_refused_by_its_name(tmp_path: Path) -> None:
    """npTDMS would give raw counts, saying nothing."""
    reciprocal: dict[str, Any] = {
        "NI_Number_Of_Scales": 1,
        "NI_Scaling_Status": "unscaled",
        "NI_Scale[0]_Scale_Type": "Reciprocal",
    }
    path = resolved(tmp_path / "a.tdms", wf_increment=0.1, **reciprocal)
    for read in (propose_mapping, lambda p: open_recording(p, mapped())):
        with pytest.raises(ReadingsError, match="ATI/Fx has a scale of type Reciprocal"):
            read(path)
    linear = reciprocal | {"NI_Scale[0]_Scale_Type": "Linear", "NI_Scale[0]_Linear_Slope": 2.0}
    linear |= {"NI_Scale[0]_Linear_Y_Intercept": 0.0, "NI_Scale[0]_Linear_Input_Source": 0xFFFFFFFF}
    path = resolved(tmp_path / "b.tdms", wf_increment=0.1, **linear)
    np.testing.assert_array_equal(together(list(open_recording(path, mapped()).blocks()))[1], 2.0 * WRENCH)


def test_channels_that_start_apart_are_no_readings(tmp_path: Path) -> None:
    nptdms: Any = import_module("nptdms")
    path = tmp_path / "a.tdms"
    starts = [np.datetime64("2024-05-01T12:00:00", "us")] * 5 + [np.datetime64("2024-05-01T12:00:00.05", "us")]
    objects = [
        nptdms.ChannelObject("ATI", a, WRENCH[:, i], properties={"wf_increment": 0.1, "wf_start_time": starts[i]})
        for i, a in enumerate(AXES)
    ]
    clock = nptdms.ChannelObject("ATI", "Time", [0.0, 0.1, 0.2], properties={"unit_string": "s"})
    with nptdms.TdmsWriter(str(path)) as writer:
        writer.write_segment([*objects, clock])
    for time in (Increment(increment_s="file"), Taken(channel="ATI/Time", unit="s")):
        with pytest.raises(ReadingsError, match=r"ATI/Tz from 0\.05 s every 0\.1 s\); expected the same in all"):
            open_recording(path, mapped(time))


@pytest.mark.parametrize("stated", [True, False])
def test_channels_with_times_of_their_own_have_to_agree(stated: bool, tmp_path: Path) -> None:
    steps = [0.01] * 3 + [0.02] * 3
    rows = ["\t".join(f"{i * dt:.6f}\t{i * dt:.6f}" for dt in steps) for i in range(4)]
    path = lvm(tmp_path / "a.lvm", rows, "Fx", x_columns="Multi", unit="N")
    lines = path.read_text("utf-8").splitlines()
    head = "\t".join(f"X_Value\t{a}" for a in AXES) + "\tComment"
    values = ["N"] * 3 + ["Nmm"] * 3
    tags = {"Y_Unit_Label": values, "Delta_X": [f"{dt:.6f}" if stated else "" for dt in steps], "X0": ["0.0"] * 6}
    out = []
    for line in lines:
        tag = line.split("\t")[0]
        out.append(
            head
            if line.startswith("X_Value")
            else "\t".join([tag, *(f"{v}\t" for v in tags[tag])])
            if tag in tags
            else line
        )
    path.write_text("\n".join(out) + "\n", "utf-8")
    proposed = propose_mapping(path).model_copy(update={"confirmed": True})
    said = "the channels differ in start or increment" if stated else r"the channels differ in time \(0\.0"
    with pytest.raises(ReadingsError, match=said):
        list(open_recording(path, proposed).blocks())


def test_text_is_no_time_and_words_are_units(tmp_path: Path) -> None:
    columns: dict[str, Any] = {"ATI/Time": ["10:00:00.0", "10:00:00.1", "10:00:00.2"]}
    columns |= {
        f"ATI/{n}": WRENCH[:, i]
        for i, n in enumerate(("Kraft X", "Kraft Y", "Kraft Z", "Moment X", "Moment Y", "Moment Z"))
    }
    units = {name: "Pounds" if "Kraft" in name else "InchPounds" for name in columns if name != "ATI/Time"}
    path = tdms(tmp_path / "a.tdms", columns, units, wf_increment=0.1)
    proposed = propose_mapping(path)
    assert proposed.time == Increment(increment_s="file")
    _, wrench = together(list(open_recording(path, proposed.model_copy(update={"confirmed": True})).blocks()))
    np.testing.assert_allclose(wrench[0], WRENCH[0] * ([4.4482216152605] * 3 + [112.984829027616] * 3), rtol=1e-12)
    units = dict.fromkeys(units, "Pnds")
    doubts = propose_mapping(tdms(tmp_path / "b.tdms", columns, units, wf_increment=0.1)).doubts
    assert any("'Pnds' is no unit of force; write one of N" in d for d in doubts)
