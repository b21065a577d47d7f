"""The shipped sessions of the published study against the files that they were made from."""

from __future__ import annotations

import csv
import importlib.util
from types import ModuleType

import numpy as np
import pytest
import yaml

from daq.locations import data_dir
from daq.sessions import read_session

SPECIMENS = ["H01", "H02", "H03", "B01", "HMEAN"]


def converter() -> ModuleType:
    spec = importlib.util.spec_from_file_location("convert_synek2019", data_dir() / "convert_synek2019.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("specimen", SPECIMENS)
def test_sessions_are_what_the_script_makes_of_the_published_files(specimen: str) -> None:
    convert = converter()
    cases = (
        convert.mean_of([convert.cases_of(m) for m in convert.HUMANS])
        if specimen == "HMEAN"
        else convert.cases_of(specimen)
    )
    assert read_session(f"synek2019_{specimen}").in_folder(None) == convert.session_of(specimen, cases)


@pytest.mark.parametrize("specimen", SPECIMENS)
def test_forty_cases_in_the_published_order(specimen: str) -> None:
    session = read_session(f"synek2019_{specimen}")
    assert [c.role for c in session.cases] == ["identification"] * 24 + ["validation"] * 16
    assert [c.location for c in session.cases] == ["tip"] * 32 + ["bone"] * 8
    assert session.postures_deg["minor_flexion"].PIP == 55.0
    assert session.tension_factor == 0.835
    budget = session.budget
    assert (budget["base"] if isinstance(budget, dict) else budget) == "synek2019"
    assert session.finger == ("synek2019_bonobo" if specimen == "B01" else "synek2019_initial")
    assert isinstance(session.provenance, dict)
    assert session.provenance["doi"] == "10.7717/peerj.7470"
    assert session.provenance["licence"] == "CC BY 4.0"
    ri = next(c for c in session.cases if "RI" in c.masses_g)
    assert ri.masses_g == {"RI": 550.0 if specimen == "B01" else 650.0}


def test_the_bonobos_major_flexion_differs() -> None:
    bonobo = read_session("synek2019_B01").postures_deg["major_flexion"]
    human = read_session("synek2019_H01").postures_deg["major_flexion"]
    assert (bonobo.MCP, bonobo.PIP, bonobo.DIP) == (60.0, 50.0, 40.0)
    assert (human.MCP, human.PIP, human.DIP) == (55.0, 57.0, 25.0)


def test_the_mean_is_that_of_its_members() -> None:
    mean = read_session("synek2019_HMEAN")
    assert isinstance(mean.provenance, dict)
    members = [read_session(name) for name in mean.provenance["mean_of"]]
    assert [m.id for m in members] == ["synek2019_H01", "synek2019_H02", "synek2019_H03"]
    for i, case in enumerate(mean.cases):
        forces = np.array([m.cases[i].force_N for m in members])
        np.testing.assert_allclose(np.array(case.force_N), forces.mean(axis=0))


def test_a_published_number_reaches_its_case() -> None:
    with (data_dir() / "reference" / "synek2019" / "Mc_forces__B01_mcforce_combined.csv").open() as file:
        row = list(csv.DictReader(file))[-1]
    case = read_session("synek2019_B01").cases[-1]
    assert case.id == "hook-FDP-650-FDS-800-bone"
    assert case.force_N == (float(row["Fmc_PD"]), float(row["Fmc_DV"]), float(row["Fmc_RU"]))


def test_no_session_carries_its_answer() -> None:
    for folder in (data_dir() / "sessions").iterdir():
        assert {p.name for p in folder.iterdir()} <= {"session.yaml", "readings.csv.gz"}
        text = yaml.safe_load((folder / "session.yaml").read_text(encoding="utf-8"))
        assert "effects" not in text
