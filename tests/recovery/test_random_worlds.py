"""Random worlds: they repeat themselves, the project reads them, their truth is so, and their scores are fair."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from benchmarks import random_worlds_scores as scores
from benchmarks.random_worlds import base_seed
from benchmarks.random_worlds_report import comparison, report
from daq.checks import check
from daq.sessions import read_session
from daq.signals.corrections import measure
from tests.random_worlds import Settings, draw_world, write_drawn, write_truth, write_world
from tests.random_worlds.engines import NAMES, loads
from tests.random_worlds.laws import LARGEST, Law, Stage, draw_law, same_as
from tests.random_worlds.visibility import Noise, Visibility
from tests.simulator.finger import MUSCLES

PLAIN = Settings(kind="nothing", budget=0.0, scatter=0.0, slips=0, quiet=True)
FULL = {**dict.fromkeys(MUSCLES, 5.0), "all": 12.0}
# What follows a seed's first number for a small protocol, so that the tests are quick.
SMALL = 4


@pytest.mark.parametrize("engine", ["first", "second"])
def test_the_seed_settles_everything(tmp_path: Path, engine: str) -> None:
    fixed = Settings(engine=engine, kind="one", slips=2)
    one, two = (write_world(tmp_path / name, [1, SMALL], fixed) for name in ("a", "b"))
    assert one == two
    for file in (tmp_path / "a").iterdir():
        assert file.read_bytes() == (tmp_path / "b" / file.name).read_bytes()
    assert draw_world([2, SMALL], PLAIN).truth["finger_scale"] != one["finger_scale"]
    write_truth(tmp_path / "truth.json", one)
    assert json.loads((tmp_path / "truth.json").read_text(encoding="utf-8")) == one


@pytest.mark.parametrize("engine", ["first", "second"])
def test_where_nothing_is_hidden_the_plain_finger_is_read(tmp_path: Path, engine: str) -> None:
    world = draw_world([1, SMALL], replace(PLAIN, engine=engine))
    truth = write_drawn(tmp_path, world)
    assert (truth["effects"], truth["outside"], truth["slips"], truth["change_N"]) == ([], False, [], 0.0)
    plain = Visibility(world.plan, world.scale, world.noise, 0.0).plain
    np.testing.assert_allclose(loads(world.engine, []), plain, atol=1e-9)
    measured = measure(read_session(tmp_path))
    np.testing.assert_allclose([c.wrench for c in measured.cases], plain, atol=1e-6)


@pytest.mark.parametrize(("kind", "engine"), [("nothing", "first"), ("two", "second"), ("outside", "first")])
def test_what_it_writes_passes_every_check_and_measures_back(tmp_path: Path, kind: str, engine: str) -> None:
    world = draw_world([1, SMALL], Settings(kind=kind, engine=engine, slips=0))
    truth = write_drawn(tmp_path, world)
    assert check(tmp_path).ok
    measured = measure(read_session(tmp_path))
    assert [m.case.id for m in measured.cases] == [c.id for c in world.plan.cases]
    error = np.array([m.wrench for m in measured.cases]) - loads(world.engine, world.parts, world.passes)
    assert np.median(np.abs(error[:, :3])) < 0.03
    assert (truth["outside"], len(truth["effects"])) == (kind == "outside", 2 if kind == "two" else 0)
    assert all(p["sds"] >= p["sds_beside"] > 0.0 for p in truth["parts"])
    assert (truth["sds_unlike_catalogue"] is not None) == (kind == "outside")


def test_a_slip_changes_what_the_file_says_and_nothing_else(tmp_path: Path) -> None:
    kinds = set()
    for k in range(2):
        clean, wrong = (tmp_path / f"{k}{name}" for name in ("clean", "wrong"))
        fixed = Settings(kind="nothing", slips=0)
        write_world(clean, [k, SMALL], fixed)
        truth = write_world(wrong, [k, SMALL], replace(fixed, slips=3))
        assert (clean / "readings.parquet").read_bytes() == (wrong / "readings.parquet").read_bytes()
        texts = [(folder / "session.yaml").read_text(encoding="utf-8") for folder in (wrong, clean)]
        said, done = (yaml.load(t, getattr(yaml, "CSafeLoader", yaml.SafeLoader)) for t in texts)  # noqa: S506 - safe
        differ = {a["id"] for a, b in zip(said.pop("cases"), done.pop("cases"), strict=True) if a != b}
        assert said == done
        assert differ == {c for s in truth["slips"] for c in s["cases"]}
        assert len(truth["slips"]) == 3
        assert all(s["change_N"] > 0.0 for s in truth["slips"])
        kinds |= {s["kind"] for s in truth["slips"]}
    assert len(kinds) > 2


def test_what_shows_grows_with_the_change_and_falls_with_the_budget() -> None:
    world = draw_world([1, SMALL], replace(PLAIN, engine="first"))
    rng = np.random.default_rng(0)
    change = loads(world.engine, [world.engine.drawn("joint_friction", rng)]) - loads(world.engine, [])
    noise = Noise(0.03, 0.0, None, 0.0)
    exact, careful, careless = (Visibility(world.plan, world.scale, noise, b) for b in (0.0, 1.0, 4.0))
    assert exact.sds(change) > careful.sds(change) > careless.sds(change) > 0.0
    assert careful.sds(2.0 * change) == pytest.approx(2.0 * careful.sds(change))
    assert careful.sds(change, beside=[change]) == pytest.approx(0.0, abs=1e-6)
    scattered = Visibility(world.plan, world.scale, replace(noise, scatter=0.03), 1.0)
    assert scattered.sds(change) < careful.sds(change)


def test_laws_are_none_of_the_catalogue() -> None:
    rng = np.random.default_rng(3)
    laws = [draw_law(rng, FULL) for _ in range(300)]
    assert {law.stage for law in laws} == set(LARGEST)
    assert all(same_as(law) is None for law in laws)
    at_pip = {"joint": "PIP", "angle_of": "PIP", "angle": "sine"}
    known: list[tuple[str, Stage, dict[str, Any]]] = [
        ("worn_pulley", "tension", {"muscles": ("FDP",)}),
        ("rig_friction", "tension", {"muscles": MUSCLES}),
        ("fdp_fds_coupling", "passing", {"muscles": ("FDP", "FDS"), "load": "saturating"}),
        ("joint_friction", "share", {"joint": "PIP"}),
        ("bowstringing", "arm", {"muscles": ("FDS",), **at_pip, "load": "power"}),
        ("centre_migration", "arm", {"muscles": MUSCLES, **at_pip}),
        ("cell_crosstalk", "force", {"mount": "tip"}),
        ("budget", "arm", {"muscles": ("EDC",), "joint": "MCP"}),
    ]
    for name, stage, rest in known:
        assert same_as(Law(stage, full_N=FULL, **rest)) == name


def test_both_rigs_obey_a_law_alike() -> None:
    rng = np.random.default_rng(5)
    first, second = (draw_world([1, SMALL], replace(PLAIN, engine=e)).engine for e in ("first", "second"))
    wanted = {*LARGEST}
    while wanted:
        law = draw_law(rng, FULL)
        if law.stage in wanted:
            wanted -= {law.stage}
            # The two have different tension factors, and are told of equal loads.
            ratio = first.plan.tension_factor / second.plan.tension_factor
            told = replace(law, full_N={k: v * ratio for k, v in FULL.items()})
            one, two = (e.read([p]) - e.read([]) for e, p in ((first, told), (second, law)))
            # A torque of its own does not grow with the tensions, all else does.
            np.testing.assert_allclose(one, two * (1.0 if law.stage == "passive" else ratio), atol=1e-9)
            assert np.abs(one).max() > 0.0


def row(effects: list[str], ranking: list[tuple[list[str], float]], inclusion: dict[str, float]) -> dict[str, Any]:
    """An outcome in which `effects` act, each by ten standard uncertainties."""
    parts = [{"name": n, "sds": 10.0, "sds_beside": 10.0} for n in effects]
    truth = {"effects": effects, "outside": False, "parts": parts, "sds": 10.0 * len(effects), "slips": []}
    answer = {
        "verdict": "found",
        "effects": effects,
        "probability": 1.0,
        "inclusion": inclusion,
        "ranking": [{"effects": names, "probability": p} for names, p in ranking],
    }
    return {"seed": [1, len(effects)], "truth": truth, "answer": answer, "refused": None, "commit": "none"}


def test_a_perfect_forecast_scores_nothing_and_a_refusal_the_most() -> None:
    perfect = [
        row([], [([], 1.0)], {}),
        row(["hanger_mass"], [(["hanger_mass"], 1.0)], {"hanger_mass": 1.0}),
        row(["worn_pulley"], [(["worn_pulley"], 1.0)], {"worn_pulley.FDP": 1.0}),
    ]
    for given in perfect:
        assert scores.stratum_of(given) == "shows"
        assert all(score(given) == 0.0 for score in scores.SCORES.values())
        refused = {**given, "answer": None, "refused": "SessionError"}
        assert scores.category_log(refused) == scores.effects_log(refused) == scores.exact_log(refused) == scores.WORST
        assert scores.category_brier(refused) == 2.0
    wrong = row([], [(["none_of_catalogue"], 1.0)], {})
    assert scores.category_log(wrong) == pytest.approx(-np.log(scores.LEAST))
    half = row(["hanger_mass"], [(["hanger_mass"], 0.5), ([], 0.5)], {"hanger_mass": 0.5})
    assert scores.category_log(half) == scores.exact_log(half) == pytest.approx(np.log(2.0))
    assert scores.effects_log(half) == pytest.approx(np.log(2.0) / len(NAMES))
    assert scores.category_brier(half) == pytest.approx(0.5)


def test_what_cannot_be_seen_is_counted_by_itself() -> None:
    given = row(["hanger_mass"], [([], 1.0)], {})
    given["truth"]["sds"] = given["truth"]["parts"][0]["sds_beside"] = 1.0
    assert scores.stratum_of(given) == "unseen"
    assert scores.effects_log(given) == 0.0
    law = row([], [(["worn_pulley"], 1.0)], {"worn_pulley": 1.0})
    law["truth"] |= {"outside": True, "sds": 20.0, "sds_unlike_catalogue": 2.0, "most_like": "worn_pulley"}
    assert scores.stratum_of(law) == "like_catalogue"
    assert scores.effects_log(law) == 0.0
    law["truth"]["sds_unlike_catalogue"] = 12.0
    assert scores.stratum_of(law) == "shows"
    assert scores.effects_log(law) == pytest.approx(scores.WORST / len(NAMES))


def test_a_comparison_is_of_the_same_sessions() -> None:
    new = [row([], [([], 0.9), (["hanger_mass"], 0.1)], {"hanger_mass": 0.1})]
    old = [row([], [([], 0.5), (["hanger_mass"], 0.5)], {"hanger_mass": 0.5})]
    count, mean, low, high = scores.paired(new, [*old, {**old[0], "seed": [9, 9]}])[
        "nothing, catalogue or outside: log"
    ]
    assert count == 1
    assert mean == low == high == pytest.approx(np.log(0.5 / 0.9))


def test_suspects_and_older_answers_are_read_alike() -> None:
    answer = {"verdict": "found", "effects": [], "probability": 1.0, "inclusion": {}, "ranking": [], "seconds": 1.0}
    assert "suspects" not in scores.kept_of(answer)
    given = row([], [([], 1.0)], {})
    assert scores.suspects_of(given, 0.5) == []
    given["answer"]["suspects"] = [{"case": "w002", "probability": 0.95}, {"case": "w007", "probability": 0.6}]
    slip = {"cases": ["w002"], "fitted": True, "sds": 9.0}
    given["truth"]["slips"] = [slip, {**slip, "cases": ["w009"], "sds": 1.0}]
    assert scores.suspects_of(given, 0.9) == ["w002"]
    assert scores.slip_cases(given) == {"w002", "w009"}
    assert scores.slip_cases(given, shown=True) == {"w002"}


def test_the_page_holds_all_figures_whatever_was_answered() -> None:
    made = draw_world([1, SMALL], Settings(kind="nothing", slips=1)).truth
    said = row([], [([], 1.0)], {})
    fuller = {
        **said["answer"],
        "suspects": [{"case": made["slips"][0]["cases"][0], "probability": 0.97}],
        "repeatability": {"value_pct": made["scatter_pct"], "sd_pct": 0.1},
        "budget_multiple": {"value": made["budget_multiple"], "sd": 0.1},
    }
    rows = [
        {**said, "truth": made, "wall_s": 1.0, "seed": [1, k], "answer": answer, "refused": refused}
        for k, (answer, refused) in enumerate([(said["answer"], None), (fuller, None), (None, "SessionError")])
    ]
    page = "\n".join(report(rows, "this test"))
    assert "| refused or crashed | 33.3 %" in page
    assert "| nothing, catalogue or outside: log | 2.303 |" in page
    assert "Within two stated standard deviations: 1/1." in page
    assert "| the whole truth: log | +0.0000 |" in "\n".join(comparison(rows, rows))


def test_seeds_come_from_a_commit() -> None:
    assert base_seed("8e4e6e8") == base_seed("8e4e6e8ffff") == 0x8E4E6E8
