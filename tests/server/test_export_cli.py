"""`export` and `simulate`: files that hold what was said, and sessions of which the truth is known."""

from __future__ import annotations

import csv
import gzip
import json
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
import yaml

from daq.locations import data_dir
from tests.server.command_line import H01, RAW, Document, Edit, altered, keys, refused, run

# export


def table(file: Path) -> list[dict[str, Any]]:
    if file.suffix == ".parquet":
        rows: list[dict[str, Any]] = pq.read_table(file).to_pylist()
        return rows
    with file.open(newline="", encoding="utf-8") as text:
        return [{k: v or None for k, v in row.items()} for row in csv.DictReader(text)]


@pytest.mark.parametrize("ending", ["csv", "parquet"])
@pytest.mark.parametrize("session", [H01, RAW])
def test_an_exported_session_holds_what_compare_says(tmp_path: Path, ending: str, session: str) -> None:
    file = tmp_path / f"table.{ending}"
    body = run("export", session, "--format", ending, "--out", file, "--json", "-").body("export")
    cases = run("compare", session, "--json", "-").body("compare")["cases"]
    rows = table(file)
    assert (body["rows"], body["file"], len(rows)) == (len(cases), str(file), len(cases))
    for row, case in zip(rows, cases, strict=True):
        assert [row[k] for k in ("id", "role", "posture", "location")] == [
            case[k] for k in ("id", "role", "posture", "location")
        ]
        names = {"measured_N": "F{}_N", "predicted_N": "predicted_F{}_N", "residual_N": "residual_F{}_N"}
        for key, name in names.items():
            assert [float(row[name.format(a)]) for a in "xyz"] == pytest.approx(case[key], rel=1e-12)
        moments = [row[f"T{a}_Nmm"] for a in "xyz"]
        assert (None if moments[0] is None else [float(m) for m in moments]) == case["measured_Nmm"]
        assert float(row["z"]) == pytest.approx(case["z"], rel=1e-12)
        assert {m: float(row[f"{m}_g"]) for m in case["masses_g"]} == case["masses_g"]
    assert len(rows[0]) == len(set(rows[0]))


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_an_exported_model_holds_its_parameters(tmp_path: Path, ending: str, revision: tuple[Path, Document]) -> None:
    file = tmp_path / f"table.{ending}"
    assert run("export", revision[0], "--format", ending, "--out", file).code == 0
    rows = table(file)
    assert [row["name"] for row in rows] == [p["name"] for p in revision[1]["parameters"]]
    assert [float(row["value"]) for row in rows] == [p["value"] for p in revision[1]["parameters"]]


def test_an_export_stays_in_the_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    session = altered(tmp_path, keys(id="../../elsewhere/H01"))
    here = tmp_path / "a" / "b"
    here.mkdir(parents=True)
    monkeypatch.chdir(here)
    assert run("export", session).code == 0
    assert sorted(p.name for p in here.iterdir()) == ["H01.csv", "H01.csv.json"]
    assert not (tmp_path / "elsewhere").exists()


# simulate


def test_a_simulated_session_is_usable_and_its_truth_is_found(simulated: Path) -> None:
    assert run("check", simulated).code == 0
    body = run("compare", simulated, "--json", "-").body("compare")
    truth = json.loads((simulated / "truth.json").read_text(encoding="utf-8"))["wrench_N_Nmm"]
    for case in body["cases"]:
        assert case["measured_N"] == pytest.approx(truth[case["id"]][:3], abs=0.05)
        assert case["predicted_N"] == pytest.approx(truth[case["id"]][:3], abs=1e-5)


def test_a_seed_repeats_a_simulation(simulated: Path, tmp_path: Path) -> None:
    def files(seed: int) -> list[bytes]:
        folder = tmp_path / str(seed) / "rig"
        assert run("simulate", "synek2019", "--out", folder, "--rate-hz", 20, "--seed", seed).code == 0
        return [(folder / "session.yaml").read_bytes(), gzip.decompress((folder / "readings.csv.gz").read_bytes())]

    same, other = files(3), files(4)
    assert same[0] == other[0] == (simulated / "session.yaml").read_bytes()
    assert same[1] == gzip.decompress((simulated / "readings.csv.gz").read_bytes())
    assert other[1] != same[1]


def test_a_simulation_embodies_the_effects_of_a_revision(tmp_path: Path) -> None:
    """What the session shows under the revision is its truth, and under the plain finger it is not."""
    model, rig = tmp_path / "m.json", tmp_path / "rig"
    assert run("add", "hanger_mass", "DEV-02", "--out", model).code == 0
    document, moved = json.loads(model.read_text(encoding="utf-8")), "cell_rotation.tip#1.x"
    document["effects"].append({"name": "cell_rotation", "parameters": [moved], "document": None})
    document["parameters"].append(document["parameters"][-1] | {"name": moved, "value": 3.0})
    model.write_text(json.dumps(document), encoding="utf-8")
    body = run("simulate", "synek2019", "--model", model, "--out", rig, "--rate-hz", 20, "--json", "-").body("simulate")
    truth = json.loads((rig / "truth.json").read_text(encoding="utf-8"))
    [mass] = truth["parameters"]
    assert body["parameters"] == truth["parameters"]
    assert (mass["name"], mass["unit"], truth["left_out"]) == ("hanger_mass.m0", "g", [moved])
    assert mass["value"] == pytest.approx(29.2, abs=1.0)
    wrenches = truth["wrench_N_Nmm"]
    for case in run("compare", rig, "--model", model, "--json", "-").body("compare")["cases"]:
        assert case["predicted_N"] == pytest.approx(wrenches[case["id"]][:3], abs=1e-5)
        assert case["measured_N"] == pytest.approx(wrenches[case["id"]][:3], abs=0.05)


def test_a_simulation_lets_an_effect_act(simulated: Path, tmp_path: Path) -> None:
    """A worn pulley that keeps 10 % of FDP's pull back: a tenth of the force is missing where FDP pulls alone."""
    said = run("simulate", "synek2019", "--effect", "worn_pulley.FDP=10", "--out", tmp_path / "rig", "--rate-hz", 20)
    assert "Effects that act: worn_pulley.FDP 10 %." in said.out
    before, after = (json.loads((f / "truth.json").read_text())["wrench_N_Nmm"] for f in (simulated, tmp_path / "rig"))
    changed = [name for name in before if before[name] != after[name]]
    assert changed
    assert len(changed) < len(before)
    loaded = {c["id"]: c["masses_g"] for c in yaml.safe_load((simulated / "session.yaml").read_text())["cases"]}
    assert all("FDP" in loaded[name] for name in changed)
    alone = [name for name in changed if set(loaded[name]) == {"FDP"}]
    for name in alone:
        assert after[name] == pytest.approx([0.9 * x for x in before[name]], abs=2e-6)


def test_a_simulation_never_overwrites(simulated: Path) -> None:
    refused("simulate", "synek2019", "--out", simulated, saying=str(simulated))


def test_a_simulation_keeps_what_lies_in_a_folder(tmp_path: Path) -> None:
    (tmp_path / "readings.csv.gz").write_text("precious", encoding="utf-8")
    refused("simulate", "synek2019", "--out", tmp_path)
    assert (tmp_path / "readings.csv.gz").read_text(encoding="utf-8") == "precious"


@pytest.mark.parametrize(
    "option",
    [
        ("--rate-hz", "0"), ("--rate-hz", "nan"), ("--rate-hz", "inf"), ("--rate-hz", "0.01"), ("--noise-N", "-1"),
        ("--noise-N", "inf"), ("--noise-N", "nan"), ("--repeats", "0"), ("--seed", "-1"), ("--model", "nosuch"),
        ("--model", "nosuch.json"), ("--effect", "hanger_mass=30"), ("--effect", "hanger_mass.m0"),
        ("--effect", "hanger_mass.m0=heavy"), ("--effect", "hanger_mass.m0=-1"),
        ("--effect", "hanger_mass.m0=30", "--effect", "hanger_mass.m0=50"),
    ],
)  # fmt: skip
def test_a_simulation_that_makes_no_sense_writes_nothing(tmp_path: Path, option: tuple[str, ...]) -> None:
    refused("simulate", "synek2019", "--out", tmp_path / "s", *option, instead="")
    assert not (tmp_path / "s").exists()


@pytest.mark.parametrize(
    "edit",
    [
        keys(format="protocol/9"),
        keys(blocks=[]),
        lambda d: d["blocks"][0].update(postures=["fist"]),
        lambda d: d["blocks"][0].update(masses_g=[{"FPL": 100}]),
        lambda d: d["blocks"][0].update(masses_g=[{"FDP": -100}]),
        lambda d: d["timing"].update(load_s=0.1),
        lambda d: d["postures_deg"]["hook"].update(PIP=0, DIP=0),
        lambda d: d["postures_deg"]["hook"].update(wrist=10),
    ],
)
def test_a_protocol_that_cannot_be_run_writes_nothing(tmp_path: Path, edit: Edit) -> None:
    document = yaml.safe_load((data_dir() / "protocols" / "synek2019.yaml").read_text(encoding="utf-8"))
    edit(document)
    file = tmp_path / "protocol.yaml"
    file.write_text(yaml.safe_dump(document), encoding="utf-8")
    refused("simulate", file, "--out", tmp_path / "s", "--rate-hz", 20)
    assert not (tmp_path / "s").exists()
