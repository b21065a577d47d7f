"""`demo`: the main job on shipped data, through a running service."""

from __future__ import annotations

from pathlib import Path

import pytest

from server.commands import demo
from server.commands.console import say
from tests.server.command_line import run, strict


def test_the_demo_shows_the_error_fall(tmp_path: Path) -> None:
    file = tmp_path / "demo.json"
    answer = run("demo", "--out", tmp_path / "demo", "--json", file)
    assert (answer.code, answer.err) == (0, "")
    assert "Found: the tare missed a constant force (zero_offset.bone)" in answer.out
    assert "with zero_offset.bone" in answer.out
    assert "what is left" in answer.out
    assert "Beyond the catalogue they share an error of moment arms" in answer.out
    assert "It does not mend the bone loads" in answer.out
    for page in ("recorded/diagnose.html", "published/shared.html"):
        assert (tmp_path / "demo" / page).stat().st_size > 100_000
    body = strict(file.read_text(encoding="utf-8"), "demo")
    steps = body["recorded"]
    assert {name: step["schema"] for name, step in steps.items()} == {n: f"fingertwin/{n}/1" for n in steps}
    assert steps["diagnose"]["effects"] == ["zero_offset"]
    assert steps["revision"]["after"]["validation/bone"]["space"]["rmse_N"] < 0.1
    assert body["published"]["shared"]["laws"]
    assert all(Path(page).is_file() for page in body["pages"])


def test_a_demo_whose_answer_goes_to_standard_output_tells_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def told(_: Path) -> dict[str, float]:
        say("1. A recorded session")
        return {"seconds": 1.0}

    monkeypatch.setattr(demo, "_demo", told)
    assert run("demo", "--out", tmp_path, "--json", "-").body("demo")["seconds"] == 1.0
