"""The elastic hood of Hu et al. 2014b: what of its tables holds, what does not, and that nothing else is claimed."""

from __future__ import annotations

from pathlib import Path

import pytest

import server.reproduce.hu2014b_specimens as specimens
from fingermodel.studies.published import Row
from server.figures.static import write_static
from server.reproduce.hu2014b_network import mended
from server.reproduce.printed import reference
from server.reproduce.study import Reproduction, reproduce

LOADS = ("flexed", "between", "extended")


@pytest.fixture(scope="module")
def study() -> Reproduction:
    with pytest.MonkeyPatch.context() as patch:
        # Two refits are compiled anew after every change of the model: the full tests have one specimen.
        patch.setattr(specimens, "SPECIMENS", ())
        return reproduce("hu2014b", lambda fraction: None)


def rows(study: Reproduction, *parts: str) -> list[Row]:
    return [r for r in study.rows if all(p in r.quantity for p in parts)]


def test_every_figure_of_tables_2_and_3_has_its_row(study: Reproduction) -> None:
    springs = study.results["springs"]
    assert len(springs) == 18
    for number, load in enumerate(LOADS, start=1):
        for spring in springs:
            for what, printed in zip(
                ("length change", "force"), reference("hu2014b")["components"][load][spring], strict=True
            ):
                (found,) = [r for r in study.rows if r.quantity == f"posture {number}, {spring}: {what}"]
                assert found.printed == printed


def test_table_1_has_its_rows(study: Reproduction) -> None:
    assert len(rows(study, "contact force")) == len(rows(study, "by Eqs 7 and 8")) == 9


def test_slack_springs_carry_exactly_nothing(study: Reproduction) -> None:
    """All that are slack in print are slack with us; of the taut ones only those below 1 N are not taut."""
    forces = [r for r in rows(study, ": force") if not r.quantity.endswith("mended")]
    assert len(forces) == 54
    slack = [r for r in forces if r.printed == "0"]
    assert len(slack) == 7
    assert all(r.ours == 0.0 for r in slack)
    lost = [r for r in forces if r.printed != "0" and r.ours == 0.0]
    assert len(lost) == 4
    assert all(float(r.printed) < 1.0 for r in lost)


def test_what_placed_a_node_and_what_is_misprinted_is_never_counted_as_agreement(study: Reproduction) -> None:
    given = [r for r in study.rows if r.note.startswith("given")]
    assert {r.quantity.split(", ")[1] for r in given} == {"GB: force", "MB: force"}
    misprints = [r for r in study.rows if r.note.startswith("misprint")]
    assert len(misprints) == 7
    assert all(r.agrees is None for r in given + misprints)


def test_forces_are_within_a_few_newtons_of_the_printed_ones(study: Reproduction) -> None:
    """Nothing is fitted to a force; the central slip, the largest, comes within 3 % in every posture."""
    for number, load in enumerate(LOADS, start=1):
        (central,) = rows(study, f"posture {number}, CD: force")
        assert central.ours == pytest.approx(mended(load, "CD")[1], rel=0.03)
    (layouts,) = [s for s in study.sheets if s.title.startswith("What the unprinted layout")]
    assert layouts.lines[0][0] == "as shipped"
    assert float(layouts.lines[0][1] or 0.0) == pytest.approx(3.97, abs=0.02)


def test_printed_force_is_stiffness_times_printed_length_change(study: Reproduction) -> None:
    """Hooke's law holds in print but for the misprints that are named; mended, it holds for all."""
    (sheet,) = [s for s in study.sheets if s.title.startswith("Stiffness")]
    for spring, *_, stiffness in sheet.lines:
        for load in LOADS:
            length, force = mended(load, str(spring))
            # Half a digit of the length.
            assert force == 0.0 or abs(force / float(stiffness or 0.0) - length) < 0.0011


@pytest.mark.full
def test_specimens_do_not_tell_the_hoods_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(specimens, "SPECIMENS", ("H02",))
    sheet, results = specimens.against_rhombus(lambda fraction: None)
    assert len(sheet.lines) == 2
    for key in ("identification/tip", "validation/tip", "validation/bone"):
        fingers = ("synek2019_initial", "synek2019_network")
        rhombus, network = (results["H02"][f]["rmse_N"]["after"][key] for f in fingers)
        assert network == pytest.approx(rhombus, abs=0.005)


def test_what_the_paper_leaves_out_is_said(study: Reproduction) -> None:
    said = " ".join(study.assumptions)
    for word in ("Node positions", "LE's column", "Eq 8", "An et al. 1979", "Stiffnesses", "G and M lie"):
        assert word in said


def test_the_figures_are_drawn(study: Reproduction, tmp_path: Path) -> None:
    assert study.plots is not None
    plots = study.plots()
    write_static(tmp_path, {p.name: p.figure for p in plots})
    assert {f.stem for f in tmp_path.iterdir()} == {"hood-network", "hood-forces"}
