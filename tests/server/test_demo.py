"""`demo`: the main job on shipped data, through a running service, and what published specimens share."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from server.commands import demo
from server.commands.console import say
from server.figures.shared_law import law_figure
from tests.server.command_line import Answer, run, strict


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> tuple[Answer, Path]:
    """What the demo says, and the folder of its pages, in which its answer is `demo.json`."""
    folder = tmp_path_factory.mktemp("demo")
    return run("demo", "--out", folder, "--json", folder / "demo.json"), folder


@pytest.fixture(scope="module")
def published(shown: tuple[Answer, Path]) -> dict[str, Any]:
    """Answer about the published specimens together."""
    body: dict[str, Any] = strict((shown[1] / "demo.json").read_text(encoding="utf-8"), "demo")["published"]
    return body


def test_the_demo_shows_the_error_fall(shown: tuple[Answer, Path]) -> None:
    answer, folder = shown
    assert (answer.code, answer.err) == (0, "")
    assert "Found: the tare missed a constant force (zero_offset.bone)" in answer.out
    assert "with zero_offset.bone" in answer.out
    assert "what is left" in answer.out
    assert "Beyond the catalogue they share an error of moment arms" in answer.out
    assert "It does not mend the bone loads" in answer.out
    for page in ("recorded/diagnose.html", "published/shared.html"):
        assert (folder / page).stat().st_size > 100_000
    body = strict((folder / "demo.json").read_text(encoding="utf-8"), "demo")
    steps = body["recorded"]
    assert {name: step["schema"] for name, step in steps.items()} == {n: f"fingertwin/{n}/1" for n in steps}
    assert steps["diagnose"]["effects"] == ["zero_offset"]
    assert steps["revision"]["after"]["validation/bone"]["space"]["rmse_N"] < 0.1
    assert body["published"]["shared"]["laws"]
    assert all(Path(page).is_file() for page in body["pages"])


def test_the_published_specimens_share_an_error_of_moment_arms(published: dict[str, Any]) -> None:
    shared = published["shared"]
    assert shared.keys() >= {"log_evidence_over_own", "permutation_p", "left_out_gain", "carried_by", "laws"}
    assert shared["stage"] == "arms"
    assert shared["log_evidence_over_own"] > 3.0
    assert shared["permutation_p"] <= 0.02
    # H02 has two fits about equally good: which one a machine's rounding prefers decides whether it gains.
    gains = shared["left_out_gain"]
    assert sum(gains.values()) > 9.0
    assert all(gain > 0.0 for specimen, gain in gains.items() if specimen != "synek2019_H02")
    assert {(c["muscle"], c["joint"]) for c in shared["carried_by"][:2]} == {("RI", "PIP"), ("FDS", "PIP")}


def test_its_law_lowers_the_tip_error_of_specimens_that_it_was_not_learned_from(
    published: dict[str, Any],
) -> None:
    law = published["shared"]["laws"][0]
    assert law["formula"] == "torque[PIP] += k * t_FDS * q_MCP"
    assert "torque[PIP] += k * t_FDS * sin(q_MCP)" in law["rivals"]
    assert all(gain > 0.0 for gain in law["left_out_gain"].values())
    falls = [e["tip"]["after"] < e["tip"]["before"] for e in law["unseen_rmse_N"].values()]
    assert sum(falls) >= 3
    # The bone loads are another matter, and it says so.
    assert any(e["bone"]["after"] > e["bone"]["before"] for e in law["unseen_rmse_N"].values())
    assert law["agreement"] < 2.0


def test_its_law_is_drawn_as_these_readings_would_show_it(published: dict[str, Any]) -> None:
    curve, law = published["shared"]["curves"][0], published["shared"]["laws"][0]
    shown = {(p["muscle"], p["joint"]): np.array(y) for p, y in zip(curve["parts"], law["curve"], strict=True)}
    sizes = {part: float(np.linalg.norm(y)) for part, y in shown.items()}
    assert max(sizes, key=lambda part: sizes[part]) == ("FDS", "PIP")
    said = law["value"] * np.deg2rad([p["MCP"] for p in curve["postures_deg"]])
    assert np.corrcoef(shown["FDS", "PIP"], said)[0, 1] > 0.9
    assert sizes["FDS", "PIP"] < np.linalg.norm(said), "smoothing takes some of it"
    figure = law_figure(published)
    assert law["formula"] in figure.layout.title.text
    assert sum(t.name == "the law" for t in figure.data) == len(curve["parts"])


def test_it_says_what_would_decide(published: dict[str, Any]) -> None:
    found = published["shared"]["would_decide"]
    assert found["on"] in demo.PUBLISHED
    assert found["readings"]
    assert found["between"][0] == published["shared"]["laws"][0]["formula"]
    gains = [r["information_nat"] for r in found["readings"]]
    assert gains == sorted(gains, reverse=True)
    assert all("FDS" in r["masses_g"] for r in found["readings"][:2])


def test_a_demo_whose_answer_goes_to_standard_output_tells_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def told(_: Path) -> dict[str, float]:
        say("1. A recorded session")
        return {"seconds": 1.0}

    monkeypatch.setattr(demo, "_demo", told)
    assert run("demo", "--out", tmp_path, "--json", "-").body("demo")["seconds"] == 1.0
