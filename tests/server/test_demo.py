"""`demo`: the main job on shipped data, through a running service."""

from __future__ import annotations

from pathlib import Path

from tests.server.command_line import run


def test_the_demo_shows_the_error_fall(tmp_path: Path) -> None:
    answer = run("demo", "--out", tmp_path / "demo")
    assert (answer.code, answer.err) == (0, "")
    assert "Found: the tare missed a constant force (zero_offset.bone)" in answer.out
    assert "with zero_offset.bone" in answer.out
    assert "what is left" in answer.out
    assert "Beyond the catalogue they share an error of moment arms" in answer.out
    assert "It does not mend the bone loads" in answer.out
    for page in ("recorded/diagnose.html", "published/shared.html"):
        assert (tmp_path / "demo" / page).stat().st_size > 100_000
