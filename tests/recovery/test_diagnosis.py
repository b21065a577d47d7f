"""Diagnoses of sessions whose truth is known: recorded by another simulator, and drawn by ours of other physics."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fingermodel.diagnosis.candidates import NOTHING_MISSING, candidates_of
from fingermodel.diagnosis.pooled import diagnose_pooled

from daq.errors import ModelError, SessionError
from daq.sessions import read_session, write_session
from fingermodel.diagnosis.addition import add_effects
from fingermodel.diagnosis.diagnose import Diagnosis
from fingermodel.diagnosis.frozen import freeze, read_frozen, score, write_frozen
from fingermodel.diagnosis.next_cases import PlannedReading, name_of, plan_next
from fingermodel.diagnosis.search import Searcher
from fingermodel.problems import Problem, map_problem
from fingermodel.solver import Solution
from server.commands.diagnosis import run_diagnosis
from server.workflow import Bench, open_bench
from tests.simulator import Kind, draw_session, draw_truth

TRUTH = Path(__file__).parents[1] / "truth"


@cache
def diagnosed(session: str) -> tuple[Bench, Diagnosis]:
    bench = open_bench(session, catalogue=True)
    return bench, run_diagnosis(bench)


def truth_of(session: str) -> dict[str, Any]:
    effects: dict[str, Any] = json.loads((TRUTH / f"{session}.json").read_text(encoding="utf-8"))["effects"]
    return effects


@pytest.mark.parametrize(
    ("session", "kind", "effects"),
    [
        ("DEV-01", "nothing_missing", ()),
        ("DEV-02", "found", ("hanger_mass",)),
        ("DEV-03", "found", ("sheath_friction",)),
        ("DEV-04", "found", ("cell_rotation",)),
        ("DEV-05", "found", ("goniometer_bias",)),
        ("DEV-06", "found", ("bowstringing",)),
        ("DEV-08", "found", ("zero_offset",)),
        ("DEV-09", "found", ("hood_shift",)),
        ("DEV-10", "found", ("tare_drift",)),
        ("DEV-11", "found", ("fdp_fds_coupling", "cell_crosstalk")),
        ("DEV-12", "none_of_catalogue", ()),
    ],
)
def test_a_recorded_session_is_read_rightly(session: str, kind: str, effects: tuple[str, ...]) -> None:
    _, found = diagnosed(session)
    assert (found.verdict.kind, found.verdict.effects) == (kind, effects), found.verdict
    named = {w for w in found.evidence.probability if w}
    assert sum(found.evidence.probability.values()) == pytest.approx(1.0, abs=1e-6)
    assert named


def test_an_effect_that_the_data_cannot_show_is_not_named() -> None:
    # The volar plate of DEV-07 changes the readings by less than the budget absorbs.
    _, found = diagnosed("DEV-07")
    assert found.verdict.kind in ("nothing_missing", "undecided")
    assert not found.verdict.effects


@pytest.mark.parametrize(
    ("session", "parameter", "value", "unit"),
    [
        ("DEV-02", "hanger_mass.m0", lambda t: 1000.0 * t["hanger_mass"], "g"),
        ("DEV-08", "zero_offset.bone.x", lambda t: t["zero_offset"][1][0], "N"),
        ("DEV-08", "zero_offset.bone.z", lambda t: t["zero_offset"][1][2], "N"),
        ("DEV-05", "goniometer_bias.MCP", lambda t: np.rad2deg(t["goniometer_bias"][0]), "deg"),
        ("DEV-11", "fdp_fds_coupling.kappa", lambda t: t["fdp_fds_coupling"], "1"),
    ],
)
def test_a_finding_has_the_true_size_within_its_uncertainty(
    session: str, parameter: str, value: Any, unit: str
) -> None:
    bench, found = diagnosed(session)
    index = bench.model.parameters.index[parameter]
    fitted = found.best.fitted
    sd = fitted.sd(index)
    assert bench.model.parameters.parameters[index].unit == unit
    assert sd is not None
    assert abs(fitted.theta[index] - value(truth_of(session))) < 3.0 * sd


@pytest.mark.parametrize("session", ["DEV-02", "DEV-06", "DEV-09", "DEV-10"])
def test_the_error_falls_where_nothing_was_fitted(session: str) -> None:
    _, found = diagnosed(session)
    before, after = found.validation_rmse(found.evidence.nothing), found.validation_rmse(found.best)
    assert before is not None
    assert after is not None
    assert after < before


def test_hints_say_where_something_unknown_acts() -> None:
    _, found = diagnosed("DEV-12")
    assert found.hints
    assert found.hints[0].log_evidence_gain > 3.0
    assert all(h.formula.startswith(("torque[", "tension[", "force.")) for h in found.hints)


def test_what_the_whole_catalogue_cannot_explain_is_searched_no_further_and_said(tmp_path: Path) -> None:
    _, found = diagnosed("DEV-12")
    left = found.search.together
    assert left is not None
    # No few effects leave less than all of them.
    assert left < min(f.chi2 for f in found.search.fitted)
    assert any(
        f"All {len(found.candidates)} candidates at once leave a misfit of {left:.0f}" in r
        for r in found.verdict.reasons
    )
    # Two effects may leave the model without any as far off: then the search goes on.
    effects, _ = draw_truth("two", 3024)
    draw_session(tmp_path, 3024, effects)
    hard = run_diagnosis(open_bench(tmp_path, catalogue=True))
    assert hard.search.nothing.objective > found.search.nothing.objective
    assert hard.search.together is None


@pytest.mark.parametrize(("kind", "seed"), [("two", 1021), pytest.param("one", 3036, marks=pytest.mark.full)])
def test_what_the_bent_base_hides_is_found_from_where_all_candidates_fit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: Kind, seed: int
) -> None:
    effects, _ = draw_truth(kind, seed)
    draw_session(tmp_path, seed, effects)
    bench = open_bench(tmp_path, catalogue=True)
    found = run_diagnosis(bench)
    assert set(found.verdict.effects) == {name.split(".")[0] for name in effects}
    # From where the model without any effect ends, nothing leads there.
    monkeypatch.setattr(Searcher, "_above", lambda searcher, _: searcher.best[NOTHING_MISSING])
    bent = run_diagnosis(bench)
    assert set(bent.verdict.effects) != set(found.verdict.effects)
    least = min(f.objective for f in bent.search.fitted)
    assert least > 1.3 * min(f.objective for f in found.search.fitted)


def test_a_valley_is_not_given_up_for_one_in_which_less_is_left_at_first(tmp_path: Path) -> None:
    draw_session(tmp_path, 1098, draw_truth("two", 1098)[0])
    found = run_diagnosis(open_bench(tmp_path, catalogue=True))
    pair = {"fdp_fds_coupling", "intrinsic_bowstring"}
    # Begun from the single, the pair gains nothing more; begun from where all candidates fit, it takes longer.
    single = min(f.objective for f in found.search.fitted if f.explanation.names == ("intrinsic_bowstring",))
    assert min(f.objective for f in found.search.fitted if set(f.explanation.names) == pair) < 0.9 * single


def test_no_companion_makes_up_for_a_single_that_was_left_in_another_valley(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    draw_session(tmp_path, 13016, draw_truth("one", 13016)[0])
    bench = open_bench(tmp_path, catalogue=True)
    assert run_diagnosis(bench).verdict.effects == ("sheath_friction",)
    # The pair's members are not begun anew: centres that move are named besides, with certainty.
    monkeypatch.setattr(Searcher, "_anew", lambda *_: None)
    assert len(run_diagnosis(bench).verdict.effects) == 2


def test_the_best_singles_lead_whatever_their_other_forms_come_to(tmp_path: Path) -> None:
    """A coupling that yields fits best of all singles, one that does not worst: pairs were not looked for about it."""
    draw_session(tmp_path, 13116, draw_truth("two", 13116)[0])
    bench = open_bench(tmp_path, catalogue=True)
    problem, candidates = map_problem(bench.model, bench.observations), candidates_of(bench.model)
    searcher = Searcher(problem)
    best = searcher.run(candidates).fitted
    singles = searcher._ranked(1)
    evidences = [f.log_evidence for f in singles]
    assert evidences == sorted(evidences, reverse=True)
    assert len({f.explanation.names for f in singles}) == len(singles)
    assert singles[0].explanation.names == ("fdp_fds_coupling",)
    pairs = [f for f in best if f.explanation.size == 2]
    assert set(max(pairs, key=lambda f: f.log_evidence).explanation.names) == {"fdp_fds_coupling", "cell_rotation"}


def test_companions_of_the_best_singles_are_begun_from_where_all_candidates_fit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    draw_session(tmp_path, 13093, draw_truth("two", 13093)[0])
    bench = open_bench(tmp_path, catalogue=True)
    assert set(run_diagnosis(bench).verdict.effects) == {"fdp_fds_coupling", "sheath_friction"}
    # From the coupling's own optimum friction in the sheath promises nothing.
    monkeypatch.setattr(Searcher, "_beside", lambda *_: None)
    assert "sheath_friction" not in run_diagnosis(bench).verdict.effects


def test_what_will_be_weighed_is_taken_further_where_much_is_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The true pair leaves more than two others do, and most of it is an error of its form."""
    draw_session(tmp_path, 16012, draw_truth("two", 16012)[0])
    bench = open_bench(tmp_path, catalogue=True)
    found = run_diagnosis(bench)
    assert set(found.verdict.effects) == {"bowstringing", "intrinsic_bowstring"}
    assert min(f.objective for f in found.search.fitted) < found.best.fitted.objective - 50.0
    monkeypatch.setattr(Searcher, "_weighable", lambda *_: None)
    assert "intrinsic_bowstring" not in run_diagnosis(bench).verdict.effects


def test_another_form_is_tried_where_the_effect_acts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A clamp that stiffens: at its null nothing tells it from one that does not, and that hides a coupling."""
    effects, _ = draw_truth("two", 14102)
    draw_session(tmp_path, 14102, effects)
    bench = open_bench(tmp_path, catalogue=True)
    truth = {"clamp_compliance", "fdp_fds_coupling"}
    assert set(run_diagnosis(bench).verdict.effects) == truth
    monkeypatch.setattr(Searcher, "_forms", lambda *_: None)
    assert set(run_diagnosis(bench).verdict.effects) != truth


def test_another_form_is_tried_however_far_behind_the_wrong_one_is(tmp_path: Path) -> None:
    """Without yielding the true pair leaves half as much again as what leads then, which fits."""
    draw_session(tmp_path, 15013, draw_truth("two", 15013)[0])
    found = run_diagnosis(open_bench(tmp_path, catalogue=True))
    assert set(found.verdict.effects) == {"fdp_fds_coupling", "suture_angle"}
    named = [found.problem.model.parameters.names[i] for i in found.best.explanation.parameters]
    assert "fdp_fds_coupling.yielding" in named


def test_a_form_that_the_null_hides_is_begun_beside_it(tmp_path: Path) -> None:
    """Where the plain coupling hardly acts no slope tells it from one that yields; joint friction led for certain."""
    draw_session(tmp_path, 17028, draw_truth("two", 17028)[0])
    found = run_diagnosis(open_bench(tmp_path, catalogue=True))
    assert set(found.verdict.effects) == {"fdp_fds_coupling", "centre_migration"}
    # The plain one, to its end, is far from it.
    plain = [f for f in found.search.fitted if f.explanation.names == found.best.explanation.names and f.converged]
    assert max(f.objective for f in plain) > 3.0 * found.best.fitted.objective


def test_every_single_is_taken_to_its_end_where_readings_are_few() -> None:
    # With centres that move round the heads, the fit gains next to nothing for twenty evaluations, and then much.
    _, found = diagnosed("synek2019_H02")
    best = min(f.objective for f in found.search.fitted if f.explanation.names == ("centre_migration",))
    assert best < 0.6 * found.search.nothing.objective
    # That it would explain these readings is said, and not taken for certain.
    assert found.verdict.kind == "undecided"
    # Every form of it has been taken to its end, whichever leads.
    fits = [f for f in found.search.fitted if f.explanation.names == ("centre_migration",)]
    (candidate,) = (c for c in found.candidates if c.name == "centre_migration")
    assert {f.explanation.alternative for f in fits} == {(k,) for k in range(len(candidate.alternatives))}
    assert all(f.converged for f in fits)


@pytest.mark.parametrize(("kind", "seed"), [("one", 3028), (None, "DEV-09"), (None, "synek2019_H02")])
def test_no_evidence_is_beyond_what_an_optimum_allows(tmp_path: Path, kind: Kind | None, seed: Any) -> None:
    """At a kink slopes promise steps that lead nowhere; counted with, they made up to 50 units of evidence."""
    if kind is not None:
        draw_session(tmp_path, seed, draw_truth(kind, seed)[0])
    bench, found = diagnosed(seed if kind is None else str(tmp_path))
    one_sided = bench.model.parameters.one_sided
    for fitted in found.search.fitted:
        h = fitted.jacobian[:, fitted.moving]
        _, log_det = np.linalg.slogdet(np.eye(h.shape[1]) + h.T @ h)
        sides = one_sided[list(fitted.explanation.parameters)].sum()
        allowed = -0.5 * (fitted.objective + log_det) + sides * np.log(2.0)
        assert fitted.log_evidence < allowed + 0.1


@pytest.mark.full
def test_a_thorough_search_goes_on_whatever_hope_there_is() -> None:
    bench, found = diagnosed("DEV-12")
    assert found.search.together is not None
    thorough = run_diagnosis(bench, thorough=True)
    assert thorough.search.together is None
    assert thorough.verdict.kind == "none_of_catalogue"


def test_adding_the_true_effect_is_what_the_diagnosis_promised() -> None:
    bench, found = diagnosed("DEV-02")
    added = add_effects(bench.model, bench.observations, ["hanger_mass"], starts=1)
    assert added.names == ("hanger_mass",)
    assert added.fit.objective == pytest.approx(found.best.fitted.objective, abs=1.0)
    assert added.log_evidence_gain > 100.0


def test_an_effect_is_added_where_the_base_fits_from_some_starts_only(tmp_path: Path) -> None:
    # From the priors' centre alone this base ends in a posture that transmits no force.
    draw_session(tmp_path, 1015, draw_truth("one", 1015)[0], protocol="three_levels")
    bench = open_bench(tmp_path, catalogue=True)
    added = add_effects(bench.model, bench.observations, ["axis_tilt"], starts=1)
    assert added.names == ("axis_tilt",)
    assert 50.0 < added.log_evidence_gain < 1000.0


@pytest.mark.parametrize("names", [[], ["hanger_mass"]])
def test_readings_that_no_fit_makes_are_refused_in_words(monkeypatch: pytest.MonkeyPatch, names: list[str]) -> None:
    bench, found = diagnosed("DEV-02")

    def lost(problem: Problem, start: Any, *_: Any, **__: Any) -> Solution:
        solution = found.search.nothing.solution
        return solution._replace(jacobian=np.full_like(solution.jacobian, 1e9))

    monkeypatch.setattr("fingermodel.diagnosis.fitter.solve", lost)
    with pytest.raises(SessionError, match="every fit ends in a posture that transmits no force"):
        add_effects(bench.model, bench.observations, names)


@pytest.mark.parametrize("seed", [1, pytest.param(3, marks=pytest.mark.full)])
def test_sessions_of_other_physics_are_read_rightly(tmp_path: Path, seed: int) -> None:
    kinds: tuple[Kind, ...] = ("none", "one", "outside")
    for kind in kinds:
        effects, outside = draw_truth(kind, seed)
        folder = tmp_path / kind
        folder.mkdir()
        draw_session(folder, seed, effects, outside, nuisance_scale=1.0)
        bench = open_bench(folder, catalogue=True)
        verdict = run_diagnosis(bench).verdict
        true = {name.split(".")[0] for name in effects}
        # Whatever it says, it names nothing false.
        assert set(verdict.effects) <= true, (kind, seed, effects, outside, verdict)


@pytest.mark.full
def test_what_only_both_mounts_tell_apart_is_named(tmp_path: Path) -> None:
    effects, _ = draw_truth("two", 1048)
    draw_session(tmp_path, 1048, effects)
    found = run_diagnosis(open_bench(tmp_path, catalogue=True))
    assert found.verdict.kind == "found"
    assert set(found.verdict.effects) == {"rig_friction", "cell_crosstalk"}
    assert "the bone readings" in found.robustness.rests_on


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> tuple[Bench, Diagnosis, Path]:
    folder = tmp_path_factory.mktemp("hanger")
    draw_session(folder, 11, {"hanger_mass": 30.0}, nuisance_scale=0.7)
    bench = open_bench(folder, catalogue=True)
    return bench, run_diagnosis(bench), folder


def test_the_next_case_tests_the_finding(planned: tuple[Bench, Diagnosis, Path]) -> None:
    _, found, _ = planned
    plan = plan_next(found)
    assert found.verdict.effects == ("hanger_mass",)
    assert plan.cases
    assert plan.cases[0].information_nat >= plan.cases[-1].information_nat > 0.0
    assert any("weigh the hangers" in text for text in plan.instruments)


def test_what_a_test_without_a_model_contradicts_is_not_named(tmp_path: Path) -> None:
    # A clamp that resists twist looks like another tip location in forces and Mz, but not in Mx and My.
    draw_session(tmp_path, 1006, outside="clamp_moments")
    found = run_diagnosis(open_bench(tmp_path, catalogue=True))
    assert (found.verdict.kind, found.verdict.effects) == ("none_of_catalogue", ())
    assert any("moments that no likely effect here makes" in reason for reason in found.verdict.reasons)
    # What does act at the cell makes such moments, and is not doubted for them.
    folder = tmp_path / "turned"
    folder.mkdir()
    draw_session(folder, 1006, {"cell_rotation": (6.0, -5.0, 4.0)}, nuisance_scale=0.7)
    turned = run_diagnosis(open_bench(folder, catalogue=True))
    assert (turned.verdict.kind, turned.verdict.effects) == ("found", ("cell_rotation",))
    assert any(n.name == "moments_closure" and n.verdict == "violated" for n in turned.nulls)


def test_a_frozen_prediction_confirms_or_refutes(planned: tuple[Bench, Diagnosis, Path], tmp_path: Path) -> None:
    bench, found, _ = planned
    measured = [PlannedReading(p, "tip", {"FDS": 950.0}) for p in ("hook", "minor_flexion", "major_flexion")]
    document = freeze(plan_next(found, measured), "earlier", "specimen", "model", None, ())
    path = tmp_path / "frozen.json"
    write_frozen(document, path)
    with pytest.raises(ModelError, match="never overwritten"):
        write_frozen(document, path)
    # The rig that has the hanger bears the finding out, the same rig without it does not.
    told = score(read_frozen(path), name_of(found.best), "later", bench.observations)
    assert len(told.cases) == len(document["cases"])
    assert told.confirmed is not False
    clean = tmp_path / "clean"
    clean.mkdir()
    draw_session(clean, 11, None, nuisance_scale=0.7)
    other = score(read_frozen(path), name_of(found.best), "later", open_bench(clean, catalogue=True).observations)
    assert other.confirmed is not True
    path.write_text(path.read_text(encoding="utf-8").replace('"tip"', '"bone"'), encoding="utf-8")
    with pytest.raises(ModelError, match="changed after"):
        read_frozen(path)


def test_a_fault_of_the_rig_shows_in_all_its_specimens(tmp_path: Path) -> None:
    sessions = []
    for seed in (21, 22):
        folder = tmp_path / str(seed)
        folder.mkdir()
        draw_session(folder, seed, {"zero_offset.bone": (0.3, 0.2, -0.2)}, nuisance_scale=0.8)
        bench = open_bench(folder, catalogue=True)
        sessions.append((bench.measured.session.id, bench.model, bench.observations))
    pooled = diagnose_pooled(sessions)
    assert (pooled.verdict.kind, pooled.verdict.names) == ("found", ("zero_offset.bone",))
    best = pooled.ranking[0]
    assert best.shared
    assert best.value == pytest.approx([0.3, 0.2, -0.2], abs=0.08)


def test_a_fault_of_the_rig_shows_beside_what_is_a_specimens_own(tmp_path: Path) -> None:
    # By itself it explains the second session no better than chance: there the flexors bowstring besides.
    sessions = []
    for seed, own in ((21, {}), (22, {"bowstringing": 0.4})):
        folder = tmp_path / str(seed)
        folder.mkdir()
        draw_session(folder, seed, {"hanger_mass": 25.0, **own}, nuisance_scale=0.8)
        bench = open_bench(folder, catalogue=True)
        sessions.append((bench.measured.session.id, bench.model, bench.observations))
    pooled = diagnose_pooled(sessions)
    assert (pooled.verdict.kind, pooled.verdict.names) == ("found", ("hanger_mass",)), pooled.verdict
    best = pooled.ranking[0]
    assert best.shared
    # Its mass; then by how much each hanger differs, which the simulator's do by up to a tenth.
    assert best.value[0] == pytest.approx(25.0, abs=3.0)
    assert best.value[1:] == pytest.approx(np.zeros(6), abs=0.2)
    assert [each.beside.own for each in best.each] == [(), ("bowstringing",)]
    assert "bowstringing in SIM-00022" in pooled.verdict.sentence


@pytest.mark.full
def test_what_one_specimen_has_is_not_called_shared(tmp_path: Path) -> None:
    sessions = []
    for seed, own in ((21, {}), (22, {"bowstringing": 0.4}), (23, {})):
        folder = tmp_path / str(seed)
        folder.mkdir()
        draw_session(folder, seed, own, nuisance_scale=0.8)
        bench = open_bench(folder, catalogue=True)
        sessions.append((bench.measured.session.id, bench.model, bench.observations))
    pooled = diagnose_pooled(sessions)
    assert (pooled.verdict.kind, pooled.verdict.names) == ("undecided", ())
    assert "in SIM-00022 bowstringing acts" in pooled.verdict.sentence
    assert pooled.p_apart > 0.9


@pytest.mark.full
def test_what_no_effect_describes_lends_itself_to_none_that_is_shared(tmp_path: Path) -> None:
    sessions = []
    for seed in (21, 22):
        folder = tmp_path / str(seed)
        folder.mkdir()
        draw_session(folder, seed, None, "tissue_relaxation", nuisance_scale=0.8)
        bench = open_bench(folder, catalogue=True)
        sessions.append((bench.measured.session.id, bench.model, bench.observations))
    assert not diagnose_pooled(sessions).verdict.names


@pytest.mark.full
def test_a_few_cases_decide_nothing(tmp_path: Path) -> None:
    session = read_session("synek2019_H01")
    few = [c for c in session.cases if c.role == "identification"][:4]
    write_session(session.model_copy(update={"cases": tuple(few)}), tmp_path)
    found = run_diagnosis(open_bench(tmp_path, catalogue=True))
    assert found.verdict.kind == "undecided"
    assert not found.verdict.effects
    assert any("too few" in s for s in found.verdict.short) or found.verdict.short
