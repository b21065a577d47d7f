from __future__ import annotations

import csv
import errno
import hashlib
import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

import ezc3d
import h5py
import numpy as np
import pyarrow.parquet
import pytest
from scipy.io import loadmat

from daq.errors import InputError
from daq.export.formats import write_c3d, write_hdf5, write_mat
from daq.export.tables import (
    MOUNT_FRAME,
    case_columns,
    describe_columns,
    sources_of,
    window_columns,
    write_columns,
    write_table,
)
from daq.recordings.readings import ReadingBlock, open_readings
from daq.sessions import Session, find_session, read_session
from daq.signals.corrections import measure
from tests.daq.benches import RATE_HZ, WRENCH, averaged, bench, record, recorded, window

ABOUT = {"software": "fingertwin 9", "sources": {"readings.csv": "ab"}}
AXES = ("Fx_N", "Fy_N", "Fz_N", "Tx_Nmm", "Ty_Nmm", "Tz_Nmm")


@pytest.mark.parametrize("name", ["DEV-01", "synek2019_H01"])
def test_csv_and_parquet_hold_the_measured_cases(name: str, tmp_path: Path) -> None:
    measured = measure(read_session(name))
    for file_format in ("csv", "parquet"):
        write_columns(case_columns(measured), tmp_path / f"cases.{file_format}", file_format)
    table = pyarrow.parquet.read_table(tmp_path / "cases.parquet").to_pydict()
    with (tmp_path / "cases.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert table["id"] == [r["id"] for r in rows] == [m.case.id for m in measured.cases]
    np.testing.assert_array_equal(table["Fx_N"], [m.wrench[0] for m in measured.cases])
    np.testing.assert_array_equal([float(r["Fy_N"]) for r in rows], [m.wrench[1] for m in measured.cases])
    i = next(i for i, m in enumerate(measured.cases) if m.case.masses_g.get("FDP"))
    assert float(rows[i]["FDP_g"]) == measured.cases[i].case.masses_g["FDP"]
    assert float(rows[i]["PIP_deg"]) == measured.session.postures_deg[measured.cases[i].case.posture].PIP
    if name == "DEV-01":
        sd = np.sqrt(np.diag(measured.case_covariance(0)))
        assert float(rows[0]["Tz_sd_Nmm"]) == pytest.approx(sd[5])
    else:
        # Nothing is made up where nothing was published.
        assert rows[0]["Tx_Nmm"] == rows[0]["Fx_sd_N"] == rows[0]["loaded_mid_s"] == ""
        assert table["Tx_Nmm"][0] is None
    assert sorted(p.name for p in tmp_path.iterdir()) == ["cases.csv", "cases.parquet"]


# The JSON file beside a table


def test_beside_a_table_stands_what_its_columns_are(tmp_path: Path) -> None:
    session = read_session("DEV-01")
    columns = case_columns(measure(session))
    about = {"session": session.id, "sources": sources_of(session, find_session("DEV-01"))}
    beside = write_table(columns, tmp_path / "cases.csv", about)
    assert beside == tmp_path / "cases.csv.json"
    body = json.loads(beside.read_text(encoding="utf-8"))
    written = (tmp_path / "cases.csv").read_bytes()
    assert body["table_sha256"] == hashlib.sha256(written).hexdigest()
    assert (body["session"], body["rows"], set(body["sources"])) == ("DEV-01", 96, {"session.yaml", "readings.csv.gz"})
    path = session.readings_path
    assert path is not None
    assert body["sources"]["readings.csv.gz"] == hashlib.sha256(path.read_bytes()).hexdigest()
    assert [c["name"] for c in body["columns"]] == written.decode().splitlines()[0].split(",")
    told = {c["name"]: (c["unit"], c["frame"]) for c in body["columns"]}
    assert told["Fz_N"] == told["Fz_sd_N"] == ("N", MOUNT_FRAME)
    assert told["Ty_Nmm"] == ("N mm", MOUNT_FRAME)
    assert (told["PIP_deg"], told["FDP_g"], told["loaded_mid_s"]) == (("deg", None), ("g", None), ("s", None))
    assert [c["name"] for c in body["columns"] if not c["meaning"]] == []


def test_no_text_of_a_csv_is_a_formula(tmp_path: Path) -> None:
    texts = ["=1+1", "+A1", "-A1", "@SUM(A1)", "\tx", "hook", ""]
    columns: dict[str, list[Any]] = {"id": list(texts), "Fx_N": [-1.0, 2.0, 3.0, 4.0, 5.0, 6.0, None]}
    beside = write_table(columns, tmp_path / "t.csv", {})
    rows = [line.split(",") for line in (tmp_path / "t.csv").read_text(encoding="utf-8").splitlines()[1:]]
    assert [row[0].strip('"') for row in rows] == [f"'{t}" for t in texts[:5]] + texts[5:]
    assert float(rows[0][1]) == -1.0
    assert "apostrophe" in json.loads(beside.read_text(encoding="utf-8"))["texts"]
    write_columns(columns, tmp_path / "t.parquet", "parquet")
    assert pyarrow.parquet.read_table(tmp_path / "t.parquet")["id"].to_pylist() == texts


def test_every_kind_of_column_is_described() -> None:
    names = ["predicted_Fx_N", "residual_Fy_N", "predicted_Tz_Nmm", "Tz_sd_Nmm", "unloaded_after_end_s"]
    assert [(c["unit"], c["meaning"]) for c in describe_columns(names)] == [
        ("N", "predicted force on the cell along x"),
        ("N", "measured less predicted force on the cell along y"),
        ("N mm", "predicted torque on the cell about z"),
        ("N mm", "standard uncertainty of the torque on the cell about z"),
        ("s", "end of the window unloaded_after_s"),
    ]


# HDF5 and MATLAB


@pytest.fixture
def recording(tmp_path: Path) -> Session:
    data = recorded(cases=2, after=True)
    data["events"] = [
        {"t_s": 3.0, "kind": "slip", "value": 1.5, "text": "süture"},
        {"t_s": 90.0, "kind": "tare"},
    ]
    block = record([0 * WRENCH, WRENCH, 0 * WRENCH, 2 * WRENCH, 0 * WRENCH], noise=0.01)
    status = np.zeros(len(block), dtype=np.int64)
    status[7] = 0x80000005
    data["readings"] = "readings.parquet"
    return bench(tmp_path / "bench", data, replace(block, status=status))


def columns_of(session: Session) -> dict[str, list[Any]]:
    measured = measure(session)
    return {**case_columns(measured), **window_columns(measured)}


def readings_of(session: Session) -> ReadingBlock:
    assert session.readings_path is not None
    blocks = list(open_readings(session.readings_path).blocks())
    assert len(blocks) == 1
    return blocks[0]


def test_hdf5_holds_readings_cases_and_units(recording: Session, tmp_path: Path) -> None:
    columns, block = columns_of(recording), readings_of(recording)
    write_hdf5(recording, columns, tmp_path / "x.h5", ABOUT)
    with h5py.File(tmp_path / "x.h5") as file:
        assert (file.attrs["session"], file.attrs["software"]) == ("S1", "fingertwin 9")
        assert json.loads(file.attrs["sources"]) == {"readings.csv": "ab"}
        readings, cases = file["readings"], file["cases"]
        np.testing.assert_array_equal(readings["t_s"][:], block.t_s)
        for i, name in enumerate(AXES):
            np.testing.assert_array_equal(readings[name][:], block.wrench[:, i])
            np.testing.assert_array_equal(cases[name][:], columns[name])
        assert readings["status"][7] == 0x80000005
        assert (readings["Tx_Nmm"].attrs["unit"], readings["Fx_N"].attrs["frame"]) == ("N mm", "the cell's own axes")
        assert (cases["Tx_Nmm"].attrs["unit"], cases["Fx_N"].attrs["frame"]) == ("N mm", MOUNT_FRAME)
        assert cases["id"].asstr()[:].tolist() == ["c001", "c002"]
        assert cases["loaded_start_s"][:].tolist() == [window(1)[0], window(3)[0]]
        assert cases["PIP_deg"].attrs["unit"] == "deg"
        assert file["events"]["text"].asstr()[:].tolist() == ["süture", ""]
        assert file["events"]["t_s"][:].tolist() == [3.0, 90.0]


def test_hdf5_appends_the_blocks_of_a_long_recording(tmp_path: Path) -> None:
    # More than one block of the reader.
    block = record([0 * WRENCH, WRENCH] + [0 * WRENCH] * 100, noise=0.01)
    session = bench(tmp_path / "bench", recorded() | {"readings": "readings.parquet"}, block)
    assert session.readings_path is not None
    assert len(list(open_readings(session.readings_path).blocks())) > 1
    write_hdf5(session, columns_of(session), tmp_path / "x.h5", ABOUT)
    with h5py.File(tmp_path / "x.h5") as file:
        np.testing.assert_array_equal(file["readings"]["t_s"][:], block.t_s)
        np.testing.assert_array_equal(file["readings"]["Tz_Nmm"][:], block.wrench[:, 5])


def test_hdf5_of_averaged_forces_has_no_readings_and_no_made_up_number(tmp_path: Path) -> None:
    session = read_session("synek2019_H01")
    write_hdf5(session, columns_of(session), tmp_path / "x.h5", ABOUT)
    with h5py.File(tmp_path / "x.h5") as file:
        assert "readings" not in file
        assert np.isnan(file["cases"]["Tx_Nmm"][:]).all()
        assert file["cases"]["Fx_N"][0] == session.cases[0].force_N[0]  # type: ignore[index]


def texts_of(characters: Any) -> list[str]:
    """What MATLAB's cellstr makes of a matrix of characters."""
    return [str(text).rstrip() for text in np.atleast_1d(characters)]


def test_mat_holds_columns_with_units_in_their_names(recording: Session, tmp_path: Path) -> None:
    columns, block = columns_of(recording), readings_of(recording)
    write_mat(recording, columns, tmp_path / "x.mat", ABOUT)
    found = loadmat(tmp_path / "x.mat", squeeze_me=True, struct_as_record=False)
    assert texts_of(found["cases"].id) == ["c001", "c002"]
    for i, name in enumerate(AXES):
        assert getattr(found["cases"], name).tolist() == columns[name]
        np.testing.assert_array_equal(getattr(found["readings"], name), block.wrench[:, i])
    np.testing.assert_array_equal(found["readings"].t_s, block.t_s)
    assert found["readings"].status[7] == 0x80000005
    assert found["session"].session == "S1"
    told = dict(zip(texts_of(found["columns"].field), texts_of(found["columns"].unit), strict=True))
    assert (told["Tz_Nmm"], told["FDP_g"]) == ("N mm", "g")
    assert found["events"].t_s.tolist() == [3.0, 90.0]
    assert texts_of(found["events"].text) == ["süture", ""]
    # Neither the time of writing nor the operating system.
    head = (tmp_path / "x.mat").read_bytes()[:116].decode().split(",")
    assert head[0] == "MATLAB 5.0 MAT-file"
    assert head[1].strip().startswith("written by fingertwin")


def test_mat_marks_the_unknown_and_takes_any_name_of_a_joint(tmp_path: Path) -> None:
    data = averaged()
    data["postures_deg"]["hook"]["IP of 2nd-ray"] = 12.0
    session = bench(tmp_path / "bench", data)
    write_mat(session, columns_of(session), tmp_path / "x.mat", ABOUT)
    found = loadmat(tmp_path / "x.mat", squeeze_me=True, struct_as_record=False)
    assert "readings" not in found
    np.testing.assert_array_equal(found["cases"].IP_of_2nd_ray_deg, [12.0, np.nan])
    assert np.isnan(found["cases"].Tx_Nmm).all()
    names = dict(zip(texts_of(found["columns"].field), texts_of(found["columns"].name), strict=True))
    assert names["IP_of_2nd_ray_deg"] == "IP of 2nd-ray_deg"


# C3D


def test_c3d_holds_six_channels_and_the_windows(recording: Session, tmp_path: Path) -> None:
    block = readings_of(recording)
    write_c3d(recording, tmp_path / "x.c3d")
    found = ezc3d.c3d(str(tmp_path / "x.c3d"))
    parameters = found["parameters"]
    assert parameters["ANALOG"]["LABELS"]["value"] == ["Fx", "Fy", "Fz", "Tx", "Ty", "Tz"]
    assert parameters["ANALOG"]["UNITS"]["value"] == ["N"] * 3 + ["Nmm"] * 3
    assert parameters["ANALOG"]["RATE"]["value"][0] == RATE_HZ
    np.testing.assert_array_equal(found["data"]["analogs"][0], block.wrench.T.astype(np.float32))
    minutes, seconds = parameters["EVENT"]["TIMES"]["value"]
    events = dict(zip(parameters["EVENT"]["LABELS"]["value"], minutes * 60 + seconds, strict=True))
    assert events["c001 unloaded start"] == pytest.approx(window(0)[0])
    assert (events["c002 loaded start"], events["c002 loaded end"]) == pytest.approx(tuple(window(3)))
    assert (events["slip"], events["tare"]) == pytest.approx((3.0, 90.0))
    assert list(events.values()) == sorted(events.values())
    assert parameters["FINGERTWIN"]["SESSION"]["value"] == ["S1"]
    assert parameters["FINGERTWIN"]["READINGS"]["value"][0] == len(block)


def test_c3d_counts_time_from_the_first_reading(tmp_path: Path) -> None:
    block = record([0 * WRENCH, WRENCH])
    data = recorded()
    data["cases"][0] |= {key: [t + 100.0 for t in data["cases"][0][key]] for key in ("unloaded_s", "loaded_s")}
    session = bench(tmp_path / "bench", data, replace(block, t_s=block.t_s + 100.0))
    write_c3d(session, tmp_path / "x.c3d")
    parameters = ezc3d.c3d(str(tmp_path / "x.c3d"))["parameters"]
    assert parameters["FINGERTWIN"]["START_S"]["value"][0] == 100.0
    assert parameters["EVENT"]["TIMES"]["value"][1][0] == pytest.approx(window(0)[0])


@pytest.mark.parametrize(("n", "rate_hz"), [(131_075, 1000.0), (131_075, 333.3), (700_006, 7000.0)])
def test_c3d_of_more_readings_than_it_counts_frames(n: int, rate_hz: float, tmp_path: Path) -> None:
    # 3 and 11 of them share a frame; the last frame lacks one.
    t = np.arange(n) / rate_hz
    wrench = np.random.default_rng(0).normal(size=(n, 6))
    data = recorded() | {"readings": "readings.parquet"}
    data["load_cell"]["rate_hz"] = rate_hz
    session = bench(tmp_path / "bench", data, ReadingBlock(t, wrench))
    write_c3d(session, tmp_path / "x.c3d")
    found = ezc3d.c3d(str(tmp_path / "x.c3d"))
    channels = found["data"]["analogs"][0]
    np.testing.assert_array_equal(channels[:, :n], wrench.T.astype(np.float32))
    assert channels.shape == (6, n + 1)
    assert np.isnan(channels[:, n:]).all()
    assert found["parameters"]["ANALOG"]["RATE"]["value"][0] == pytest.approx(rate_hz, rel=1e-7)
    assert found["parameters"]["FINGERTWIN"]["READINGS"]["value"][0] == n


def test_c3d_takes_a_clock_that_wanders_and_no_gap(tmp_path: Path) -> None:
    block = record([0 * WRENCH, WRENCH])
    even, last_s = np.arange(len(block)) / RATE_HZ, len(block) / RATE_HZ
    # By three readings in the middle, and no step by more than 5 %.
    wandering = even + 3.0 / RATE_HZ * np.sin(np.pi * even / last_s)
    assert np.abs(np.diff(wandering) * RATE_HZ - 1.0).max() < 0.05
    data = recorded() | {"events": [{"t_s": float(wandering[len(even) // 2]), "kind": "slip"}]}
    data["load_cell"].pop("rate_hz", None)
    write_c3d(bench(tmp_path / "bench", data, replace(block, t_s=wandering)), tmp_path / "x.c3d")
    parameters = ezc3d.c3d(str(tmp_path / "x.c3d"))["parameters"]
    rate_hz = parameters["ANALOG"]["RATE"]["value"][0]
    assert rate_hz == pytest.approx((len(even) - 1) / (wandering[-1] - wandering[0]), rel=1e-6)
    slip_s = parameters["EVENT"]["TIMES"]["value"][1][parameters["EVENT"]["LABELS"]["value"].index("slip")]
    assert slip_s * rate_hz == pytest.approx(len(even) // 2, abs=0.01)
    lost = replace(block, t_s=wandering + (even > last_s / 2) / RATE_HZ)
    with pytest.raises(InputError, match="not evenly sampled"):
        write_c3d(bench(tmp_path / "lost", data, lost), tmp_path / "y.c3d")


def test_c3d_splits_events_beyond_what_one_parameter_holds(tmp_path: Path) -> None:
    data = recorded() | {"events": [{"t_s": 0.01 * i, "kind": "note"} for i in range(600)]}
    session = bench(tmp_path / "bench", data, record([0 * WRENCH, WRENCH]))
    write_c3d(session, tmp_path / "x.c3d")
    events = ezc3d.c3d(str(tmp_path / "x.c3d"))["parameters"]["EVENT"]
    assert [len(events[f"LABELS{i}"]["value"]) for i in ("", "2", "3")] == [255, 255, 94]
    times = np.concatenate([events[f"TIMES{i}"]["value"][1] for i in ("", "2", "3")])
    assert (np.diff(times) >= 0).all()
    data["events"] = [{"t_s": 0.0, "kind": "note"}] * 20_000
    with pytest.raises(InputError, match="20004 events"):
        write_c3d(bench(tmp_path / "bench", data), tmp_path / "y.c3d")


def test_c3d_may_have_a_name_without_its_ending(recording: Session, tmp_path: Path) -> None:
    for name in ("run", "RUN.C3D", "x.c3d"):
        write_c3d(recording, tmp_path / name)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["RUN.C3D", "bench", "run", "x.c3d"]
    assert (tmp_path / "run").read_bytes() == (tmp_path / "x.c3d").read_bytes()


def test_hdf5_and_c3d_on_a_full_disk_leave_nothing(
    recording: Session, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object, **__: object) -> NoReturn:
        raise RuntimeError("Can't decrement id ref count (file write failed: \n, errno = 28, error message = 'No")

    columns = columns_of(recording)
    monkeypatch.setattr(h5py.Group, "create_dataset", full)
    with pytest.raises(OSError, match=os.strerror(errno.ENOSPC)):
        write_hdf5(recording, columns, tmp_path / "x.h5", ABOUT)
    # The library of C3D writes what it can, and says nothing.
    monkeypatch.setattr(ezc3d.c3d, "write", lambda self, path: Path(path).write_bytes(b"\0" * 512))
    with pytest.raises(OSError, match=os.strerror(errno.ENOSPC)):
        write_c3d(recording, tmp_path / "x.c3d")
    assert [p.name for p in tmp_path.iterdir()] == ["bench"]


def test_c3d_needs_readings(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no readings; expected a session with readings.*hdf5") as error:
        write_c3d(read_session("synek2019_H01"), tmp_path / "x.c3d")
    assert "\n" not in str(error.value)
    assert list(tmp_path.iterdir()) == []


def test_c3d_refuses_a_gap_that_its_even_channels_would_hide(tmp_path: Path) -> None:
    block = record([0 * WRENCH, WRENCH])
    kept = np.delete(np.arange(len(block)), np.arange(390, 410))
    session = bench(tmp_path / "bench", recorded(), ReadingBlock(block.t_s[kept], block.wrench[kept]))
    with pytest.raises(InputError, match=r"0\.21 s pass after t = 3\.8900 s"):
        write_c3d(session, tmp_path / "x.c3d")
    assert [p.name for p in tmp_path.iterdir()] == ["bench"]


def test_c3d_takes_the_rate_of_the_readings_where_the_stated_one_is_not_theirs(tmp_path: Path) -> None:
    data = recorded()
    data["load_cell"]["rate_hz"] = 125.0
    session = bench(tmp_path / "bench", data, record([0 * WRENCH, WRENCH]))
    write_c3d(session, tmp_path / "x.c3d")
    found = ezc3d.c3d(str(tmp_path / "x.c3d"))
    assert found["parameters"]["ANALOG"]["RATE"]["value"][0] == pytest.approx(RATE_HZ)


def test_nothing_is_left_where_a_file_cannot_be_written(recording: Session, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    columns = columns_of(recording)
    for write in (
        lambda file: write_c3d(recording, file),
        lambda file: write_hdf5(recording, columns, file, ABOUT),
        lambda file: write_mat(recording, columns, file, ABOUT),
        lambda file: write_table(columns, file, ABOUT),
    ):
        with pytest.raises(OSError, match="file"):
            write(tmp_path / "file" / "x")
        assert sorted(p.name for p in tmp_path.iterdir()) == ["bench", "file"]


def test_the_same_session_gives_the_same_bytes(recording: Session, tmp_path: Path) -> None:
    columns = columns_of(recording)
    for folder in ("a", "b"):
        write_hdf5(recording, columns, tmp_path / folder / "x.h5", ABOUT)
        write_mat(recording, columns, tmp_path / folder / "x.mat", ABOUT)
        write_c3d(recording, tmp_path / folder / "x.c3d")
        write_table(columns, tmp_path / folder / "x.csv", ABOUT)
    names = sorted(p.name for p in (tmp_path / "a").iterdir())
    assert names == ["x.c3d", "x.csv", "x.csv.json", "x.h5", "x.mat"]
    for name in names:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
