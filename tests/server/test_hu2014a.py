"""The pressing index finger of Hu et al. 2014a: what holds, what does not, and that nothing unprinted is claimed."""

from __future__ import annotations

from pathlib import Path

import pytest

from fingermodel.studies.published import Row
from server.reproduce.report import write_study
from server.reproduce.study import Reproduction, reproduce, study_of

FITTED = "terminal slip fitted"


@pytest.fixture(scope="module")
def study() -> Reproduction:
    return reproduce("hu2014a", lambda fraction: None)


def rows(study: Reproduction, *parts: str) -> list[Row]:
    return [r for r in study.rows if all(p in r.quantity for p in parts)]


def test_every_printed_number_of_both_tables_has_its_row(study: Reproduction) -> None:
    for who, postures in (("An's index", 3), ("flexor fitted", 1), (FITTED, 3)):
        tables = [r for r in rows(study, who) if r.quantity.rsplit(": ")[-1] in {
            "extensor", "flexor", "radial", "ulnar", "DIP", "PIP", "MCP",
        }]  # fmt: skip
        assert len(tables) == postures * 2 * 7
    assert all(r.printed for r in study.rows)


def test_the_printed_means_do_not_meet_the_studys_own_laws(study: Reproduction) -> None:
    """LE = ES with ES = (RI + UI + LU)/3 + LE/6 is linear, so means must meet it; Table 2 is off by 16 to 49 %."""
    found = rows(study, "Table 2", "by the laws")
    assert [r.agrees for r in found] == [False] * 4
    short = [1.0 - (r.ours or 0.0) / (r.published or 1.0) for r in found]
    assert min(short) == pytest.approx(0.164, abs=1e-3)
    assert max(short) == pytest.approx(0.489, abs=1e-3)


def test_a_fitted_number_is_never_counted_as_agreement(study: Reproduction) -> None:
    given = [r for r in study.rows if r.agrees is None]
    assert {r.quantity for r in given} == {
        "flexor fitted, posture 1, no hood: extensor",
        "flexor fitted, posture 1, no hood: flexor",
        f"{FITTED}, posture 1, no hood: flexor",
    }
    assert all(r.ours == pytest.approx(r.published) for r in given)


def test_with_the_flexor_fitted_the_first_posture_follows(study: Reproduction) -> None:
    """Two numbers fitted, twelve predicted: all but the PIP contact with a hood within the printed spread."""
    found = [r for r in rows(study, "flexor fitted, posture 1, ", "hood: ") if "with the hood" not in r.quantity]
    judged = [r for r in found if r.agrees is not None]
    assert len(judged) == 12
    assert [r.quantity for r in judged if not r.agrees] == ["flexor fitted, posture 1, hood: PIP"]


def test_with_one_fitted_arm_the_hood_spares_intrinsics_and_mcp_in_every_posture(study: Reproduction) -> None:
    for what in ("radial intrinsics less by", "ulnar intrinsics less by", "MCP contact less by"):
        changes = [r.ours for r in rows(study, FITTED, what)]
        assert len(changes) == 3
        assert all(change is not None and change > 20.0 for change in changes)
    for what in ("radial", "ulnar"):
        held = {r.quantity: r.agrees for r in rows(study, FITTED, f"{what} intrinsics less by")}
        assert [agrees for name, agrees in held.items() if "posture 4" not in name] == [True, True]


def test_with_one_fitted_arm_mcp_contact_grows_with_flexion(study: Reproduction) -> None:
    answers = study.results["pressing"][FITTED]
    assert [a["load"] for a in answers] == ["flexed", "between", "extended"]
    for model in ("minimal", "chao"):
        contact = [a["forces"][model]["MCP"] for a in answers]
        assert contact == sorted(contact, reverse=True)
    # Printed with LU, RI seems to pull; alone it is asked to push.
    assert [(a["push"]["minimal"], a["push"]["chao"]) for a in answers] == [((), ("RI",))] * 3


def test_an_index_as_it_is_is_asked_to_push_and_says_so(study: Reproduction) -> None:
    answers = study.results["pressing"]["An's index"]
    assert all("PE" in a["push"]["minimal"] and "RI" in a["push"]["chao"] for a in answers)
    for r in rows(study, "An's index", "hood: "):
        assert ("asks the muscle to push" in r.note) == ((r.ours or 0.0) < 0.0)


def test_what_the_paper_leaves_out_is_said(study: Reproduction) -> None:
    said = " ".join(study.assumptions)
    for word in ("S1 and S2", "Hu et al. 2014b", "An et al.", "not scaled", "19.67 mm", "s.e.m."):
        assert word in said


def test_more_with_flexion_holds_for_two_of_three_printed_and_not_for_ours(study: Reproduction) -> None:
    grows = {r.quantity.partition(":")[0]: r.agrees for r in rows(study, "taken off in posture 1")}
    assert grows == {
        "Tables 1 and 2, MCP contact": True,
        "Tables 1 and 2, radial intrinsics": True,
        "Tables 1 and 2, ulnar intrinsics": False,
        f"{FITTED}, MCP contact": False,
        f"{FITTED}, radial intrinsics": False,
        f"{FITTED}, ulnar intrinsics": False,
    }


def test_the_texts_changes_are_held_against_its_tables(study: Reproduction) -> None:
    """22 to 61 % and 10 to 41 % in the text; 16 to 59 % and 10 to 29 % from the means of Tables 1 and 2."""
    found = rows(study, "Tables 1 and 2", "less with the hood")
    assert [(r.printed, round(r.ours or 0.0, 1), r.agrees) for r in found] == [
        ("22", 15.8, False), ("61", 58.8, False), ("10", 10.2, True), ("41", 29.5, False), ("43", 24.0, False),
    ]  # fmt: skip


@pytest.mark.full  # drawn as PNG and SVG, which other studies' figures are too
def test_the_figures_are_written(study: Reproduction, tmp_path: Path) -> None:
    page = write_study(tmp_path, study_of("hu2014a"), study)
    assert page.read_text(encoding="utf-8").count("<figure>") == 2
    assert {f.name for f in tmp_path.iterdir()} == {
        "reproduce.html",
        *(f"pressing-{name}.{kind}" for name in ("normative", "fitted") for kind in ("png", "svg")),
    }


def test_the_figures_show_every_load_under_both_models(study: Reproduction) -> None:
    assert study.plots is not None
    plots = {p.name: p for p in study.plots()}
    for name, panels in (("pressing-normative", 3), ("pressing-fitted", 4)):
        bars = [t for t in plots[name].figure.data if t.type == "bar"]
        assert len(bars) == panels * 2 * 2
        assert all(len(t.y) == 7 for t in bars)
        assert plots[name].caption
