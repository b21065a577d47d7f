"""`check` and `friction`: what can be used, and what is said of what cannot."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from daq.locations import data_dir
from daq.sessions import session_names
from server.application.provenance import told_first
from tests.server.command_line import (
    H01,
    RAW,
    SPECIMENS,
    Document,
    Edit,
    altered,
    every_case,
    first_case,
    kept,
    keys,
    refused,
    run,
    strict,
    with_readings,
)

# check


@pytest.mark.parametrize("session", session_names())
def test_every_shipped_session_is_usable(session: str) -> None:
    body = run("check", session, "--json", "-").body("check")
    assert (body["ok"], body["errors"], body["session"]) == (True, 0, session)
    assert all(set(f) == {"level", "code", "where", "text"} for f in body["findings"])


def checked(session: Path) -> tuple[int, set[tuple[str, str]]]:
    """Levels and codes; of a session that cannot be used, one line on stderr tells the first error."""
    answer = run("check", session, "--json", "-")
    body = strict(answer.out, "check")
    if answer.code:
        first = body["findings"][0]
        assert answer.err.startswith(f"fingertwin: {session}: not usable; {body['errors']} error")
        assert answer.err.endswith(f"{first['text']}\n")
        assert answer.err.count("\n") == 1
    else:
        assert answer.err == ""
    return answer.code, {(f["level"], f["code"]) for f in body["findings"]}


@pytest.mark.parametrize(
    "edit",
    [
        first_case(force_sd_N=0),
        first_case(force_N=[float("nan"), 0, 0]),
        first_case(force_N=[1, 2]),
        first_case(force_N=[1e200, 0, 0]),
        first_case(torque_Nmm=[0, 0, -1e200]),
        first_case(force_sd_N=1e200),
        first_case(force_cov_N2=[[1e200, 0, 0], [0, 1e200, 0], [0, 0, 1e200]]),
        first_case(masses_g={"FPL": 100}),
        first_case(masses_g={"FDP": -1}),
        first_case(masses_g={"FDP": 1e300}),
        first_case(role="guess"),
        first_case(posture="fist"),
        first_case(location="elbow"),
        first_case(loaded_s=[1, 2]),
        keys(format="bench-session/9"),
        keys(cases=[]),
        keys(finger="nosuch"),
        keys(readings="../elsewhere.csv"),
        keys(readings="absent.csv"),
        keys(tension_factor=-1),
        keys(budget=["a"]),
        lambda d: d["specimen"].update(donor_name="Jane Doe"),
        lambda d: d["postures_deg"]["hook"].update(PIP="bent"),
        lambda d: d["postures_deg"]["hook"].update(PIP=6500),
        lambda d: d.pop("specimen"),
    ],
)
def test_a_description_that_cannot_be_used_fails_check_and_compare(tmp_path: Path, edit: Edit) -> None:
    session = altered(tmp_path, edit)
    code, found = checked(session)
    assert code == 2
    assert "error" in {level for level, _ in found}
    refused("compare", session)
    assert run("check", session).code == 2


def test_a_name_under_specimen_is_refused(tmp_path: Path) -> None:
    session = altered(tmp_path, lambda d: d["specimen"].update(donor_name="Jane Doe"))
    line = refused("refit", session, saying="donor_name")
    assert "Jane" not in line


def test_masses_in_kilograms_are_refused(tmp_path: Path) -> None:
    kilograms = every_case(lambda c: c.update(masses_g={k: m / 1000 for k, m in c["masses_g"].items()}))
    code, found = checked(altered(tmp_path, kilograms))
    assert code == 2
    assert ("error", "session") in found


@pytest.mark.parametrize(
    ("budget", "said"),
    [
        ("generous", "generous"),
        ({"base": "generous"}, "generous"),
        ({"angle_sd_deg": -1}, "angle_sd_deg"),
        ({"angle_sd_deg": "wide"}, "angle_sd_deg"),
        ({"angle_sd": 1}, "Did you mean angle_sd_deg?"),
        ({"tendon_point_sd_mm": 2}, "tendon_point_sd_mm"),
        ({"tendon_point_sd_mm": {}}, "tendon_point_sd_mm"),
        ({"tendon_point_sd_mm": {"wrist": 1}}, "wrist"),
    ],
)
def test_a_budget_that_is_unknown_or_negative(tmp_path: Path, budget: Any, said: str) -> None:
    session = altered(tmp_path, keys(budget=budget))
    refused("compare", session, saying=said)


def test_an_estimated_budget_says_what_it_rests_on(tmp_path: Path) -> None:
    body = run("compare", altered(tmp_path, keys(budget="estimate")), "--json", "-").body("compare")
    assert body["budget"] == "estimate"
    assert any(n.startswith("budget estimated: ") for n in body["notes"])


@pytest.mark.parametrize(
    "edit",
    [
        keys(budget="generous"),
        lambda d: d["postures_deg"]["hook"].update(PIP=0, DIP=0),
        every_case(lambda c: c.update(excluded="all of them")),
        lambda d: d["postures_deg"]["hook"].update(wrist=10),
    ],
)
def test_what_compare_refuses_is_not_usable_to_check(tmp_path: Path, edit: Edit) -> None:
    session = altered(tmp_path, edit)
    refused("compare", session)
    refused("refit", session)
    assert run("check", session).code == 2


@pytest.mark.parametrize(
    ("edit", "said"),
    [
        (lambda t: "\n".join([*t.split("\n")[:50], "2.4" + 6 * ",nan", *t.split("\n")[51:]]), "nan"),
        (lambda t: t[: len(t) // 2], "cut off"),
        (lambda t: t[: t.index("\n", len(t) // 2) + 1], "outside the recording"),
        (lambda t: t[: t.index("\n") + 1], "no readings"),
        (lambda t: "", "header"),
        (lambda t: t.replace("Fx_N", "Fx", 1), "Fx"),
        (lambda t: t.replace("Fx_N", "Fx_pebble", 1), "pebble"),
    ],
)
def test_readings_that_cannot_be_used(tmp_path: Path, edit: Callable[[str], str], said: str) -> None:
    session = with_readings(tmp_path, edit)
    refused("compare", session, saying=said)
    code, found = checked(session)
    assert code == 2
    assert "error" in {level for level, _ in found}


def test_a_torn_archive(tmp_path: Path) -> None:
    session = altered(tmp_path, lambda d: None, RAW)
    file = session / "readings.csv.gz"
    file.write_bytes(file.read_bytes()[:50_000])
    refused("compare", session, saying="torn or damaged")
    assert checked(session)[0] == 2


def test_readings_in_other_units_are_converted_and_said(tmp_path: Path, compared: Document) -> None:
    body = run("compare", with_readings(tmp_path, lambda t: t.replace("Tz_Nmm", "Tz_Nm", 1)), "--json", "-").body(
        "compare"
    )
    assert any("Tz" in note and "1000" in note for note in body["notes"])
    assert compared["notes"] == []


@pytest.mark.parametrize(("window", "said"), [([1e5, 1e5 + 3], "outside"), ([9, 5], "loaded_s"), ([6, 6.01], "c001")])
def test_a_window_without_readings(tmp_path: Path, window: list[float], said: str) -> None:
    session = altered(tmp_path, first_case(loaded_s=window), RAW)
    refused("compare", session, saying=said)
    answer = run("check", session)
    assert answer.code == 2
    assert "c001" in answer.out


# friction


def test_friction_of_the_published_specimens() -> None:
    body = run("friction", *SPECIMENS, "--json", "-").body("friction")
    assert round(body["pooled"]["factor"], 4) == 0.8348
    assert body["pooled"]["n"] == len(body["cases"]) == 32
    assert [s["name"] for s in body["specimens"]] == ["H01", "H02", "H03", "B01"]
    assert all(s["low"] < s["factor"] < s["high"] for s in [*body["specimens"], body["pooled"]])
    assert "0.8348" in run("friction", *SPECIMENS).out


def test_friction_says_first_what_the_check_warns_of(tmp_path: Path) -> None:
    """The norm of a balance is the same where every force has the other sign, and so is the factor."""
    turned = altered(tmp_path, every_case(lambda c: c.update(force_N=[-f for f in c["force_N"]])))
    answer = run("friction", turned)
    assert answer.out.startswith("Warning: load_cell.mounts.tip: FDP alone pushes the tip towards proximal")
    body = run("friction", H01, turned, "--json", "-").body("friction")
    assert [w["code"] for w in body["warnings"]].count("wrong_sign") == 3
    assert {w["place"].split(": ")[0] for w in body["warnings"] if w["code"] == "wrong_sign"} == {"synek2019_H01"}
    assert run("friction", H01, "--json", "-").body("friction")["warnings"] == []


def test_an_error_of_the_check_is_told_from_a_warning_in_every_answer(tmp_path: Path) -> None:
    window = altered(tmp_path, lambda d: first_case(loaded_s=d["cases"][0]["unloaded_s"])(d), RAW)
    found = strict(run("check", window, "--json", "-").out, "check")["findings"]
    body = run("friction", window, "--json", "-").body("friction")
    levels = [(w["level"], w["code"]) for w in body["warnings"]]
    assert "error" in {level for level, _ in levels}
    assert levels == [(f["level"], f["code"]) for f in found if f["level"] != "note"]
    assert "Error found by the check: case c001" in run("friction", window).out
    lines = told_first(body)
    assert sum(line.startswith("Error found by the check: ") for line in lines) == len(
        [x for x in levels if x[0] == "error"]
    )


def test_friction_without_a_pair(tmp_path: Path) -> None:
    refused("friction", altered(tmp_path, kept(lambda c: c["location"] == "tip")), saying=H01)


def test_friction_counts_no_session_twice() -> None:
    refused("friction", H01, SPECIMENS[1], H01, saying=f"session {H01} is given twice; expected each session once")
    folder = str(data_dir() / "sessions" / H01)
    refused("friction", H01, folder, saying=f"session {folder} is given twice")


def test_friction_that_the_session_asks_for(tmp_path: Path) -> None:
    asks = keys(tension_factor={"estimate": "force_balance"})
    refused("compare", altered(tmp_path / "a", asks), saying="validation cases are never fitted")
    session = altered(tmp_path / "b", asks)
    session = altered(tmp_path / "c", every_case(lambda c: c.update(role="identification")), str(session))
    body = run("compare", session, "--json", "-").body("compare")
    mean = run("friction", session, "--json", "-").body("friction")["pooled"]
    assert "8 pairs of cases, ± 0.0" in body["tension_factor_source"]
    # Two of the loads pull more than hangs, which the published mean takes for friction.
    assert (mean["above_one"], round(mean["factor"], 3)) == (2, 0.914)
    assert body["tension_factor"] < 0.88
    assert "more_than_weights" in [w["code"] for w in body["warnings"]]
