"""A recorded session reaches the service whole, each reading once, however often the line breaks."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from daq.acquisition.blocks import Chunk
from daq.locations import data_dir
from daq.recordings.readings import open_readings
from daq.sessions import find_session, read_session
from daq.uplink.recording import STREAM
from fingermodel.comparing import compare
from fingermodel.session import Session
from fingertwin.client import Client, ServiceError, ServiceUnreachableError
from fingertwin.client import upload as uploading
from tests.client.services import URL, InProcess, receiver_in
from tests.server.service.running import ServiceReceiver


def stored(receiver: ServiceReceiver, session: str) -> tuple[np.ndarray, np.ndarray]:
    chunks = [Chunk.from_bytes(payload) for payload in receiver.stored(session, STREAM)]
    return np.concatenate([c.t_s for c in chunks]), np.concatenate([c.wrench for c in chunks])


def recorded(name: str) -> tuple[np.ndarray, np.ndarray]:
    path = read_session(name).readings_path
    assert path is not None
    blocks = list(open_readings(path).blocks())
    return np.concatenate([b.t_s for b in blocks]), np.concatenate([b.wrench for b in blocks])


@pytest.mark.parametrize("name", ["DEV-01", "synek2019_H01"])
def test_an_uploaded_session_compares_as_on_the_command_line(twin: Client, name: str) -> None:
    local = compare(Session.open(name, catalogue=False)).as_dict()
    comparison = twin.upload(name).compare()
    assert [c.id for c in comparison.cases] == [c["id"] for c in local["cases"]]
    for key in ("measured_N", "measured_sd_N", "predicted_N", "residual_N"):
        ours, theirs = [[getattr(c, key) for c in comparison.cases], [c[key] for c in local["cases"]]]
        np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-12)
    for group, planes in local["summary"].items():
        for plane in ("sagittal", "space"):
            assert comparison.rmse_N(group, plane) == pytest.approx(planes[plane]["rmse_N"], rel=1e-9)
    columns = comparison.table()
    assert {len(column) for column in columns.values()} == {len(comparison.cases)}
    residual = columns["measured_y_N"] - columns["predicted_y_N"]
    np.testing.assert_allclose(columns["residual_y_N"], residual, rtol=1e-9, atol=1e-12)


def test_the_readings_that_are_kept_are_those_of_the_file(twin: Client, receiver: ServiceReceiver) -> None:
    told: list[float] = []
    twin.upload("DEV-03", progress=lambda share, what: told.append(share))
    for kept, read in zip(stored(receiver, "DEV-03"), recorded("DEV-03"), strict=True):
        np.testing.assert_array_equal(kept, read)
    assert told[0] == 0.0
    assert told[-1] == 1.0
    assert told == sorted(told)


def test_nothing_is_sent_twice(twin: Client, line: InProcess, receiver: ServiceReceiver) -> None:
    twin.upload("DEV-04")
    version = twin.session("DEV-04").info().version
    before, sent = receiver.stored("DEV-04", STREAM), len(line.chunks)
    twin.upload("DEV-04")
    assert len(line.chunks) == sent
    assert receiver.stored("DEV-04", STREAM) == before
    assert twin.session("DEV-04").info().version == version


@pytest.mark.parametrize("break_at", [{"break_before": 2}, {"break_after": 2}])
def test_an_interrupted_upload_goes_on_where_it_was(
    twin: Client, line: InProcess, receiver: ServiceReceiver, break_at: dict[str, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    name = "DEV-05" if "break_before" in break_at else "DEV-06"
    vars(line).update(break_at)
    with monkeypatch.context() as other:
        # An earlier version may have sent other pieces.
        other.setattr(uploading, "CHUNK", 1500)
        with pytest.raises(ServiceUnreachableError, match="the cable is out"):
            twin.upload(name)
    line.break_before = line.break_after = None
    session = twin.upload(name)
    for kept, read in zip(stored(receiver, name), recorded(name), strict=True):
        np.testing.assert_array_equal(kept, read)
    assert session.info().body["streams"][0]["ended"] is True
    assert len(session.compare().cases) == len(read_session(name).cases)


def test_a_service_that_takes_little_at_once_gets_pieces(tmp_path: Path) -> None:
    with receiver_in(tmp_path, workers=1, most_body_bytes=1 << 16) as receiver:
        line = InProcess(receiver)
        with Client(URL, transport=line, retries=0) as twin:
            twin.upload("DEV-07")
            sent = len(line.chunks)
            twin.upload("DEV-07")
        assert len(line.chunks) == sent
        for kept, read in zip(stored(receiver, "DEV-07"), recorded("DEV-07"), strict=True):
            np.testing.assert_array_equal(kept, read)


def copied(name: str, folder: Path, **changes: Any) -> Path:
    shutil.copytree(find_session(name).parent, folder)
    document = yaml.safe_load((folder / "session.yaml").read_text(encoding="utf-8")) | changes
    (folder / "session.yaml").write_text(yaml.safe_dump(document), encoding="utf-8")
    return folder


def test_other_readings_under_the_same_id_are_refused(twin: Client, tmp_path: Path) -> None:
    folder = copied("synek2019_H02", tmp_path / "a", id="T-1", readings="readings.csv")
    lines = ["t_s,Fx_N,Fy_N,Fz_N,Tx_Nmm,Ty_Nmm,Tz_Nmm", *(f"{0.04 * i:.2f},1,2,3,4,5,6" for i in range(50))]
    (folder / "readings.csv").write_text("\n".join(lines), encoding="utf-8")
    twin.upload(folder)
    (folder / "readings.csv").write_text("\n".join(lines[:40]), encoding="utf-8")
    with pytest.raises(ServiceError, match=r"T-1 has other readings than readings\.csv") as caught:
        twin.upload(folder)
    assert caught.value.status == 409
    assert twin.upload(folder, name="T-2").id == "T-2"


def test_another_session_under_the_same_id_is_refused(twin: Client, tmp_path: Path) -> None:
    twin.upload("synek2019_H03")
    folder = copied("synek2019_H03", tmp_path / "a", tension_factor=0.9)
    with pytest.raises(ServiceError, match="differs") as caught:
        twin.upload(folder)
    assert caught.value.status == 409


def test_a_finger_of_ones_own_comes_along(twin: Client, tmp_path: Path) -> None:
    folder = copied("synek2019_H02", tmp_path / "own", id="T-3", finger="mine.yaml")
    text = (data_dir() / "fingers" / "synek2019_optimised.yaml").read_text(encoding="utf-8")
    (folder / "mine.yaml").write_text(text, encoding="utf-8")
    local = compare(Session.open(folder, catalogue=False)).summary()
    session = twin.upload(folder)
    # No revision stands for it yet, so both are the finger that came along, which has no name in the service.
    for comparison in (session.compare(model=None), session.compare()):
        for group, planes in local.items():
            assert comparison.rmse_N(group, "sagittal") == pytest.approx(planes["sagittal"]["rmse_N"], rel=1e-9)
        assert comparison.plot().data


def test_what_is_no_session_is_said_before_anything_is_sent(twin: Client, line: InProcess) -> None:
    with pytest.raises(ValueError, match="no session at DEV-99"):
        twin.upload("DEV-99")
    assert line.asked == []
