"""Windows that were noted at other times than those of their plateau."""

from __future__ import annotations

import copy

import pytest
import yaml

from daq.checks import check
from daq.locations import data_dir
from daq.sessions import parse_session


@pytest.mark.parametrize("shift_s", [-3.0, -2.0, 0.3, 1.0, 2.0])
@pytest.mark.parametrize("index", [1, 7, 13, 40, 90])
def test_windows_shifted_onto_a_load_change_alarm(shift_s: float, index: int) -> None:
    folder = data_dir() / "sessions" / "DEV-01"
    data = yaml.safe_load((folder / "session.yaml").read_text(encoding="utf-8"))
    shifted = data["cases"][index]
    shifted["loaded_s"] = [t + shift_s for t in shifted["loaded_s"]]
    session, faults = parse_session(data, folder)
    assert session is not None, faults
    report = check(session)
    assert not report.ok
    assert {f.code for f in report.errors} <= {"load_change", "overlap"}
    assert all(shifted["id"] in f.where + f.text for f in report.errors)


@pytest.mark.parametrize("shift_s", [-0.3, 0.04])
def test_windows_moved_inside_their_plateau_do_not_alarm(shift_s: float) -> None:
    folder = data_dir() / "sessions" / "DEV-01"
    data = yaml.safe_load((folder / "session.yaml").read_text(encoding="utf-8"))
    moved = copy.deepcopy(data)
    for c in moved["cases"]:
        c["loaded_s"] = [t + shift_s for t in c["loaded_s"]]
    session, _ = parse_session(moved, folder)
    assert session is not None
    report = check(session)
    assert report.ok, report.errors
    assert report.warnings == ()
