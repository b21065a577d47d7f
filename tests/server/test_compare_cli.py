"""`compare` and `refit`: answers, and revisions that are left behind."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import numpy as np
import pytest
import yaml

from daq.locations import data_dir
from daq.sessions import read_session, session_names
from tests.server.command_line import (
    CASE,
    ERRORS,
    H01,
    HMEAN,
    Document,
    altered,
    every_case,
    numbers,
    refused,
    run,
    strict,
)

# compare


@pytest.mark.parametrize("session", session_names())
def test_compare_of_every_shipped_session(session: str) -> None:
    body = run("compare", session, "--json", "-").body("compare")
    assert body["session"] == session
    for case in body["cases"]:
        assert set(case) == CASE
        for key in ("measured_N", "measured_sd_N", "predicted_N", "residual_N"):
            assert len(case[key]) == 3
        assert np.allclose(np.subtract(case["measured_N"], case["predicted_N"]), case["residual_N"])
        assert all(case[k] is None or len(case[k]) == 3 for k in ("measured_Nmm", "predicted_Nmm"))
    groups = {f"{c['role']}/{c['location']}" for c in body["cases"]}
    assert set(body["summary"]) == groups
    for name, planes in body["summary"].items():
        count = sum(f"{c['role']}/{c['location']}" == name for c in body["cases"])
        assert set(planes["sagittal"]) == set(planes["space"]) == ERRORS
        assert (planes["sagittal"]["components"], planes["space"]["components"]) == (2 * count, 3 * count)
    for key in ("by_muscle", "by_posture"):
        assert sum(group["space"]["cases"] for group in body[key].values()) == len(body["cases"])


def test_a_summary_is_that_of_its_cases(compared: Document) -> None:
    residuals = [c["residual_N"][:2] for c in compared["cases"] if (c["role"], c["location"]) == ("validation", "tip")]
    stated = compared["summary"]["validation/tip"]["sagittal"]["rmse_N"]
    assert stated == pytest.approx(np.sqrt(np.mean(np.square(residuals))), rel=1e-12)


def test_compare_with_a_shipped_finger_and_with_its_file() -> None:
    named = run("compare", HMEAN, "--model", "synek2019_optimised", "--json", "-").body("compare")
    file = data_dir() / "fingers" / "synek2019_optimised.yaml"
    assert run("compare", HMEAN, "--model", file, "--json", "-").body("compare") == named
    assert named["model"] == "synek2019_optimised"
    own = run("compare", HMEAN, "--json", "-").body("compare")
    published = [b["summary"]["identification/tip"]["sagittal"]["rmse_N"] for b in (own, named)]
    assert [round(x, 2) for x in published] == [0.53, 0.11]


def test_a_tendon_that_the_finger_lacks(tmp_path: Path) -> None:
    document = yaml.safe_load((data_dir() / "fingers" / "synek2019_initial.yaml").read_text(encoding="utf-8"))
    document["id"] = "without_lumbrical"
    document["muscles"].remove("LU")
    document["segments"] = [s for s in document["segments"] if s["slip"] != "LU"]
    document["hood"]["radial"].remove("LU")
    del document["hood"]["fractions"]["LU_ES"]
    file = tmp_path / "finger.yaml"
    file.write_text(yaml.safe_dump(document), encoding="utf-8")
    refused("compare", H01, "--model", file, saying="LU")


def test_a_straight_finger_is_named(tmp_path: Path) -> None:
    session = altered(tmp_path, lambda d: d["postures_deg"]["hook"].update(PIP=0, DIP=0))
    refused("compare", session, saying="hook")
    refused("refit", session, saying="hook")


def test_no_weight_and_no_force_give_an_answer(tmp_path: Path) -> None:
    nothing = every_case(lambda c: c.update(masses_g={}, force_N=[0, 0, 0]))
    body = run("compare", altered(tmp_path, nothing), "--json", "-").body("compare")
    errors = body["summary"]["identification/tip"]["space"]
    assert errors["rmse_N"] == pytest.approx(0.0, abs=1e-12)
    assert (errors["rmse_rel_pct"], errors["direction_error_deg"], errors["direction_cases"]) == (None, None, 0)


def test_figures_are_written_and_named(tmp_path: Path) -> None:
    folder = tmp_path / "figures"
    body = run("compare", H01, "--figures", folder, "--json", "-").body("compare")
    assert Path(body["figures"]) == folder / "compare.html"
    drawn = {p.stem for p in folder.glob("*.svg")}
    assert drawn == {p.stem for p in folder.glob("*.png")}
    assert {"vectors", "errors"} <= drawn
    assert all(p.stat().st_size > 1000 for p in folder.iterdir())


# refit


def test_a_refit_lowers_the_error_and_says_what_it_did(revision: tuple[Path, Document], compared: Document) -> None:
    path, body = revision
    wanted = {
        "outcome", "message", "objective", "evaluations", "seconds", "before", "after", "parameters", "model",
    }  # fmt: skip
    assert wanted <= set(body)
    assert {"name", "unit", "initial", "value", "sd", "at_bound"} <= set(body["parameters"][0])
    assert (body["outcome"], body["model"]) == ("converged", str(path))
    assert numbers(body["before"]) == pytest.approx(numbers(compared["summary"]), rel=1e-9)
    assert set(body["after"]) == set(body["before"])
    for name in ("identification/tip", "validation/tip"):
        before, after = (body[when][name]["sagittal"]["rmse_N"] for when in ("before", "after"))
        assert after < before


def test_a_case_with_a_mistyped_mass_counts_in_no_error_of_a_refit(tmp_path: Path) -> None:
    def mistype(document: Document) -> None:
        masses = document["cases"][3]["masses_g"]
        masses.update({muscle: 10.0 * mass for muscle, mass in masses.items()})

    session = altered(tmp_path, mistype, "DEV-02")
    case = read_session(session).cases[3]
    given = ("refit", session, "--out", tmp_path / "r1.json", "--figures", tmp_path / "figures")
    told = run(*given, "--json", tmp_path / "r1-answer.json").out
    body = strict((tmp_path / "r1-answer.json").read_text(encoding="utf-8"), "refit")
    assert body["reading_errors"]["not_counted"] == [case.id]
    sound = run("refit", "DEV-02", "--out", tmp_path / "r2.json", "--json", "-").body("refit")
    of_case = f"{case.role}/{case.location}"
    for when in ("before", "after"):
        counts = [found[when][of_case]["space"]["cases"] for found in (body, sound)]
        assert counts == [counts[1] - 1, counts[1]]
    ours, theirs = (found["after"]["validation/tip"]["space"]["rmse_N"] for found in (body, sound))
    assert ours == pytest.approx(theirs, rel=0.2)
    assert f"without {case.id}" in told
    page = (tmp_path / "figures" / "compare.html").read_text(encoding="utf-8")
    assert f"does not count what stands apart: {case.id}." in page


def test_a_revision_compares_as_its_refit_said(revision: tuple[Path, Document]) -> None:
    path, body = revision
    again = run("compare", H01, "--model", path, "--json", "-").body("compare")
    assert numbers(again["summary"]) == pytest.approx(numbers(body["after"]), rel=1e-9)
    assert again["notes"] == []


def test_a_revision_on_another_session_leaves_its_rig_behind(revision: tuple[Path, Document]) -> None:
    body = run("compare", HMEAN, "--model", revision[0], "--json", "-").body("compare")
    assert any(H01 in note for note in body["notes"])


def test_a_refit_from_its_own_revision_stays(revision: tuple[Path, Document], tmp_path: Path) -> None:
    path, body = revision
    again = run("refit", H01, "--model", path, "--out", tmp_path / "r2.json", "--json", "-").body("refit")
    assert again["objective"] == pytest.approx(body["objective"], rel=1e-6)
    assert numbers(again["before"]) == pytest.approx(numbers(body["after"]), rel=1e-9)


def test_a_revision_is_never_overwritten(revision: tuple[Path, Document], tmp_path: Path) -> None:
    path, _ = revision
    content = path.read_bytes()
    refused("refit", H01, "--out", path, saying=path.name)
    refused("refit", H01, "--out", tmp_path / "r2", saying="Call it r2.json")
    assert path.read_bytes() == content


def test_without_out_revisions_are_numbered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names = [run("refit", H01, "--json", "-").body("refit")["model"] for _ in range(2)]
    assert [Path(n).as_posix() for n in names] == [f"models/{H01}-r1.json", f"models/{H01}-r2.json"]
    assert sorted(p.name for p in Path("models").glob("*.json")) == [f"{H01}-r1.json", f"{H01}-r2.json"]


def test_eq_5_as_published(tmp_path: Path) -> None:
    body = run("refit", HMEAN, "--method", "slsqp", "--out", tmp_path / "r.json", "--json", "-").body("refit")
    assert body["method"] == "slsqp"
    errors = body["after"]["identification/tip"]["sagittal"]
    assert (round(errors["rmse_N"], 2), round(errors["rmse_rel_pct"], 2)) == (0.11, 10.73)


def test_a_refit_without_identification_cases(tmp_path: Path) -> None:
    session = altered(tmp_path, every_case(lambda c: c.update(role="validation")))
    for method in ("map", "slsqp"):
        refused("refit", session, "--method", method, saying="identification")


def test_a_single_case_in_one_posture_moves_little_and_says_what_it_cannot_know(tmp_path: Path) -> None:
    session = altered(tmp_path, lambda d: d.update(cases=d["cases"][:1]))
    body = run("refit", session, "--out", tmp_path / "r.json", "--json", "-").body("refit")
    assert body["outcome"] == "converged"
    assert "say nothing about" in body["message"]
    assert all(p["sd"] is None or p["sd"] <= 1.000001 * p["prior_sd"] for p in body["parameters"])
    again = run("compare", session, "--model", tmp_path / "r.json", "--json", "-").body("compare")
    assert numbers(again["summary"]) == pytest.approx(numbers(body["after"]), rel=1e-9)


def test_contradictory_cases_end_with_a_misfit_that_is_said(tmp_path: Path) -> None:
    def contradict(document: Document) -> None:
        first = document["cases"][0]
        document["cases"][1] |= {"masses_g": first["masses_g"], "force_N": [-f for f in first["force_N"]]}

    body = run("refit", altered(tmp_path, contradict), "--out", tmp_path / "r.json", "--json", "-").body("refit")
    assert body["outcome"] == "converged"
    assert "The misfit is" in body["message"]


def test_a_refit_prints_what_to_do_next(tmp_path: Path) -> None:
    answer = run("refit", H01, "--out", tmp_path / "r.json")
    assert (answer.code, answer.err) == (0, "")
    assert f"fingertwin compare {H01} --model {tmp_path / 'r.json'}" in answer.out


def test_the_command_that_a_refit_names_can_be_pasted_where_names_hold_spaces(tmp_path: Path) -> None:
    session = altered(tmp_path / "Prüf ling", lambda d: None)
    answer = run("refit", session, "--out", tmp_path / "r 1.json")
    told = re.search(r"\(fingertwin (.*)\)", answer.out)
    assert told is not None
    assert shlex.split(told[1]) == ["compare", str(session), "--model", str(tmp_path / "r 1.json")]
