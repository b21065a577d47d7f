"""What a bench session takes from its setup, and what from where it is logged."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from daq.drivers import driver
from server.commands.log_bench import bench_setup
from server.commands.log_parts import LogOptions


def test_a_setup_takes_its_finger_file_along(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    given = {
        "format": "bench-setup/1",
        "specimen": {"id": "S1", "species": "human", "digit": "third", "side": "left"},
        "finger": "mine.yaml",
        "tension_factor": 0.835,
    }
    Path("setup.yaml").write_text(json.dumps(given))
    Path("mine.yaml").write_text("format: finger/1\nid: mine\n")
    options = LogOptions("replay", None, None, (), Path("out"), None, protocol="levels", setup=Path("setup.yaml"))
    setup = bench_setup(options, driver("robotiq-ft300")({}))
    assert setup.as_value()["finger_document"] == {"format": "finger/1", "id": "mine"}


def test_two_days_of_one_setup_are_two_sessions(tmp_path: Path) -> None:
    specimen = {"id": "S1", "species": "human", "digit": "third", "side": "left"}
    given = {"format": "bench-setup/1", "id": "S1-rig", "specimen": specimen, "finger": "an1979_middle"}
    (tmp_path / "setup.yaml").write_text(json.dumps(given | {"tension_factor": 0.835}))

    def called(out: str, session: str | None = None) -> str:
        setup = tmp_path / "setup.yaml"
        options = LogOptions(
            "replay", None, None, (), tmp_path / out, None, protocol="levels", setup=setup, session=session
        )
        return bench_setup(options, driver("robotiq-ft300")({})).id

    assert [called("monday"), called("tuesday"), called("out", "wednesday")] == ["monday", "tuesday", "wednesday"]
