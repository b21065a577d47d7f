"""The tapping finger of Wu et al. 2008: what agrees, what does not, and how close the authors' later model is."""

from __future__ import annotations

import numpy as np
import pytest

from fingermodel.studies.published import Row
from server.reproduce.study import Reproduction, Sheet, reproduce


@pytest.fixture(scope="module")
def study() -> Reproduction:
    return reproduce("wu2008", lambda fraction: None)


def rows(study: Reproduction, *parts: str) -> list[Row]:
    return [r for r in study.rows if all(p in r.quantity for p in parts)]


def sheet(study: Reproduction, title: str) -> Sheet:
    (found,) = [s for s in study.sheets if title in s.title]
    return found


def test_every_figure_of_table_1b_follows_from_table_1a(study: Reproduction) -> None:
    """All twelve, but for a mass that the rounding of the dimensions leaves open."""
    found = [*rows(study, "mass, "), *rows(study, "I_")]
    assert len(found) == 12
    assert [r.quantity for r in found if not r.agrees] == ["mass, distal segment"]
    for r in found:
        assert r.ours == pytest.approx(r.published, rel=4e-3)
    assert "3.895 to 3.913 g" in rows(study, "mass, distal")[0].note


def test_peaks_differ_from_the_paper_and_say_why(study: Reproduction) -> None:
    ratios = {r.quantity[8:10]: r for r in rows(study, "over peak at the fingertip")}
    assert {m: r.printed for m, r in ratios.items()} == {"FS": "0.95", "FP": "2.9"}
    assert ratios["FS"].ours == pytest.approx(1.466, abs=2e-3)
    assert ratios["FP"].ours == pytest.approx(1.983, abs=2e-3)
    for r in ratios.values():
        assert r.agrees is False
        assert "recruitment solver" in r.note
    assert [r.agrees for r in rows(study, "measured by Kursa")] == [True, True]


def test_the_order_in_time(study: Reproduction) -> None:
    """Extensors before the downswing and again after contact; flexors and interossei in contact."""
    for name in ("EC", "EI"):
        (before,), (again,) = rows(study, f"{name} becomes active"), rows(study, f"{name} after contact")
        assert (before.agrees, again.agrees) == (True, True)
    for name in ("FDP", "FDS", "UI", "RI", "EC", "EI"):
        (peak,) = [r for r in study.rows if r.quantity == f"peak of {name}"]
        assert peak.agrees
    late = {r.quantity.split()[0] for r in rows(study, "exceeds half of its peak") if not r.agrees}
    assert late == {"FDS", "UI", "RI"}


def test_both_readings_of_the_passive_shares_have_their_row(study: Reproduction) -> None:
    for name, printed in (("UI", "18"), ("RI", "10")):
        found = rows(study, f"passive force of {name} ")
        assert [r.printed for r in found] == [printed, printed]
        assert all("the wording allows" in r.note for r in found)
        assert (found[0].ours or 0.0) < (found[1].ours or 0.0)
    assert rows(study, "greatest passive forces")[0].agrees


def test_what_is_in_figures_alone_is_not_claimed(study: Reproduction) -> None:
    assert [r.ours for r in rows(study, "Jindrich")] == [None, None]
    assert all(r.printed for r in study.rows)


def test_the_authors_later_model_is_met(study: Reproduction) -> None:
    """Travels of 2 to 4 mm within 0.2 mm; forces of FDP, RI and UI within 7 % of their peak; the others' course."""
    lines = {str(line[0]): [float(x) for x in line[1:] if x is not None] for line in sheet(study, "Beside AMMR").lines}
    assert set(lines) == {"FDP", "FDS", "EC", "EI", "RI", "UI", "LU"}
    for travel, apart, *_ in lines.values():
        assert apart < 0.2
        assert travel > 2.0
    for name in ("FDP", "RI", "UI"):
        _, _, theirs, ours, apart, r = lines[name]
        assert ours == pytest.approx(theirs, rel=0.05)
        assert apart < 0.07 * theirs
        assert r > 0.98
    for name in ("FDS", "EC", "EI"):
        assert lines[name][-1] > 0.9


def test_no_direction_of_the_tip_force_gives_both_peaks(study: Reproduction) -> None:
    lines = [line for line in sheet(study, "turned").lines if line[0] is not None]
    fds, fdp = (np.array([line[k] for line in lines], dtype=float) for k in (1, 2))
    both = np.hypot(fds / 1.24 - 1.0, fdp / 3.80 - 1.0)
    assert both.min() > 0.25
    assert (np.diff(fdp) > 0.0).all()


def test_what_the_paper_leaves_out_is_said(study: Reproduction) -> None:
    said = " ".join(study.assumptions)
    for word in ("polynomials are not printed", "Gravity", "Centres of mass", "Hood", "Landsmeer", "21 mm", "Eq 3"):
        assert word in said


def test_the_figures_show_the_later_model_beside_ours(study: Reproduction) -> None:
    assert study.plots is not None
    plots = {p.name: p for p in study.plots()}
    assert list(plots) == ["movement", "muscles"]
    beside = [t for t in plots["muscles"].figure.data if t.name == "AMMR's output"]
    assert len(beside) == 7
    assert all(p.caption for p in plots.values())
