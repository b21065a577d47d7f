"""Files, findings and readings of a session."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from daq.checks import check
from daq.errors import InputError
from daq.recordings.readings import open_readings
from daq.sessions import read_session
from fingertwin.client import Client, ServiceError

NAME = "DEV-01"


def test_a_session_comes_back_as_files(twin: Client, tmp_path: Path) -> None:
    session = twin.upload(NAME)
    table = session.export(tmp_path / "cases.csv")
    lines = table.read_text(encoding="utf-8").splitlines()
    assert len(lines) == 1 + len(session.cases())
    assert session.export(tmp_path / "x.bin", "hdf5").read_bytes().startswith(b"\x89HDF")
    assert session.export(tmp_path / "again.zip", "folder").read_bytes().startswith(b"PK")
    page = session.report(tmp_path / "report.html").read_text(encoding="utf-8")
    assert NAME in page
    with pytest.raises(InputError, match="ends in"):
        session.export(tmp_path / "cases.docx")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["again.zip", "cases.csv", "report.html", "x.bin"]


def test_what_is_found_in_a_session_is_what_the_command_finds(twin: Client) -> None:
    found = twin.upload(NAME).check()
    here = check(read_session(NAME))
    assert found.ok == (not any(f.level == "error" for f in here.findings))
    assert [f["code"] for f in found.findings] == [f.code for f in here.findings]


def test_readings_are_those_of_the_recording(twin: Client) -> None:
    session = twin.upload(NAME)
    path = read_session(NAME).readings_path
    assert path is not None
    blocks = list(open_readings(path).blocks())
    t_s, wrench = np.concatenate([b.t_s for b in blocks]), np.concatenate([b.wrench for b in blocks])
    some = session.readings(10.0, 12.0, points=10_000)
    inside = (t_s >= 10.0) & (t_s <= 12.0)
    np.testing.assert_array_equal(some.from_s, t_s[inside])
    np.testing.assert_array_equal(some.least, wrench[inside])
    whole = session.readings(points=50)
    assert len(whole.from_s) <= 50
    np.testing.assert_array_equal(whole.least.min(axis=0), wrench.min(axis=0))
    np.testing.assert_array_equal(whole.most.max(axis=0), wrench.max(axis=0))


def test_keys_of_a_bench_that_is_not_connected_are_refused(twin: Client) -> None:
    session = twin.upload(NAME)
    with pytest.raises(ServiceError, match="no bench") as caught:
        session.press("tare")
    assert caught.value.status == 409
