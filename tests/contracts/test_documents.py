"""Files that a user writes say each thing once, and mean what a user reads in them."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from daq.documents import read_document
from daq.errors import InputError
from daq.locations import data_dir
from daq.sessions import Session, read_session, read_yaml
from daq.sessions.protocols import read_protocol
from fingermodel.diagnosis.next_cases.frozen import read_frozen
from fingermodel.exchange.reading import about_of
from fingermodel.model_files import read_revision
from server.application.additions import formula_of
from server.service.web.strict_requests import read_json
from tests.daq.benches import averaged, save

TWICE = '{"format": "a", "inner": {"mass": 1, "mass": 2}}'


def finger_notes(file: Path) -> object:
    return about_of(file.read_text(encoding="utf-8"), "its notes")


def document(file: Path) -> object:
    return read_document(file, "a finger/1 file")


@pytest.mark.parametrize("read", [read_yaml, document, read_revision, read_frozen, finger_notes])
def test_a_key_given_twice_is_refused(read: Callable[[Path], Any], tmp_path: Path) -> None:
    file = tmp_path / "twice.json"
    file.write_text(TWICE, encoding="utf-8")
    with pytest.raises(InputError):
        read(file)
    assert read_document(_once(file), "a file") == json.loads(TWICE.replace('"mass": 1, ', ""))


def test_a_model_with_a_key_given_twice_is_refused_in_the_words_of_a_yaml_file(tmp_path: Path) -> None:
    file = tmp_path / "twice.json"
    file.write_text(TWICE, encoding="utf-8")
    with pytest.raises(InputError) as model:
        read_revision(file)
    with pytest.raises(InputError) as yaml:
        read_document(file, "a file")
    assert str(model.value) == str(yaml.value).replace(" in line 1, column 38", "")
    assert str(model.value).startswith("twice.json: key 'mass' is there twice; expected each key once.")


def test_a_frozen_file_with_a_key_given_twice_names_no_place_that_is_not_known(tmp_path: Path) -> None:
    file = tmp_path / "twice.json"
    file.write_text(TWICE, encoding="utf-8")
    with pytest.raises(InputError) as refused:
        read_frozen(file)
    assert "(key 'mass' is there twice)" in str(refused.value)


def test_a_body_with_a_key_given_twice_is_refused() -> None:
    with pytest.raises(json.JSONDecodeError, match="'mass' is there twice"):
        read_json(TWICE.encode())


def _once(file: Path) -> Path:
    file.write_text(TWICE.replace('"mass": 1, ', ""), encoding="utf-8")
    return file


@pytest.mark.parametrize("blanks", ["  ", "\t", "\n ", " \r\n\t "])
def test_blanks_in_a_formula_are_as_one_in_what_is_made_of_it_and_in_what_is_refused(blanks: str) -> None:
    formula = "torque[PIP] += k * t_EDC"
    plain, blank = formula_of(formula), formula_of(formula.replace(" ", blanks))
    assert (blank.name, blank.title, blank.formula) == (plain.name, plain.title, plain.formula)
    with pytest.raises(InputError, match=r"^formula 'torque\[PIP\] \+= k \* \(' cannot be read"):
        formula_of(f"torque[PIP] += k *{blanks}(")


def entered(folder: Path, case: str, mass: str) -> Session:
    """A session whose first case has this id, and this mass on FDP, as they are written in its file."""
    save(folder, averaged() | {"readings": None})
    file = folder / "session.yaml"
    text = file.read_text(encoding="utf-8").replace("id: c001", f"id: {case}").replace("FDP: 950.0", f"FDP: {mass}")
    file.write_text(text, encoding="utf-8")
    return read_session(folder)


@pytest.mark.parametrize(
    ("mass", "grams"), [("0650", 650), ("045", 45), ("0950", 950), ("1_000", 1000), ("650", 650), ("045.5", 45.5)]
)
def test_a_mass_is_what_its_digits_say(mass: str, grams: float, tmp_path: Path) -> None:
    assert entered(tmp_path, "c001", mass).cases[0].masses_g == {"FDP": grams}
    file = tmp_path / "p.yaml"
    shipped = (data_dir() / "protocols" / "synek2019.yaml").read_text(encoding="utf-8")
    file.write_text(shipped.replace("FDP: 950", f"FDP: {mass}", 1), encoding="utf-8")
    assert read_protocol(str(file)).blocks[0].masses_g[1] == {"FDP": grams}


@pytest.mark.parametrize("mass", ["1:30", "0x28A", "0b11", "1:30.5"])
def test_a_mass_that_no_scale_shows_is_refused(mass: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=rf"masses_g\.FDP is '{mass}'; expected a number in g"):
        entered(tmp_path, "c001", mass)


@pytest.mark.parametrize("case", ["010", "12_1", "1:30", "0x10", "0.1_2"])
def test_an_id_is_as_written(case: str, tmp_path: Path) -> None:
    assert entered(tmp_path, case, "950").cases[0].id == case


def test_a_word_that_yaml_takes_for_a_truth_is_refused_as_a_name(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"id is False; expected a name\. Put yes, no, on or off in quotes"):
        entered(tmp_path, "no", "950")
