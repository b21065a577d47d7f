"""`fingertwin plot`: what is in a recording, before anybody has said what is what."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.daq.lab_files import resolved, tdms
from tests.server.test_exchange_cli import answered, refused


def test_channels_units_and_plateaus(tmp_path: Path) -> None:
    t_s = np.arange(0.0, 9.0, 0.01)
    rng = np.random.default_rng(1)
    columns = {f"rig/ch{i}": np.where(t_s < 4.5, 0.0, i) + rng.normal(0.0, 0.01, len(t_s)) for i in range(3)}
    columns |= {"rig/remark": np.array(["x"] * len(t_s))}
    path = tdms(tmp_path / "r.tdms", columns, {"rig/ch1": "mV", "rig/ch2": "bananas"}, wf_increment=0.01)
    body = answered("plot", path, "--out", tmp_path / "r.png")
    assert (body["readings"], body["time_unit"]) == (900, "s")
    assert [(c["name"], c["unit"]) for c in body["channels"]] == [
        ("rig/ch0", None), ("rig/ch1", "mV"), ("rig/ch2", "bananas")
    ]  # fmt: skip
    assert "rig/remark is left out: it holds text" in body["notes"]
    (first, second) = body["plateaus"]
    assert (first[0] < 1.0, 4.0 < first[1] < 4.5 < second[0] < 5.0, second[1] > 8.0) == (True, True, True)
    assert (tmp_path / "r.png").read_bytes().startswith(b"\x89PNG")


def test_a_channel_that_is_left_out_is_told_by_what_is_no_number(tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    head = "Time (s);Fx (N);Fy (N);Fz (N);Tx (Nmm)"
    path.write_text(f"{head}\n0;1,0;2;3;4\n1;1;2;x;\n", encoding="utf-8")
    notes = answered("plot", path, "--out", tmp_path / "r.png")["notes"]
    assert "Fz (N) is left out: it holds text ('x')" in notes
    assert "Tx (Nmm) is left out: it is empty in half of its rows or more" in notes


def test_a_recording_without_time_is_drawn_by_its_readings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    body = answered("plot", resolved(tmp_path / "r.tdms"))
    assert body["time_unit"] == "reading"
    assert "Plotly" in Path("r.tdms.html").read_text("utf-8")


def test_what_cannot_be_drawn_is_one_line(tmp_path: Path) -> None:
    assert "a name that ends in .html, .png, .svg" in refused("plot", "r.tdms", "--out", tmp_path / "r.pdf")
    assert "cannot be read" in refused("plot", tmp_path / "absent.csv")
    for given in (tmp_path, Path()):
        assert f"{given} is a folder; expected a recording. Name a file in it." in refused("plot", given)
        assert f"{given} is a folder; expected a recording. Name a file in it." in refused("import", given)
